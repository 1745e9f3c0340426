"""Rolling-shutter geometry, implemented once for NumPy arrays and torch tensors alike, and the paper's motion.

Convention (paper, Eq. 1, with the axes and signs of the predecessor's program): time runs along rows.
With coordinates relative to the rotation centre, columns to the right and rows down, pixel centres at whole
numbers, a point of the global-shutter (GS) picture appears in the rolling-shutter (RS) picture at

    col_rs = col_gs * cos(r) - row_gs * sin(r) + t
    row_rs = col_gs * sin(r) + row_gs * cos(r)

where t (t_x, in pixels) and r (r_z, in radians) are the motion of the RS row that saw the point, ``row_rs``.
All functions broadcast; none depends on files, images or estimators.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Unpack, final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import motion_file
from unshutter.motion.motion import BEYOND, Motion, interpolated, matching_rows, row_index, slope
from unshutter.motion.motion_file import Common, Keywords, numbers
from unshutter.motion.shapes import Array, ArrayLike, Float, Float64, Numbers, Real
from unshutter.options import Reference, check_strength
from unshutter.reasons import JsonObject

# (row) -> (t_x, r_z, d r_z / d row), each with the shape of row
MotionAtRow = Callable[[Array], tuple[Array, Array, Array]]


def rs_to_gs(
    col: Real[Array, "*#at"],
    row: Real[Array, "*#at"],
    tx: Float[Array, "*#at"] | float,
    rz: Float[Array, "*#at"],
    center: tuple = (0.0, 0.0),
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts RS positions to GS positions in closed form (paper, Eq. 1, solved for the GS side).

    Args:
        col, row: RS positions [px], any shape.
        tx, rz: motion [px], [rad] of the row that each position is on; broadcast against col and row.
        center: (col, row) of the rotation centre [px].

    Examples:
        >>> rs_to_gs(np.array([10.0]), np.array([5.0]), tx=np.array([2.0]), rz=np.array([0.0]))
        (array([8.]), array([5.]))
    """
    xp = namespace(rz)
    cos = xp.cos(rz)
    sin = xp.sin(rz)
    x = col - center[0] - tx
    y = row - center[1]
    return x * cos + y * sin + center[0], y * cos - x * sin + center[1]


def gs_to_rs(
    col: Real[Array, "*#at"],
    row: Real[Array, "*#at"],
    row_motion: MotionAtRow,
    center: tuple = (0.0, 0.0),
    steps: int = 6,
) -> tuple[Float[Array, "*#at"], Float[Array, "*at"]]:
    """Converts GS positions to RS positions, the exact inverse of :func:`rs_to_gs`.

    Newton's method on the RS row v, which must solve v = row_rs(v): f(v) = v - x sin r(v) - y cos r(v).
    Starts at the GS row. The residual is below 1e-3 px after ``steps`` iterations for every motion of the
    predecessor's generator at aspect ratios up to 2:1 (tested). In torch the derivative with respect to
    the motion and the positions is that of the implicit function, whatever the number of steps: all
    iterations but the last run on constants.

    Args:
        col, row: GS positions [px], any shape.
        row_motion: RS row -> (t_x, r_z, derivative of r_z per row); see :func:`row_motion_from_samples` and
            :func:`row_motion_from_polynomial`.
        center: (col, row) of the rotation centre [px].
        steps: number of Newton steps.

    Examples:
        >>> rows = np.arange(480.0)
        >>> motion = row_motion_from_samples(tx=rows / 8, rz=rows / 4000)
        >>> seen = gs_to_rs(np.array([100.0]), np.array([240.0]), motion)
        >>> tx, rz, _ = motion(seen[1])
        >>> np.round(rs_to_gs(*seen, tx, rz), 3)  # there and back
        array([[100.],
               [240.]])
    """
    x = col - center[0]
    y = row - center[1]
    v = constant(row + 0.0 * col)  # broadcast
    x_const = constant(x)
    y_const = constant(y)
    for _ in range(steps - 1):
        residual, slope = _row_residual(v, x_const, y_const, row_motion, center[1])
        v = constant(v - residual / slope)
    residual, slope = _row_residual(v, x, y, row_motion, center[1])
    v = v - residual / constant(slope)
    tx, rz, _ = row_motion(v)
    xp = namespace(rz)
    return x * xp.cos(rz) - y * xp.sin(rz) + tx + center[0], v


def _row_residual(v: Array, x: Array, y: Array, row_motion: MotionAtRow, center_row: float) -> tuple[Array, Array]:
    _, rz, rz_slope = row_motion(v)
    xp = namespace(rz)
    cos = xp.cos(rz)
    sin = xp.sin(rz)
    residual = v - (x * sin + y * cos + center_row)
    return residual, 1.0 - (x * cos - y * sin) * rz_slope


def namespace(a: Array) -> Array:
    """Returns the array API functions for an array. NumPy 2 implements it; wrapping NumPy would take 60 ms to import.

    Examples:
        >>> namespace(np.zeros(3)).__name__
        'numpy'
    """
    own = getattr(a, "__array_namespace__", None)
    if own is not None:
        return own()
    from array_api_compat import array_namespace

    return array_namespace(a)


def constant(a: Array) -> Array:
    """Returns the array without its gradient (torch); NumPy arrays unchanged.

    Examples:
        >>> constant(np.arange(3))
        array([0, 1, 2])
    """
    return a.detach() if hasattr(a, "detach") else a


def row_motion_from_samples(tx: Float[Array, "rows"], rz: Float[Array, "rows"]) -> MotionAtRow:
    """Interpolates row motion linearly between one sample per row; constant beyond the first and last row.

    Examples:
        >>> motion = row_motion_from_samples(tx=np.array([0.0, 4.0]), rz=np.array([0.0, 0.2]))
        >>> tx, rz, slope = motion(np.array([0.5]))
        >>> tx, rz, slope
        (array([2.]), array([0.1]), array([0.2]))
    """
    xp = namespace(tx)
    last = tx.shape[0] - 1

    def look_up(samples: Array, below: Array, above: Array, weight: Array) -> Array:
        low = samples[below]
        high = samples[above]
        return low + (high - low) * weight

    def row_motion(v: Array) -> tuple[Array, Array, Array]:
        inside = xp.clip(v, 0, last)
        below = xp.astype(xp.clip(xp.floor(inside), 0, max(last - 1, 0)), xp.int64)
        above = xp.clip(below + 1, 0, last)
        weight = inside - xp.astype(below, v.dtype)
        moving = xp.astype((v >= 0) & (v <= last), v.dtype)
        slopes = xp.concat([rz[1:] - rz[:-1], xp.zeros_like(rz[:1])])
        slope = slopes[below] * moving
        return look_up(tx, below, above, weight), look_up(rz, below, above, weight), slope

    return row_motion


def row_motion_from_polynomial(
    tx_coefficients: Float[Array, "*#batch tx_terms"],
    rz_coefficients: Float[Array, "*#batch rz_terms"],
    first: Array | float,
    last: Array | float,
) -> MotionAtRow:
    """Evaluates row motion from polynomials in u = (row - first) / (last - first); constant beyond u = 0 and 1.

    Args:
        tx_coefficients: [K] or [..., K]: coefficients of u^0, u^1, ... [px]; leading dimensions broadcast
            against the requested rows.
        rz_coefficients: coefficients of r_z [rad], in the same form.
        first, last: coordinates of the first and the last row.

    Examples:
        >>> motion = row_motion_from_polynomial(np.array([0.0, 60.0]), np.array([0.0, 0.1]), first=0, last=479)
        >>> tx, rz, _ = motion(np.array([479.0]))
        >>> tx, rz
        (array([60.]), array([0.1]))
    """
    xp = namespace(tx_coefficients)

    def row_motion(v: Array) -> tuple[Array, Array, Array]:
        u = xp.clip((v - first) / (last - first), 0, 1)
        moving = xp.astype((v >= first) & (v <= last), v.dtype)
        degrees = xp.arange(1, rz_coefficients.shape[-1], dtype=v.dtype, device=v.device)
        slope = polynomial(rz_coefficients[..., 1:] * degrees, u) / (last - first)
        return polynomial(tx_coefficients, u), polynomial(rz_coefficients, u), slope * moving

    return row_motion


def polynomial(coefficients: Float[Array, "*#at terms"], u: Float[Array, "*#at"]) -> Float[Array, "*at"]:
    """Evaluates the polynomial with coefficients [..., K] (of u^0, u^1, ...) at u, by Horner's rule.

    ``coefficients[..., k]`` broadcasts against u.

    Examples:
        >>> polynomial(np.array([1.0, 0.0, 2.0]), np.array([0.0, 3.0]))  # 1 + 2 u^2
        array([ 1., 19.])
    """
    value = coefficients[..., -1] + 0.0 * u
    for k in range(coefficients.shape[-1] - 2, -1, -1):
        value = value * u + coefficients[..., k]
    return value


@final
@dataclass(frozen=True, eq=False, repr=False)
class RowMotion(Motion, kind="rows"):
    """Translation t_x and rotation r_z of every row (paper, Eq. 1; signs as above).

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
        object.__setattr__(self, "tx_px", motion_file.read_only(self.tx_px))
        object.__setattr__(self, "rz_rad", motion_file.read_only(self.rz_rad))
        motion_file.check_lengths(self.center_shift_px)

    # ---- constructors ----------------------------------------------------------------------------------

    @classmethod
    def zero(cls, height: int, width: int, **common: Unpack[Keywords]) -> RowMotion:
        """Returns zero motion; ``common`` sets further attributes (reference, readout)."""
        return cls(width, np.zeros(height), np.zeros(height), **common)

    @classmethod
    def from_polynomials(
        cls,
        tx_coefficients: Sequence[float],
        rz_coefficients: Sequence[float],
        height: int,
        width: int,
        **common: Unpack[Keywords],
    ) -> RowMotion:
        """Returns a motion whose t_x [px] and r_z [rad] are polynomials in u = row / (height - 1).

        Args:
            tx_coefficients, rz_coefficients: of u^0, u^1, ...; constant terms are kept.
        """
        u = np.arange(height) / max(height - 1, 1)
        tx = polynomial(np.asarray(tx_coefficients, dtype=np.float64), u)
        rz = polynomial(np.asarray(rz_coefficients, dtype=np.float64), u)
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
        **common: Unpack[Keywords],
    ) -> RowMotion:
        """Returns a motion from samples at some rows (at least two, in increasing order).

        Args:
            rows: row of each sample [px].
            tx_px, rz_rad: motion at each sample.
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

    def rs_to_gs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        col = np.asarray(col, dtype=np.float64)
        row = np.asarray(row, dtype=np.float64)
        tx, rz, _ = self.at(row)
        return rs_to_gs(col, row, tx, rz, self.center)

    def gs_to_rs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px] (exact inverse)."""
        col = np.asarray(col, dtype=np.float64)
        row = np.asarray(row, dtype=np.float64)
        return gs_to_rs(col, row, self.at, self.center)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only."""
        turning = np.abs(np.diff(self.rz_rad)).max(initial=0.0)
        if turning * (self.width / 2 + np.abs(self.tx_px).max() + abs(self.center_shift_px)) >= 1:
            raise UnshutterError("the motion turns faster than rows are read: the picture would fold over itself")

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H], in rad per row, and velocity [H, 2], in px per row, at the picture's centre.

        Let F(x, v) be the GS position of RS column x, row v. The slope of F along a row gives the angle of the picture
        at that moment. Its slope across rows, rotated into the RS picture, differs from one row by the distance that
        the scene moved in that time.
        """
        rows = np.arange(self.height, dtype=np.float64)
        middle_col = (self.width - 1) / 2
        middle_row = (self.height - 1) / 2
        col, row = self.rs_to_gs(middle_col + np.array([[-0.5], [0.0], [0.5]]), rows[None])  # [3, H]
        angle = -np.unwrap(np.arctan2(row[2] - row[0], col[2] - col[0]))
        cos = np.cos(angle)
        sin = np.sin(angle)
        slope_col, slope_row, turning = (slope(values) for values in (col[1], row[1], angle))
        # on the row itself, minus the effect of the rotation about the centre
        across = -(slope_col * cos - slope_row * sin) + turning * (rows - middle_row)
        along = 1 - (slope_col * sin + slope_row * cos)
        return turning, np.stack([across, along], axis=-1)

    @cached_property
    def at(self) -> MotionAtRow:
        """Motion at any row; extrapolated smoothly beyond the first and last rows, where the photo has no pixels.

        (A kink at the border would make the map costly to interpolate in the cells that straddle it.)
        """
        tx, rz = (np.pad(a, BEYOND, mode="reflect", reflect_type="odd") for a in (self.tx_px, self.rz_rad))
        look_up = row_motion_from_samples(tx, rz)
        return lambda row: look_up(row + BEYOND)

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RowMotion:
        """Returns the same camera motion relative to another reference row.

        Exact: the new GS picture is the old one rotated by r_z and translated by t_x of the new reference row m.
        Substituting p_m = R(r_m) p + t_m in Eq. 1 gives t - t_m, r - r_m and a rotation centre moved by t_m.
        """
        row = row_index(reference, self.height)
        tx = self.tx_px[row]
        rz = self.rz_rad[row]
        shift = self.center_shift_px + float(tx)
        if not (self.rz_rad - rz).any():  # no rotation: the centre is irrelevant
            shift = 0.0
        tx_px = self.tx_px - tx
        rz_rad = self.rz_rad - rz
        return replace(self, reference=reference, tx_px=tx_px, rz_rad=rz_rad, center_shift_px=shift)

    def resized(self, height: int, width: int) -> RowMotion:
        """Returns this motion for the picture scaled to another size: t_x scales with the width, r_z does not change.

        Rows are matched at their centres; the first and last slopes are extrapolated to the new borders.
        """
        if (height, width) == (self.height, self.width):
            return self
        return self.resampled(height, width).rereferenced(self.reference)

    def resampled(self, height: int, width: int) -> RowMotion:
        """Resizes as :meth:`resized` does but keeps the pose: rows shift, so the reference row is not quite zero."""
        motion_file.check_aspect(self.height, self.width, height, width)
        at = matching_rows(self.height, height)
        known = np.arange(self.height, dtype=np.float64)
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

    def _own_data(self) -> JsonObject:
        return {"center_shift_px": self.center_shift_px} if self.center_shift_px else {}

    @classmethod
    def _of_data(cls, data: JsonObject, common: Common) -> RowMotion:
        return cls(
            tx_px=numbers(data["tx_px"]),
            rz_rad=numbers(data["rz_rad"]),
            center_shift_px=float(data.get("center_shift_px", 0.0)),
            **common,
        )
