"""Row motion with the paper's row map, which selects the row whose motion applies to each pixel of the GS picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from unshutter.geometry import rows as geometry
from unshutter.motion.motion import Motion
from unshutter.motion.row_map import RowMap
from unshutter.motion.row_motion import RowMotion
from unshutter.motion.sampling import positions, row_index
from unshutter.options import Reference

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, Numbers


@final
@dataclass(frozen=True, eq=False, repr=False)
class RowMapMotion(Motion, kind="row-map"):
    """:class:`RowMotion` whose GS -> RS map follows a row map (paper, row block) instead of the exact inverse.

    Only ``gs_to_rs`` differs from that of its ``row_motion``, by the error of the row map.

    Attributes:
        tx_px: [H] t_x of every row [px], positive moves the scene to the right.
        rz_rad: [H] r_z of every row [rad], positive turns the scene clockwise as seen in the picture.
        row_map: the row whose motion applies to each GS pixel.
        center_shift_px: see :class:`RowMotion`.
    """

    __slots__ = ("rz_rad", "tx_px")  # lets fields implement Motion's abstract properties

    tx_px: np.ndarray
    rz_rad: np.ndarray
    row_map: RowMap
    center_shift_px: float = 0.0

    def _settle(self) -> None:
        object.__setattr__(self, "tx_px", self.row_motion.tx_px)
        object.__setattr__(self, "rz_rad", self.row_motion.rz_rad)

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
        seen_by = self.row_map.row_at(col, row, ((self.width - 1) / 2, (self.height - 1) / 2))
        tx, rz, _ = self.row_motion.at(np.clip(seen_by, 0, self.height - 1))
        return geometry.gs_to_rs_by_row_map(col, row, tx, rz, self.row_motion.center)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only.

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """
        self.row_motion.check_unfolded()

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H] [rad per row] and velocity [H, 2] [px per row] of its row motion."""
        return self.row_motion.rates()

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RowMapMotion:
        """Returns the same camera motion relative to another reference row; exact."""
        row = row_index(reference, self.height)
        row_map = self.row_map.moved(float(self.tx_px[row]), float(self.rz_rad[row]))
        return self._with(self.row_motion.rereferenced(reference), row_map)

    def resized(self, height: int, width: int) -> RowMapMotion:
        """Returns this motion for the picture scaled to another size; the row map scales with it.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent (a rotation would not remain one).
        """
        if (height, width) == (self.height, self.width):
            return self
        row_map = self.row_map.resized(width / self.width, height / self.height)
        return self._with(self.row_motion.resampled(height, width), row_map).rereferenced(self.reference)

    def scaled(self, strength: float) -> RowMapMotion:
        """Returns the motion with its row motion and row map multiplied by ``strength``: 0 has no effect."""
        return self._with(self.row_motion.scaled(strength), self.row_map.scaled(strength))

    def _with(self, rows: RowMotion, row_map: RowMap) -> RowMapMotion:
        """Returns a motion of the same photo with another row motion and row map."""
        return RowMapMotion(
            tx_px=rows.tx_px, rz_rad=rows.rz_rad, center_shift_px=rows.center_shift_px, row_map=row_map, **rows.common
        )

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> dict[str, Any]:
        return {**self.row_motion._own_data(), "row_map": self.row_map.to_data()}

    @classmethod
    def _of_data(cls, data: dict[str, Any], common: dict[str, Any]) -> RowMapMotion:
        rows = RowMotion._of_data(data, common)
        return cls(
            tx_px=rows.tx_px,
            rz_rad=rows.rz_rad,
            center_shift_px=rows.center_shift_px,
            row_map=RowMap.of_data(data["row_map"]),
            **common,
        )
