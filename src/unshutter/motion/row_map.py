"""The paper's row map: the row whose motion applies to each pixel of the GS picture (row block)."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry import rows as geometry
from unshutter.motion import checks
from unshutter.motion.sampling import positions

_MOST_CELLS_A_SIDE = 4096  # a network's row map has 256
_SMALLEST_AREA_PX = 1e-3  # a side


@final
@dataclass(frozen=True, eq=False)
class RowMap:
    """The RS row that read each GS position.

    Attributes:
        residual_px: float32 [h, w] row map minus the pixel's own row [px], in the frame for which it was computed.
        corner: (left, top) of the area it covers, in the readout frame [px]; outside this area the residual at the
            border is used.
        size: (width, height) of that area [px].
        pose: (t_x [px], r_z [rad]) of the GS picture in the frame for which the row map was computed.

    Raises:
        UnshutterError: a value is not finite, is impossible for a photo, or contradicts another value.
    """

    residual_px: np.ndarray
    corner: tuple[float, float]
    size: tuple[float, float]
    pose: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        residual = checks.read_only(self.residual_px, np.float32)
        object.__setattr__(self, "residual_px", residual)
        for name in ("corner", "size", "pose"):
            first, second = getattr(self, name)
            object.__setattr__(self, name, (float(first), float(second)))
        _check_shape(residual.shape)
        checks.check_lengths(residual, *self.corner, *self.size, self.pose[0])
        checks.check_turns(self.pose[1])
        if min(self.size) < _SMALLEST_AREA_PX:
            raise UnshutterError("the area of a row map must be larger than nothing")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RowMap):
            return NotImplemented
        same_place = (self.corner, self.size, self.pose) == (other.corner, other.size, other.pose)
        return same_place and np.array_equal(self.residual_px, other.residual_px)

    def __hash__(self) -> int:
        return hash((self.corner, self.size, self.pose, self.residual_px.tobytes()))

    def __reduce__(self) -> tuple:  # keeps the array read-only in another process
        return RowMap, (self.residual_px, self.corner, self.size, self.pose)

    def row_at(self, col: Any, row: Any, middle: tuple[float, float]) -> np.ndarray:
        """Returns the RS row [px] that read each GS position; ``middle`` is the picture's centre, (col, row) [px]."""
        moved, turned = self.pose
        col, row = geometry.rs_to_gs(*positions(col, row), moved, np.float64(turned), middle)
        height, width = self.residual_px.shape
        x = (col - self.corner[0] + 0.5) * (width / self.size[0]) - 0.5
        y = (row - self.corner[1] + 0.5) * (height / self.size[1]) - 0.5
        return row + _bilinear(self.residual_px, np.nan_to_num(x), np.nan_to_num(y))

    def moved(self, tx_px: float, rz_rad: float) -> RowMap:
        """Returns the row map for a GS picture moved and turned further, about its own moved centre."""
        return replace(self, pose=(self.pose[0] + tx_px, self.pose[1] + rz_rad))

    def resized(self, across: float, down: float) -> RowMap:
        """Returns the row map for the picture scaled by these factors along columns and rows."""
        return RowMap(
            residual_px=self.residual_px * np.float32(down),
            corner=(self.corner[0] * across, self.corner[1] * down),
            size=(self.size[0] * across, self.size[1] * down),
            pose=(self.pose[0] * across, self.pose[1]),
        )

    def scaled(self, strength: float) -> RowMap:
        """Returns the row map with residual and pose multiplied by ``strength``."""
        pose = (self.pose[0] * strength, self.pose[1] * strength)
        return replace(self, residual_px=self.residual_px * np.float32(strength), pose=pose)

    # ---- file format -----------------------------------------------------------------------------------

    def to_data(self) -> dict[str, Any]:
        """Returns a JSON-ready dictionary; the residual is little-endian float32, zlib-compressed, in base64."""
        packed = zlib.compress(self.residual_px.astype("<f4").tobytes())
        return {
            "residual_px": base64.b64encode(packed).decode("ascii"),
            "shape": list(self.residual_px.shape),
            "corner": list(self.corner),
            "size": list(self.size),
            "pose": list(self.pose),
        }

    @classmethod
    def of_data(cls, data: dict[str, Any]) -> RowMap:
        """Reads the data written by :meth:`to_data`.

        Raises:
            UnshutterError, KeyError, TypeError, ValueError: the data are not a row map.
        """
        shape = tuple(int(side) for side in data["shape"])
        _check_shape(shape)
        size = 4 * shape[0] * shape[1]
        unpacker = zlib.decompressobj()
        try:  # at most one byte more than expected: a few bytes could expand to gigabytes
            unpacked = unpacker.decompress(base64.b64decode(data["residual_px"], validate=True), size + 1)
        except zlib.error as error:
            raise UnshutterError(f"the row map of the motion file is damaged: {error}") from None
        if len(unpacked) != size or not unpacker.eof:
            raise UnshutterError(f"the row map of the motion file is not of its shape, {shape[1]}x{shape[0]}")
        residual = np.frombuffer(unpacked, dtype="<f4").reshape(shape)
        corner, area, pose = (tuple(float(number) for number in data[key]) for key in ("corner", "size", "pose"))
        return cls(residual, corner, area, pose)  # type: ignore[arg-type]


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or max(shape) > _MOST_CELLS_A_SIDE:
        raise UnshutterError(f"a row map has 2 to {_MOST_CELLS_A_SIDE} rows and columns")


def _bilinear(table: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Interpolates a table [h, w] at positions, clamping them to its border."""
    height, width = table.shape
    x, y = np.clip(col, 0, width - 1), np.clip(row, 0, height - 1)
    left, top = (np.minimum(np.floor(p).astype(int), last) for p, last in ((x, width - 2), (y, height - 2)))
    u, v = x - left, y - top
    above = table[top, left] * (1 - u) + table[top, left + 1] * u
    below = table[top + 1, left] * (1 - u) + table[top + 1, left + 1] * u
    return above * (1 - v) + below * v
