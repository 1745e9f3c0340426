"""The paper's motion: a translation t_x and a rotation r_z for every row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry import rows as geometry
from unshutter.motion import checks
from unshutter.motion.motion import Motion
from unshutter.motion.motion_file import numbers
from unshutter.motion.sampling import BEYOND, interpolated, matching_rows, row_index, slope
from unshutter.options import Reference, check_strength

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, Numbers


@final
@dataclass(frozen=True, eq=False, repr=False)
class RowMotion(Motion, kind="rows"):
    """Translation t_x and rotation r_z of every row (paper, Eq. 1; signs as in geometry/rows.py).

    Attributes:
        tx_px: [H] t_x of every row [px], positive moves the scene to the right.
        rz_rad: [H] r_z of every row [rad], positive turns the scene clockwise as seen in the picture.
        center_shift_px: offset of the rotation centre from the picture's centre along the columns [px];
            non-zero only after :meth:`rereferenced`.
    """

    __slots__ = ("rz_rad", "tx_px")  # lets fields implement Motion's abstract properties

    tx_px: np.ndarray
    rz_rad: np.ndarray
    center_shift_px: float = 0.0

    def _settle(self) -> None:
        object.__setattr__(self, "tx_px", checks.read_only(self.tx_px))
        object.__setattr__(self, "rz_rad", checks.read_only(self.rz_rad))
        checks.check_lengths(self.center_shift_px)

    # ---- constructors ----------------------------------------------------------------------------------

    @classmethod
    def zero(cls, height: int, width: int, **common: Any) -> RowMotion:
        """Returns zero motion; ``common`` sets further attributes (estimator, reason, readout ...)."""
        return cls(width, np.zeros(height), np.zeros(height), **common)

    @classmethod
    def from_polynomials(
        cls, tx_coefficients: Sequence[float], rz_coefficients: Sequence[float], height: int, width: int, **common: Any
    ) -> RowMotion:
        """Returns a motion whose t_x [px] and r_z [rad] are polynomials in u = row / (height - 1).

        Args:
            tx_coefficients, rz_coefficients: of u^0, u^1, ...; constant terms are kept.
        """
        u = np.arange(height) / max(height - 1, 1)
        tx = geometry.polynomial(np.asarray(tx_coefficients, dtype=np.float64), u)
        rz = geometry.polynomial(np.asarray(rz_coefficients, dtype=np.float64), u)
        return cls(width, tx, rz, **common)

    @classmethod
    def from_key_rows(
        cls,
        rows: Sequence[float],
        tx_px: Sequence[float],
        rz_rad: Sequence[float],
        height: int,
        width: int,
        degree: int | None = None,
        **common: Any,
    ) -> RowMotion:
        """Returns a motion from samples at some rows (at least two, in increasing order).

        Args:
            rows: row of each sample [px].
            tx_px, rz_rad: motion at each sample.
            height, width: size of the readout frame [px].
            degree: fit a polynomial of this degree (the predecessor: 2); None interpolates linearly and
                extrapolates the first and last slopes to the borders.
        """
        known = np.asarray(rows, dtype=np.float64)
        if known.size < 2 or (np.diff(known) <= 0).any():
            raise UnshutterError("key rows must be at least two, in increasing order")
        every_row = np.arange(height, dtype=np.float64)
        if degree is None:
            tx, rz = (interpolated(every_row, known, np.asarray(a, dtype=np.float64)) for a in (tx_px, rz_rad))
        else:
            tx, rz = (np.polynomial.Polynomial.fit(known, a, degree)(every_row) for a in (tx_px, rz_rad))
        return cls(width, tx, rz, **common)

    # ---- mapping ---------------------------------------------------------------------------------------

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the rotation centre [px]."""
        return (self.width - 1) / 2 + self.center_shift_px, (self.height - 1) / 2

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion leaves the picture unchanged."""
        return not (self.tx_px.any() or self.rz_rad.any())

    def rs_to_gs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        col, row = np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64)
        tx, rz, _ = self.at(row)
        return geometry.rs_to_gs(col, row, tx, rz, self.center)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px] (exact inverse)."""
        col, row = np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64)
        return geometry.gs_to_rs(col, row, self.at, self.center)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only.

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """
        turning = np.abs(np.diff(self.rz_rad)).max(initial=0.0)
        if turning * (self.width / 2 + np.abs(self.tx_px).max() + abs(self.center_shift_px)) >= 1:
            raise UnshutterError("the motion turns faster than rows are read: the picture would fold over itself")

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H] [rad per row] and velocity [H, 2] [px per row] at the picture's centre.

        Let F(x, v) be the GS position of RS column x, row v. The slope of F along a row gives the angle of the picture
        at that moment. Its slope across rows, rotated into the RS picture, differs from one row by the distance that
        the scene moved in that time.
        """
        rows = np.arange(self.height, dtype=np.float64)
        middle_col, middle_row = (self.width - 1) / 2, (self.height - 1) / 2
        col, row = self.rs_to_gs(middle_col + np.array([[-0.5], [0.0], [0.5]]), rows[None])  # [3, H]
        angle = -np.unwrap(np.arctan2(row[2] - row[0], col[2] - col[0]))
        cos, sin = np.cos(angle), np.sin(angle)
        slope_col, slope_row, turning = (slope(values) for values in (col[1], row[1], angle))
        # on the row itself, minus the effect of the rotation about the centre
        across = -(slope_col * cos - slope_row * sin) + turning * (rows - middle_row)
        along = 1 - (slope_col * sin + slope_row * cos)
        return turning, np.stack([across, along], axis=-1)

    @cached_property
    def at(self) -> geometry.MotionAtRow:
        """Motion at any row; extrapolated smoothly beyond the first and last rows, where the photo has no pixels.

        (A kink at the border would make the map costly to interpolate in the cells that straddle it.)
        """
        tx, rz = (np.pad(a, BEYOND, mode="reflect", reflect_type="odd") for a in (self.tx_px, self.rz_rad))
        look_up = geometry.row_motion_from_samples(tx, rz)
        return lambda row: look_up(row + BEYOND)

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RowMotion:
        """Returns the same camera motion relative to another reference row.

        Exact: the new GS picture is the old one rotated by r_z and translated by t_x of the new reference row m.
        Substituting p_m = R(r_m) p + t_m in Eq. 1 gives t - t_m, r - r_m and a rotation centre moved by t_m.
        """
        row = row_index(reference, self.height)
        tx, rz = self.tx_px[row], self.rz_rad[row]
        shift = self.center_shift_px + float(tx)
        if not (self.rz_rad - rz).any():  # no rotation: the centre is irrelevant
            shift = 0.0
        return replace(self, reference=reference, tx_px=self.tx_px - tx, rz_rad=self.rz_rad - rz, center_shift_px=shift)

    def resized(self, height: int, width: int) -> RowMotion:
        """Returns this motion for the picture scaled to another size: t_x scales with the width, r_z does not change.

        Rows are matched at their centres; the first and last slopes are extrapolated to the new borders.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent (a rotation would not remain one).
        """
        if (height, width) == (self.height, self.width):
            return self
        return self.resampled(height, width).rereferenced(self.reference)

    def resampled(self, height: int, width: int) -> RowMotion:
        """Resizes as :meth:`resized` does but keeps the pose: rows shift, so the reference row is not quite zero."""
        checks.check_aspect(self.height, self.width, height, width)
        at, known = matching_rows(self.height, height), np.arange(self.height, dtype=np.float64)
        scale = width / self.width
        tx, rz = (interpolated(at, known, a) for a in (self.tx_px * scale, self.rz_rad))
        return replace(self, width=width, tx_px=tx, rz_rad=rz, center_shift_px=self.center_shift_px * scale)

    def scaled(self, strength: float) -> RowMotion:
        """Returns the motion with t_x and r_z multiplied by ``strength``: 0 has no effect, 1 is this motion."""
        check_strength(strength)
        return replace(
            self,
            tx_px=self.tx_px * strength,
            rz_rad=self.rz_rad * strength,
            center_shift_px=self.center_shift_px * strength,
        )

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> dict[str, Any]:
        return {"center_shift_px": self.center_shift_px} if self.center_shift_px else {}

    @classmethod
    def _of_data(cls, data: dict[str, Any], common: dict[str, Any]) -> RowMotion:
        return cls(
            tx_px=numbers(data["tx_px"]),
            rz_rad=numbers(data["rz_rad"]),
            center_shift_px=float(data.get("center_shift_px", 0.0)),
            **common,
        )
