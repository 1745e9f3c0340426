"""Cube maps whose colours are known in every direction, so that what a camera sees in them can be calculated."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

# what lies to the right of each face's picture, below it, and ahead of it: x to the right, y down, z ahead
LOOKS = {
    "posz": ([1, 0, 0], [0, 1, 0], [0, 0, 1]),
    "posx": ([0, 0, -1], [0, 1, 0], [1, 0, 0]),
    "negz": ([-1, 0, 0], [0, 1, 0], [0, 0, -1]),
    "negx": ([0, 0, 1], [0, 1, 0], [-1, 0, 0]),
    "posy": ([1, 0, 0], [0, 0, 1], [0, -1, 0]),  # its lower edge is the upper one of posz
    "negy": ([1, 0, 0], [0, 0, -1], [0, 1, 0]),
}
Colours = Callable[[np.ndarray], np.ndarray]  # unit directions [..., 3] -> 0 ... 255 [..., 3]


def cube(colours: Colours, side: int = 96) -> dict[str, np.ndarray]:
    """The faces of a place of these colours."""
    line = (np.arange(side) + 0.5) / side * 2 - 1
    faces = {}
    for name, (right, below, ahead) in LOOKS.items():
        directions = line[None, :, None] * np.array(right) + line[:, None, None] * np.array(below) + np.array(ahead)
        faces[name] = np.round(colours(unit(directions))).astype(np.uint8)
    return faces


def unit(directions: np.ndarray) -> np.ndarray:
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def smooth(directions: np.ndarray) -> np.ndarray:
    """Colours that differ everywhere and change slowly."""
    waves = np.array([[3.0, 1.0, -2.0], [-1.0, 2.5, 1.5], [1.5, -2.0, 2.5]])
    return 128 + 110 * np.sin(directions @ waves.T + np.array([0.3, 1.1, 2.0]))


def upright_stripes(directions: np.ndarray) -> np.ndarray:
    """Colours that depend on the azimuth alone: every line between them is upright."""
    azimuth = np.arctan2(directions[..., 0], directions[..., 2])
    return 128 + 100 * np.sin(np.stack([9 * azimuth, 7 * azimuth + 1, 5 * azimuth + 2], -1))


def save_place(folder: Path, faces: dict[str, np.ndarray]) -> Path:
    """Writes the faces as PNG."""
    folder.mkdir(parents=True)
    for name, face in faces.items():
        cv2.imwrite(str(folder / f"{name}.png"), face[..., ::-1])
    return folder


def streets(seed: int = 0, side: int = 256) -> dict[str, np.ndarray]:
    """A drawn place with right angles: windows on the four walls of a yard, which the camera is in the middle of."""
    rng = np.random.default_rng(seed)
    faces = cube(lambda d: np.clip(120 + 100 * d, 0, 255), side)
    for name in ("posz", "posx", "negz", "negx"):
        face = faces[name]
        face[:] = rng.integers(120, 230, 3)
        for row in np.arange(0.08, 0.9, 0.14):
            for col in np.arange(0.06, 0.95, 0.11):
                corners = ((np.array([[col, row], [col + 0.06, row + 0.09]])) * side).astype(int)
                cv2.rectangle(face, corners[0].tolist(), corners[1].tolist(), rng.integers(0, 90, 3).tolist(), -1)
    return faces
