"""A drawn street corner, photographed with a rolling shutter by a camera that turns, and may walk, meanwhile.

Everything is known: the camera's places and directions, and its rotation at every row. World axes: X to the right,
Y down, Z ahead; two house fronts (Z = 0 and X = 0) meet above the pavement (Y = 0); metres. Time is counted in
readouts (from the first row to the last) and begins when a picture's middle row is exposed.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from unshutter.motion import RotationMotion
from unshutter.motion.rotations import rotation_matrix

TEXTURE_PX = 110  # per metre
FRAME = (235, 235, 225)  # colour of the windows' frames
OVERSAMPLING = 2  # rays per pixel's side
READOUT_S = 0.03  # what a readout takes, where it matters


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion, principal point in the picture's middle."""

    width: int = 640
    height: int = 480
    focal_px: float = 560.0

    def row_times(self, rows: np.ndarray) -> np.ndarray:
        """When rows are exposed."""
        return (rows - self.height // 2) / (self.height - 1)


@dataclass(frozen=True)
class Turning:
    """How a camera turns while a picture is read out, and in the pictures before and after it.

    Attributes:
        steady: [3] turn in a readout, about x, y and z [rad].
        changing: [3] half of what that grows by in a readout [rad]; before and after the picture it swings, one
            radian a readout: with a readout of 30 ms at 5 Hz, as a hand does.
    """

    steady: np.ndarray
    changing: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        """[N, 3] rotation vectors at times [N]."""
        within = np.clip(time, -0.5, 0.5)[:, None]
        beyond = time[:, None] - within
        turned = within * self.steady + within**2 * self.changing
        rate = self.steady + 2 * within * self.changing  # at the first or last row
        return turned + np.sin(beyond) * rate + 2 * (1 - np.cos(beyond)) * self.changing


@dataclass(frozen=True)
class Frame:
    """Where the camera was for one picture, and how it moved while it was read out.

    Attributes:
        place: [3] of the camera when the middle row was exposed [m].
        rotation: [3, 3] world -> camera axes at that moment.
        turning: from there on, and before.
        velocity: [3] of the camera [m per readout].
    """

    place: np.ndarray
    rotation: np.ndarray
    turning: Turning
    velocity: np.ndarray

    def motion(self, camera: Camera) -> RotationMotion:
        """The true turning of every row, the middle one being the reference."""
        rotations = self.turning.at(camera.row_times(np.arange(camera.height)))
        return RotationMotion(camera.width, rotations=rotations, focal_px=camera.focal_px, reference="middle")


@dataclass(frozen=True)
class Plane:
    """A painted rectangle: its corner, its two directions, its picture."""

    corner: np.ndarray
    right: np.ndarray
    down: np.ndarray
    texture: np.ndarray


def draw_scene(seed: int) -> list[Plane]:
    """The two fronts and the pavement, 14 x 9 and 14 x 14 metres."""
    rng = np.random.default_rng(seed)
    x, y, z = np.eye(3)
    return [
        Plane(-9 * y, x, y, draw_front(rng, 14, 9)),
        Plane(-9 * y - 14 * z, z, y, draw_front(rng, 14, 9)),
        Plane(-14 * z, x, z, draw_pavement(rng, 14, 14)),
    ]


def draw_front(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """A house front: plaster, rows of windows of which no two are alike, and a line between the storeys."""
    picture = 170 + _grain(rng, width, height, 14)
    for left in np.arange(0.6, width - 1, 1.7):
        for top in np.arange(0.5, height - 1, 2.1):
            pane = rng.uniform(40, 110, 3) + 2 * _grain(rng, 1.0, 1.4, 12)
            h, w = pane.shape[:2]
            bar = int(rng.uniform(0.25, 0.75) * h)
            pane[:7] = pane[-7:] = pane[:, :7] = pane[:, -7:] = pane[:, w // 2 : w // 2 + 5] = FRAME
            pane[bar : bar + 5] = FRAME
            t, l = int(top * TEXTURE_PX), int(left * TEXTURE_PX)  # noqa: E741
            picture[t : t + h, l : l + w] = pane
    for row in np.arange(2.2, height, 2.1):
        cv2.line(picture, (0, int(row * TEXTURE_PX)), (picture.shape[1], int(row * TEXTURE_PX)), (120, 110, 100), 6)
    return np.clip(picture, 0, 255).astype(np.uint8)


def draw_pavement(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Square stones of different greys."""
    stones = cv2.resize(
        rng.uniform(80, 150, (2 * height, 2 * width)), None, fx=TEXTURE_PX / 2, fy=TEXTURE_PX / 2, interpolation=0
    )
    picture = np.repeat(stones[..., None], 3, axis=2) + _grain(rng, width, height, 18)
    for at in range(0, picture.shape[0], TEXTURE_PX // 2):
        picture[at : at + 3] = picture[:, at : at + 3] = 60
    return np.clip(picture, 0, 255).astype(np.uint8)


def walk(
    camera: Camera, frames: int, turn_deg: tuple[float, float, float], seed: int, speed_m_s: float = 0.0
) -> list[Frame]:
    """Pictures taken along an arc around the corner, each with a turn of its own.

    Args:
        camera: of all pictures.
        frames: how many.
        turn_deg: largest turn over the readout about x (up, down), y (left, right) and z (roll) [deg].
        seed: same seed, same walk.
        speed_m_s: how fast the camera walks along the arc [m/s].
    """
    rng = np.random.default_rng(seed)
    taken = []
    for bearing in np.linspace(np.radians(25), np.radians(65), frames):
        place = np.array([8.0 * np.sin(bearing), -1.7, -8.0 * np.cos(bearing)]) + rng.normal(0, 0.15, 3)
        looked_at = np.array([1.0, -2.3, -1.0]) + rng.normal(0, 0.25, 3)
        held = rotation_matrix(np.array([0, 0, np.radians(rng.normal(0, 1.5))]))
        steady, changing = (rng.uniform(-1, 1, 3) * np.radians(turn_deg) for _ in range(2))
        velocity = speed_m_s * READOUT_S * np.array([np.cos(bearing), 0, np.sin(bearing)])
        taken.append(Frame(place, held @ _looking(looked_at - place), Turning(steady, changing), velocity))
    return taken


def photograph(scene: list[Plane], camera: Camera, frame: Frame, rolling: bool, later: float = 0.0) -> np.ndarray:
    """What the camera sees, [height, width, 3] uint8: row by row as it moves, or all at the middle row's moment.

    Args:
        scene: what there is to be seen.
        camera: what sees it.
        frame: where it is and how it moves.
        rolling: whether its rows see one after another.
        later: how much later the picture is taken [readouts].
    """
    rows, cols = ((np.arange(OVERSAMPLING * side) + 0.5) / OVERSAMPLING - 0.5 for side in (camera.height, camera.width))
    col, row = np.meshgrid(cols - (camera.width - 1) / 2, rows - (camera.height - 1) / 2)
    rays = np.stack([col, row, np.full_like(col, camera.focal_px)], axis=-1)  # camera axes
    times = later + rolling * camera.row_times(rows)
    place = frame.place + times[:, None, None] * frame.velocity
    if times.any():
        rays = np.einsum("vji,vcj->vci", rotation_matrix(frame.turning.at(times)), rays)  # as at time 0
    rays = rays @ frame.rotation  # world axes
    picture = np.full(rays.shape, 225, np.uint8)  # sky
    nearest = np.full(rays.shape[:2], np.inf)
    for plane in scene:
        normal = np.cross(plane.right, plane.down)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (plane.corner - place) @ normal / (rays @ normal)
            hit = place + distance[..., None] * rays - plane.corner
        u, v = ((hit @ axis * TEXTURE_PX - 0.5).astype(np.float32) for axis in (plane.right, plane.down))
        height, width = plane.texture.shape[:2]
        seen = (distance > 0) & (distance < nearest) & (u > 0) & (u < width - 1) & (v > 0) & (v < height - 1)
        picture[seen] = cv2.remap(plane.texture, u, v, cv2.INTER_LINEAR)[seen]
        nearest[seen] = distance[seen]
    return cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def _looking(direction: np.ndarray) -> np.ndarray:
    """World -> camera axes of a camera that looks in a direction and is held level."""
    ahead = direction / np.linalg.norm(direction)
    right = np.cross([0, 1, 0], ahead)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def _grain(rng: np.random.Generator, width: float, height: float, strength: float) -> np.ndarray:
    """Noise of all sizes from decimetres to a pixel, [px, px, 3]."""
    size = (round(width * TEXTURE_PX), round(height * TEXTURE_PX))
    grain = np.zeros((size[1], size[0], 3))
    for cell in (1, 3, 9, 27):
        cells = (size[1] // cell + 1, size[0] // cell + 1)
        noise = rng.normal(0, strength, cells).astype(np.float32)
        grain += cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)[..., None]
    return grain
