"""Renders what a camera sees in a place, a cube map of real surroundings, with an attitude for each row.

A camera that only rotates sees nothing but directions, so its pictures are exact, and no pixel is missing at the
borders.

Axes of a place, and of a camera at yaw, tilt and roll 0: x to the right, y down, z ahead; the horizon is level. The six
faces of a cube map are square pictures of 90 degrees: posz ahead, posx to the right, negz behind, negx to the left,
posy above (its lower edge adjoins posz), negy below (its upper edge does).

A row matrix maps the direction (col, row, f) / f in which a pixel of that row is seen, in coordinates about the centre,
to the direction of the same point for the reference camera, which takes the global-shutter picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.geometry import namespace
from unshutter.motion.rotations import rotation_matrix
from unshutter.motion.shapes import Array, Float, Float32, Float64, UInt8

FACES = ("posx", "negx", "posy", "negy", "posz", "negz")
_SHIPPED = Path(__file__).parents[1] / "places"
LEAST_FINE = 0.75  # pixels of a face for one of the picture, in the middle of both
_LEAST_SIDE = 32  # of the faces that are halved for pictures of a few pixels
_BORDER = 1  # px of its neighbours around every face, so that nothing is seen of the seams


@dataclass(frozen=True)
class Camera:
    """The size of a picture, and the attitude of the camera that takes it."""

    height: int
    width: int
    focal_px: float
    yaw: float = 0.0  # all three in degrees; to the right,
    tilt: float = 0.0  # up,
    roll: float = 0.0  # clockwise, as seen by the person who holds the camera

    @classmethod
    def of_view(cls, height: int, width: int, view_deg: float, **attitude: float) -> Camera:
        """Creates a camera with a field of view [degrees] along its longer side."""
        return cls(height, width, max(height, width) / 2 / math.tan(math.radians(view_deg) / 2), **attitude)

    def attitude(self) -> Float64[np.ndarray, "3 3"]:
        """Returns the rotation from the camera's axes to those of the place.

        The camera rolls about its own axis, then tilts, then turns about the vertical: without roll, the verticals of
        the place remain upright in the middle of the picture, whatever yaw and tilt are.
        """
        return attitude_matrix(*np.radians([self.yaw, self.tilt, self.roll]))


@dataclass(frozen=True)
class _Level:
    """The faces of a place at one size, one above the other, with borders."""

    side: int
    atlas: np.ndarray


class Place:
    """A cube map at several sizes."""

    def __init__(self, faces: Mapping[str, UInt8[np.ndarray, "n n 3"]]):
        missing = [name for name in FACES if name not in faces]
        if missing:
            raise UnshutterError(f"a place needs six faces; missing are {', '.join(missing)}")
        shapes = {faces[name].shape for name in FACES}
        side = faces[FACES[0]].shape[0]
        if shapes != {(side, side, 3)}:
            raise UnshutterError(f"the faces of a place must be square, of one size and in colour, got {shapes}")
        self._levels = _levels([faces[name] for name in FACES])

    @classmethod
    def load(cls, folder: Path) -> Place:
        """Reads the six faces in a folder, as RGB: posx.jpg and so on, or PNG."""
        faces = {}
        for name in FACES:
            file = next((path for path in sorted(folder.glob(f"{name}.*"))), None)
            pixels = None if file is None else cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_COLOR)
            if pixels is None:
                raise UnshutterError(f"{folder} holds no place: {name} is missing or cannot be read")
            faces[name] = np.ascontiguousarray(pixels[..., ::-1])
        return cls(faces)

    def levels(self) -> list[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Returns the faces at each of their sizes, the largest first: their side [px], and the atlas of all six."""
        return [(level.side, level.atlas) for level in self._levels]

    def seen(
        self, camera: Camera, rows: Float[np.ndarray, "height 3 3"] | None = None
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Returns the picture that the camera takes, RGB.

        Args:
            camera: the camera at the moment of the reference row.
            rows: the row matrices of a motion; None for a camera that stands still.
        """
        matrices = np.broadcast_to(np.eye(3), (camera.height, 3, 3)) if rows is None else rows
        directions = pixel_directions(camera.attitude() @ matrices, camera.focal_px, camera.width)
        return self._along(*directions, camera.focal_px)

    def along(
        self, directions: Float[np.ndarray, "height width 3"], focal_px: float
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Returns what is seen in directions of any length, RGB, for a picture with this focal length [px]."""
        return self._along(directions[..., 0], directions[..., 1], directions[..., 2], focal_px)

    def _along(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, focal_px: float) -> UInt8[np.ndarray, "h w 3"]:
        # the smallest faces that are nearly as fine as the picture, since larger ones would be sampled too coarsely
        fine = (level for level in self._levels if level.side / 2 >= LEAST_FINE * focal_px)
        level = min(fine, key=lambda level: level.side, default=self._levels[0])
        col, row = face_positions(x, y, z, level.side)
        return cv2.remap(level.atlas, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def places_in(folder: Path) -> list[Path]:
    """Returns the folders of the places in a folder, sorted."""
    places = sorted({path.parent for path in folder.glob("*/posx.*")})
    if not places:
        raise UnshutterError(f"no places in folder {folder} (looked for folders with posx.jpg, negx.jpg and so on)")
    return places


def shipped_places() -> dict[str, Path]:
    """Returns the places of the benchmark, which come with the laboratory, by name."""
    return {path.name: path for path in places_in(_SHIPPED)}


def row_matrices(motion: Motion, focal_px: float) -> Float64[np.ndarray, "height 3 3"]:
    """Returns the row matrices of a motion, relative to its own reference row.

    They are rotations, or what the paper's motion (Eq. 1) does to directions.
    """
    if isinstance(motion, RotationMotion) and motion.lens is None:
        return rotation_matrix(motion.rotations).transpose(0, 2, 1)
    if not isinstance(motion, RowMotion):
        raise UnshutterError(f"a place cannot be seen under a motion of the kind {type(motion).__name__}")
    return paper_matrices(motion.tx_px, motion.rz_rad, focal_px, motion.center_shift_px)


def paper_matrices(
    tx_px: Float[Array, "*at rows"],
    rz_rad: Float[Array, "*at rows"],
    focal_px: float | Float[Array, "*at 1"],
    shift_px: float = 0.0,
) -> Float[Array, "*at rows 3 3"]:
    """Returns the row matrices of t_x [px] and r_z [rad], about a centre shifted by some columns."""
    xp = namespace(rz_rad)
    cosine, sine = xp.cos(rz_rad), xp.sin(rz_rad)
    moved, shift = (tx_px + shift_px) / focal_px, shift_px / focal_px
    zero, one = xp.zeros_like(cosine), xp.ones_like(cosine)
    rows = (
        (cosine, sine, shift - moved * cosine),
        (-sine, cosine, moved * sine),
        (zero, zero, one),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def attitude_matrix(
    yaw: Float[Array, "*at"], tilt: Float[Array, "*at"], roll: Float[Array, "*at"]
) -> Float[Array, "*at 3 3"]:
    """Returns rotations from cameras' axes to those of the place (:meth:`Camera.attitude`); angles in rad."""
    xp = namespace(yaw)
    zero = xp.zeros_like(yaw)
    about_y = rotation_matrix(xp.stack([zero, yaw, zero], axis=-1))
    about_x = rotation_matrix(xp.stack([tilt, zero, zero], axis=-1))
    about_z = rotation_matrix(xp.stack([zero, zero, roll], axis=-1))
    return about_y @ about_x @ about_z


def pixel_directions(
    matrices: Float[Array, "*at height 3 3"], focal_px: float | Float[Array, "*at 1"], width: int
) -> tuple[Float32[Array, "*at height width"], Float32[Array, "*at height width"], Float32[Array, "*at height width"]]:
    """Returns x, y, z of the viewing directions of a camera's pixels, for the matrix of each of its rows."""
    xp = namespace(matrices)
    height = matrices.shape[-3]
    rows, cols = (xp.arange(n, dtype=matrices.dtype, device=matrices.device) for n in (height, width))
    across = xp.astype((cols - (width - 1) / 2) / focal_px, xp.float32)
    down = (rows - (height - 1) / 2) / focal_px
    slope = xp.astype(matrices[..., 0], xp.float32)
    start = xp.astype(matrices[..., 1] * down[..., None] + matrices[..., 2], xp.float32)
    x, y, z = (slope[..., k, None] * across[..., None, :] + start[..., k, None] for k in range(3))
    return x, y, z


def face_positions(
    x: Float[Array, "*b h w"], y: Float[Array, "*b h w"], z: Float[Array, "*b h w"], side: int | Array
) -> tuple[Float[Array, "*b h w"], Float[Array, "*b h w"]]:
    """Returns (col, row) in the atlas, the column of all faces with their borders, of directions of any length."""
    xp = namespace(x)
    size_x, size_y, size_z = xp.abs(x), xp.abs(y), xp.abs(z)
    sideways = (size_x >= size_y) & (size_x >= size_z)
    upright = ~sideways & (size_y >= size_z)
    largest = xp.where(sideways, x, xp.where(upright, y, z))
    scale = (side / 2) / xp.abs(largest)
    sign = xp.sign(largest)
    across = xp.where(sideways, -z * sign, xp.where(upright, x, x * sign))
    down = xp.where(upright, -z * sign, y)
    # y points down: the face above, posy, is the one in the direction of -y
    face = xp.where(sideways, 0.5 - 0.5 * sign, xp.where(upright, 2.5 + 0.5 * sign, 4.5 - 0.5 * sign))
    middle = (side - 1) / 2 + _BORDER
    col = across * scale + middle
    row = down * scale + (middle + face * (side + 2 * _BORDER))
    return xp.astype(col, xp.float32), xp.astype(row, xp.float32)


# (across, down, ahead) of every face as columns in the axes of the place
_FACE_AXES = {
    "posx": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "negx": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "posy": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "negy": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "posz": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "negz": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
}


def face_directions(name: str, side: int, border: int = 0) -> Float64[np.ndarray, "n n 3"]:
    """Returns the directions [n, n, 3] of a face's pixels, and of a border beyond its edges."""
    line = (np.arange(-border, side + border) + 0.5) * (2 / side) - 1
    across, down, ahead = np.array(_FACE_AXES[name], float)
    return line[None, :, None] * across + line[:, None, None] * down + ahead


def _levels(faces: list[np.ndarray]) -> list[_Level]:
    """Returns the faces at their own size, and halved again and again."""
    levels = [_Level(len(faces[0]), _with_borders(faces))]
    while levels[-1].side % 2 == 0 and levels[-1].side > _LEAST_SIDE:
        side = levels[-1].side // 2
        faces = [cv2.resize(face, (side, side), interpolation=cv2.INTER_AREA) for face in faces]
        levels.append(_Level(side, _with_borders(faces)))
    return levels


def _with_borders(faces: list[np.ndarray]) -> np.ndarray:
    """Returns the atlas: faces one above the other, each with a border that shows what its neighbours do."""
    side = len(faces[0])
    edges = [(_BORDER, _BORDER)] * 2
    atlas = np.concatenate([np.pad(face, [*edges, (0, 0)], mode="edge") for face in faces])
    whole = side + 2 * _BORDER
    filled = atlas.copy()
    for number, name in enumerate(FACES):
        directions = face_directions(name, side, _BORDER).astype(np.float32)
        col, row = face_positions(directions[..., 0], directions[..., 1], directions[..., 2], side)
        seen = cv2.remap(atlas, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seen[_BORDER:-_BORDER, _BORDER:-_BORDER] = faces[number]
        filled[number * whole : (number + 1) * whole] = seen
    return filled
