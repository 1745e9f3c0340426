"""Row motion with the paper's row map, which selects the row whose motion applies to each pixel of the GS picture."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion, RowMotion, geometry, motion_file
from unshutter.motion.geometry import namespace
from unshutter.motion.motion import positions, row_index
from unshutter.motion.motion_file import Common
from unshutter.motion.shapes import Array, Float, Float64, Numbers, Real
from unshutter.options import Reference
from unshutter.reasons import JsonObject

_MOST_CELLS_A_SIDE = 4096  # a network's row map has 256
_SMALLEST_AREA_PX = 1e-3  # a side


def gs_to_rs_by_row_map(
    col: Real[Array, "*#at"],
    row: Real[Array, "*#at"],
    tx: Float[Array, "*#at"],
    rz: Float[Array, "*#at"],
    center: tuple = (0.0, 0.0),
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts GS positions to RS positions [px] with a given motion for each position (paper, Eq. 1 as written).

    The paper's row block needs this: its row map states which row's motion to look up. With the motion of the true RS
    row it equals :func:`~unshutter.motion.geometry.gs_to_rs`.
    """
    xp = namespace(rz)
    cos, sin = xp.cos(rz), xp.sin(rz)
    x, y = col - center[0], row - center[1]
    return x * cos - y * sin + tx + center[0], x * sin + y * cos + center[1]


@final
@dataclass(frozen=True, eq=False, repr=False)
class RowMapMotion(Motion, kind="row-map"):
    """:class:`RowMotion` whose GS -> RS map follows a row map (paper, row block) instead of the exact inverse.

    Only ``gs_to_rs`` differs from that of its ``row_motion``, by the error of the row map.
    """

    __slots__ = ("rz_rad", "tx_px")  # lets fields implement Motion's abstract properties

    tx_px: np.ndarray
    rz_rad: np.ndarray
    # float32 [h, w] row map minus the pixel's own row [px], in the frame for which it was computed
    residual_px: np.ndarray
    # (left, top) of the area it covers, in the readout frame [px]; outside this area the residual at the border is
    # used
    corner: tuple[float, float]
    size: tuple[float, float]  # (width, height) of that area [px]
    # (t_x [px], r_z [rad]) of the GS picture in the frame for which the row map was computed
    pose: tuple[float, float] = (0.0, 0.0)
    center_shift_px: float = 0.0

    def _settle(self) -> None:
        for name in ("tx_px", "rz_rad"):
            object.__setattr__(self, name, motion_file.read_only(getattr(self, name)))
        motion_file.check_lengths(self.center_shift_px)
        residual = motion_file.read_only(self.residual_px, np.float32)
        object.__setattr__(self, "residual_px", residual)
        for name in ("corner", "size", "pose"):
            first, second = getattr(self, name)
            object.__setattr__(self, name, (float(first), float(second)))
        _check_shape(residual.shape)
        motion_file.check_lengths(residual, *self.corner, *self.size, self.pose[0])
        motion_file.check_rotations(self.pose[1])
        if min(self.size) < _SMALLEST_AREA_PX:
            raise UnshutterError("the area of a row map must be larger than nothing")

    @cached_property
    def row_motion(self) -> RowMotion:
        """This motion without its row map."""
        return RowMotion(tx_px=self.tx_px, rz_rad=self.rz_rad, center_shift_px=self.center_shift_px, **self.common)

    # ---- mapping ---------------------------------------------------------------------------------------

    @property
    def is_zero(self) -> bool:
        """Whether rectifying leaves the picture unchanged: no row moved, so the row map has no effect."""
        return self.row_motion.is_zero

    def rs_to_gs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        return self.row_motion.rs_to_gs(col, row)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px], Eq. 1 with the motion of the mapped row."""
        col, row = positions(col, row)
        tx, rz, _ = self.row_motion.at(np.clip(self.row_at(col, row), 0, self.height - 1))
        return gs_to_rs_by_row_map(col, row, tx, rz, self.row_motion.center)

    def row_at(self, col: Any, row: Any) -> np.ndarray:
        """Returns the RS row [px] that read each GS position."""
        from scipy.ndimage import map_coordinates  # training on a bare machine, without SciPy, imports this module

        moved, rotated = self.pose
        middle = (self.width - 1) / 2, (self.height - 1) / 2
        col, row = geometry.rs_to_gs(*positions(col, row), moved, np.float64(rotated), middle)
        height, width = self.residual_px.shape
        x = (col - self.corner[0] + 0.5) * (width / self.size[0]) - 0.5
        y = (row - self.corner[1] + 0.5) * (height / self.size[1]) - 0.5
        at = np.nan_to_num(np.stack([y, x])).reshape(2, -1)
        residual = map_coordinates(self.residual_px, at, np.float64, order=1, mode="nearest")
        return row + residual.reshape(x.shape)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only."""
        self.row_motion.check_unfolded()

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H] [rad per row] and velocity [H, 2] [px per row] of its row motion."""
        return self.row_motion.rates()

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RowMapMotion:
        """Returns the same camera motion relative to another reference row; exact."""
        row = row_index(reference, self.height)
        pose = self.pose[0] + float(self.tx_px[row]), self.pose[1] + float(self.rz_rad[row])
        return self._with(self.row_motion.rereferenced(reference), pose=pose)

    def resized(self, height: int, width: int) -> RowMapMotion:
        """Returns this motion for the picture scaled to another size; the row map scales with it."""
        if (height, width) == (self.height, self.width):
            return self
        rows = self.row_motion.resampled(height, width)
        across, down = width / self.width, height / self.height
        return self._with(
            rows,
            residual_px=self.residual_px * np.float32(down),
            corner=(self.corner[0] * across, self.corner[1] * down),
            size=(self.size[0] * across, self.size[1] * down),
            pose=(self.pose[0] * across, self.pose[1]),
        ).rereferenced(self.reference)

    def scaled(self, strength: float) -> RowMapMotion:
        """Returns the motion with its row motion and row map multiplied by ``strength``: 0 has no effect."""
        rows = self.row_motion.scaled(strength)
        pose = self.pose[0] * strength, self.pose[1] * strength
        return self._with(rows, residual_px=self.residual_px * np.float32(strength), pose=pose)

    def _with(self, rows: RowMotion, **row_map: Any) -> RowMapMotion:
        own = {"tx_px": rows.tx_px, "rz_rad": rows.rz_rad, "center_shift_px": rows.center_shift_px}
        return replace(self, **own, **rows.common, **row_map)

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> JsonObject:
        row_map = {
            # little-endian float32, zlib-compressed, in base64
            "residual_px": base64.b64encode(zlib.compress(self.residual_px.astype("<f4").tobytes())).decode("ascii"),
            "shape": list(self.residual_px.shape),
            "corner": list(self.corner),
            "size": list(self.size),
            "pose": list(self.pose),
        }
        return {**self.row_motion._own_data(), "row_map": row_map}

    @classmethod
    def _of_data(cls, data: JsonObject, common: Common) -> RowMapMotion:
        rows, stored = RowMotion._of_data(data, common), data["row_map"]
        own = {"tx_px": rows.tx_px, "rz_rad": rows.rz_rad, "center_shift_px": rows.center_shift_px}
        places = {key: tuple(float(number) for number in stored[key]) for key in ("corner", "size", "pose")}
        values: JsonObject = {"residual_px": _residual(stored), **own, **places}
        return cls(**values, **common)


def _residual(stored: JsonObject) -> np.ndarray:
    shape = tuple(int(side) for side in stored["shape"])
    _check_shape(shape)
    size = 4 * shape[0] * shape[1]
    unpacker = zlib.decompressobj()
    try:  # at most one byte more than expected: a few bytes could expand to gigabytes
        unpacked = unpacker.decompress(base64.b64decode(stored["residual_px"], validate=True), size + 1)
    except zlib.error as error:
        raise UnshutterError(f"the row map of the motion file is damaged: {error}") from None
    if len(unpacked) != size or not unpacker.eof:
        raise UnshutterError(f"the row map of the motion file is not of its shape, {shape[1]}x{shape[0]}")
    return np.frombuffer(unpacked, dtype="<f4").reshape(shape)


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or max(shape) > _MOST_CELLS_A_SIDE:
        raise UnshutterError(f"a row map has 2 to {_MOST_CELLS_A_SIDE} rows and columns")
