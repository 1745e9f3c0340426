"""The poses of a camera that turns on the spot: as a COLMAP model has them, and how far ours are from the truth."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

import unshutter
from unshutter_lab.synthesis.sequences import RotatingCamera


def write_model(camera: RotatingCamera, frames: Sequence[int], folder: Path) -> Path:
    """A COLMAP model, as text, with the true pose of the middle row of some frames."""
    folder.mkdir()
    numbers = f"{camera.width} {camera.height} {camera.focal_px} {camera.width / 2} {camera.height / 2}"
    (folder / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE {numbers}\n")
    lines: list[str] = []
    for frame in frames:
        turn = cv2.Rodrigues(true_rotation(camera, frame, camera.height // 2))[0].ravel()
        angle = float(np.linalg.norm(turn))
        quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
        lines += [f"{frame + 1} {' '.join(map(str, quaternion))} 0 0 0 1 {frame:05}.png", ""]
    (folder / "images.txt").write_text("\n".join(lines))
    return folder


def true_rotation(camera: RotatingCamera, frame: int, row: float) -> np.ndarray:
    """From the world to the camera."""
    return camera.rotations(np.array([frame + camera.readout_ratio * (row + 0.5) / camera.height]))[0]


def errors_px(camera: RotatingCamera, poses: unshutter.CameraPoses, by_row: bool) -> np.ndarray:
    """How far from its place each direction of a grid is projected, in all pictures [px]."""
    across, down = np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(-0.4, 0.4, 7))
    centre = np.array([(camera.width - 1) / 2, (camera.height - 1) / 2])

    def project(rotation: np.ndarray, direction: np.ndarray) -> np.ndarray:
        x, y, z = rotation @ direction
        return np.array([x / z, y / z]) * camera.focal_px + centre

    found: list[float] = []
    for each in poses.pictures:
        frame = int(each.picture.name[:5])
        for direction in np.stack([across, down, np.ones_like(down)], axis=-1).reshape(-1, 3):
            row = camera.height / 2
            for _ in range(50):
                seen = project(true_rotation(camera, frame, row), direction)
                row = seen[1]
            if 0 <= row <= camera.height - 1:
                pose = each.at(row / (camera.height - 1) if by_row else 0.5)
                found.append(float(np.hypot(*(project(pose[:3, :3], direction) - seen))))
    return np.array(found)
