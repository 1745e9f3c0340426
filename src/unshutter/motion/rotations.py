"""Motion of a camera that rotates about all three axes, and its geometry for NumPy arrays and torch tensors alike.

Convention: camera axes are columns to the right (x), rows down (y), and the viewing direction (z). With coordinates
about the picture's centre, a position is the direction d = (col, row, f), f the focal length in pixels. A point that
the global-shutter (GS) picture shows in direction d_gs appears in the rolling-shutter (RS) picture in direction

    d_rs ~ R(row_rs) d_gs,        R = exp([r_x, r_y, r_z]_x)

where R is the rotation of the RS row that saw the point: the row homography K R K^-1. Signs are those of geometry.py:

    r_z alone is Eq. 1 with t_x = 0;   r_y > 0 moves the centre by f tan(r_y) columns to the right;
    r_x > 0 moves it by f tan(r_x) rows up.

Rotations between two rows are interpolated on the shortest arc. Nothing is linearised. With a lens that bends straight
lines (lens.py; NumPy only), directions are those that it shows at a position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import motion_file
from unshutter.motion.geometry import constant, namespace
from unshutter.motion.lens import Lens
from unshutter.motion.motion import BEYOND, Motion, matching_rows, positions, row_index, slope
from unshutter.motion.motion_file import Common, numbers
from unshutter.motion.shapes import Array, ArrayLike, Float, Float64, Numbers
from unshutter.options import Reference, check_strength
from unshutter.reasons import JsonObject

# (row) -> (R [..., 3, 3], its rate w [..., 3] per row: dR / d row = [w]_x R), leading shape as row
RowRotation = Callable[[Array], tuple[Array, Array]]
_SETTLED_PX = 1e-3  # size of the last Newton step but one: steps get quadratically smaller
_STRAIGHT = 1e-3  # rad between rows; below this, an arc differs from its chord by 1e-7 rad
_SMALL = 1e-4  # rad; below this, three terms of a series are exact to double precision


def rotation_matrix(vectors: Float[Array, "*at 3"]) -> Float[Array, "*at 3 3"]:
    """Converts rotation vectors [..., 3] (axis times angle [rad]) to matrices [..., 3, 3] by Rodrigues' formula.

    Examples:
        >>> np.round(rotation_matrix(np.array([0.0, 0.0, np.pi / 2])) @ [1, 0, 0], 3)  # a quarter turn clockwise
        array([0., 1., 0.])
    """
    xp = namespace(vectors)
    x = vectors[..., 0]
    y = vectors[..., 1]
    z = vectors[..., 2]
    square = x * x + y * y + z * z
    small = square < _SMALL**2
    angle = xp.sqrt(xp.where(small, xp.ones_like(square), square))
    sine = xp.where(small, 1 - square / 6 + square**2 / 120, xp.sin(angle) / angle)  # sin(a) / a
    half = xp.sin(angle / 2) / angle
    versine = xp.where(small, 0.5 - square / 24, 2 * half * half)  # (1 - cos(a)) / a^2
    xy = versine * x * y
    xz = versine * x * z
    yz = versine * y * z
    xs = sine * x
    ys = sine * y
    zs = sine * z
    elements = [
        *(1 - versine * (y * y + z * z), xy - zs, xz + ys),
        *(xy + zs, 1 - versine * (x * x + z * z), yz - xs),
        *(xz - ys, yz + xs, 1 - versine * (x * x + y * y)),
    ]
    return xp.reshape(xp.stack(elements, axis=-1), (*square.shape, 3, 3))


def rotation_vector(matrices: Float[Array, "*at 3 3"]) -> Float[Array, "*at 3"]:
    """Converts matrices [..., 3, 3] to rotation vectors [..., 3], inverting :func:`rotation_matrix` below half a turn.

    Examples:
        >>> rotation_vector(rotation_matrix(np.array([0.1, 0.2, 0.3]))).round(3)
        array([0.1, 0.2, 0.3])
    """
    xp = namespace(matrices)
    m = matrices
    twice = xp.stack([m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], axis=-1)
    square = xp.sum(twice * twice, axis=-1) / 4  # squared sine
    small = square < _SMALL**2
    sine = xp.sqrt(xp.where(small, xp.ones_like(square), square))
    cosine = (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1) / 2
    near_zero = small & (cosine > 0)
    factor = xp.where(near_zero, 1 + square / 6 + 3 * square**2 / 40, xp.atan2(sine, cosine) / sine)
    return twice * (factor / 2)[..., None]


def rotate_position(
    col: Float[Array, "*at"],
    row: Float[Array, "*at"],
    rotation: Float[Array, "*at 3 3"],
    focal_px: float,
    center: tuple,
    lens: Lens | None = None,
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Applies the homography K R K^-1: moves positions as when the camera's picture is rotated by R.

    Args:
        col, row: positions [px], of the same shape [...].
        center: (col, row) of the principal point [px].
        lens: the lens, if it bends straight lines.

    Returns:
        (col, row) [px]; NaN where the rotated direction is behind the camera.

    Examples:
        >>> turn = rotation_matrix(np.array([0.0, np.arctan(0.1), 0.0]))  # about the vertical axis
        >>> col, row = rotate_position(np.array(0.0), np.array(0.0), turn, focal_px=500.0, center=(0, 0))
        >>> float(col.round(3)), float(row.round(3))
        (50.0, 0.0)
    """
    x, y, z = _rotated(col, row, rotation, focal_px, center, lens)
    x, y = (x / z, y / z) if lens is None else lens.position(x, y, z)
    return x * focal_px + center[0], y * focal_px + center[1]


def rotated_rs_to_gs(
    col: Float[Array, "*at"],
    row: Float[Array, "*at"],
    row_rotation: RowRotation,
    focal_px: float,
    center: tuple,
    lens: Lens | None = None,
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts RS positions to GS positions in closed form, undoing each row's homography.

    Args:
        col, row: RS positions [px], of the same shape.
        row_rotation: RS row -> its rotation; see :func:`row_rotation_from_samples`.
        center: (col, row) of the principal point [px].

    Returns:
        (col, row) of the GS positions [px]; NaN where the direction is behind the camera.

    Examples:
        >>> turns = row_rotation_from_samples(rotation_matrix(np.zeros((480, 3))))  # the camera stood still
        >>> col, row = rotated_rs_to_gs(np.array([100.0]), np.array([240.0]), turns, focal_px=500.0, center=(320, 240))
        >>> col, row
        (array([100.]), array([240.]))
    """
    rotation, _ = row_rotation(row)
    return rotate_position(col, row, _transposed(rotation), focal_px, center, lens)


def rotated_gs_to_rs(
    col: Float[Array, "*at"],
    row: Float[Array, "*at"],
    row_rotation: RowRotation,
    focal_px: float,
    center: tuple,
    steps: int = 8,
    lens: Lens | None = None,
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts GS positions to RS positions, the exact inverse of :func:`rotated_rs_to_gs`.

    Newton's method on the RS row v, which must be the row to which its own rotation moves the point. The residual
    is below 1e-3 px for rotations up to 15 degrees about each axis over the rows (tested). In torch the derivative
    is that of the implicit function: all steps but the last run on constants.

    Args:
        col, row: GS positions [px], of the same shape.
        center: (col, row) of the principal point [px].
        steps: maximum number of Newton steps.

    Returns:
        (col, row) of the RS positions [px]; NaN where the rotated direction is behind the camera.

    Examples:
        >>> turns = row_rotation_from_samples(rotation_matrix(np.linspace([0, 0, 0], [0, 0.1, 0], 480)))
        >>> lens = {"focal_px": 500.0, "center": (320, 240)}
        >>> seen = rotated_gs_to_rs(np.array([100.0]), np.array([300.0]), turns, **lens)
        >>> np.round(rotated_rs_to_gs(*seen, turns, **lens), 3)  # there and back
        array([[100.],
               [300.]])
    """
    xp = namespace(row)
    v = constant(row)
    col_const = constant(col)
    row_const = constant(row)
    for _ in range(steps - 1):
        residual, slope = _row_residual(v, col_const, row_const, row_rotation, focal_px, center, lens)
        step = constant(residual / slope)
        v = v - step
        if not xp.any(xp.abs(step) > _SETTLED_PX):  # the next step is quadratically smaller; NaN stays NaN
            break
    residual, slope = _row_residual(v, col, row, row_rotation, focal_px, center, lens)
    v = v - residual / constant(slope)
    rotation, _ = row_rotation(v)
    return rotate_position(col, row, rotation, focal_px, center, lens)[0] + 0.0 * v, v  # both NaN or neither


def _row_residual(
    v: Array, col: Array, row: Array, row_rotation: RowRotation, focal_px: float, center: tuple, lens: Lens | None
) -> tuple[Array, Array]:
    """Returns v minus the row on which the rotation of row v shows the point, and its derivative with respect to v."""
    rotation, rate = row_rotation(v)
    x, y, z = _rotated(col, row, rotation, focal_px, center, lens)
    y_rate = rate[..., 2] * x - rate[..., 0] * z  # of w x d
    z_rate = rate[..., 0] * y - rate[..., 1] * x
    if lens is not None:
        x_rate = rate[..., 1] * z - rate[..., 2] * y
        across, down, along = lens.slopes(x, y, z)[1]
        residual = v - (lens.position(x, y, z)[1] * focal_px + center[1])
        return residual, 1.0 - focal_px * (across * x_rate + down * y_rate + along * z_rate)
    residual = v - (y / z * focal_px + center[1])
    return residual, 1.0 - focal_px * (y_rate * z - y * z_rate) / (z * z)


def _rotated(
    col: Array, row: Array, rotation: Array, focal_px: float, center: tuple, lens: Lens | None = None
) -> tuple[Array, Array, Array]:
    """Returns R d for the directions d of positions; z is NaN where a straight lens would have it behind the camera."""
    xp = namespace(rotation)
    dx = (col - center[0]) / focal_px
    dy = (row - center[1]) / focal_px
    if lens is not None:
        x, y, z = np.einsum("...ij,j...->i...", rotation, np.stack(lens.direction(dx, dy)))
        return x, y, z
    x, y, z = (rotation[..., i, 0] * dx + rotation[..., i, 1] * dy + rotation[..., i, 2] for i in range(3))
    return x, y, xp.where(z > 0, z, xp.full_like(z, xp.nan))


def row_rotation_from_samples(rotations: Float[Array, "rows 3 3"]) -> RowRotation:
    """Interpolates one rotation per row on the shortest arc; constant beyond the first and last row.

    Arcs do not depend on the pose that rotations refer to, so a change of the reference is exact.

    Examples:
        >>> turns = row_rotation_from_samples(rotation_matrix(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2]])))
        >>> matrix, rate = turns(np.array([0.5]))
        >>> rotation_vector(matrix).round(3)
        array([[0. , 0. , 0.1]])
    """
    xp = namespace(rotations)
    last = rotations.shape[0] - 1
    turns = rotation_vector(xp.matmul(rotations[1:], _transposed(rotations[:-1])))
    turns = xp.concat([turns, xp.zeros_like(rotations[:1, 0])])
    steps = xp.concat([rotations[1:] - rotations[:-1], xp.zeros_like(rotations[:1])])
    is_straight = xp is np and bool(xp.abs(turns).max() < _STRAIGHT)

    def row_rotation(v: Array) -> tuple[Array, Array]:
        inside = xp.clip(xp.where(xp.isnan(v), xp.zeros_like(v), v), 0, last)
        below = xp.astype(xp.clip(xp.floor(inside), 0, max(last - 1, 0)), xp.int64)
        rotation = turns[below]
        share = (inside - xp.astype(below, v.dtype))[..., None]
        moving = xp.astype((v >= 0) & (v <= last), v.dtype)
        if is_straight:
            matrices = rotations[below] + share[..., None] * steps[below]
        else:
            matrices = xp.matmul(rotation_matrix(rotation * share), rotations[below])
        return matrices, rotation * moving[..., None]

    return row_rotation


def _transposed(matrices: Array) -> Array:
    return namespace(matrices).matrix_transpose(matrices)


_FOLDED = "the motion turns faster than rows are read: the picture would fold over itself"
_FARTHEST = np.pi / 2  # rad; beyond a right angle the picture's centre is no longer in front of the camera


@final
@dataclass(frozen=True, eq=False, repr=False)
class RotationMotion(Motion, kind="rotations"):
    """Rotation of the camera about all three axes at every row; exact, signs as in motion/rotations.py.

    ``tx_px`` and ``rz_rad`` are derived from the rotations and describe their effect at the picture's centre: the
    number of columns by which the row's homography moves it, and the angle by which it turns a line of pixels there.
    For a rotation about the z axis alone they are the whole motion; otherwise they are its projection onto the paper's
    motion (Eq. 1). Positions are mapped by the rotations themselves, which also shift rows.

    Attributes:
        rotations: [H, 3] rotation vector (r_x, r_y, r_z) of every row [rad], zero at the reference row.
        focal_px: focal length [px of this size].
        lens: the lens, if it bends straight lines; None for one that does not.

    Raises:
        UnshutterError: the array is not [H, 3] or not finite, a rotation is 90 degrees or more, or the focal length
            is not positive.
    """

    rotations: np.ndarray
    focal_px: float
    lens: Lens | None = None

    def _settle(self) -> None:
        rotations = motion_file.read_only(self.rotations)
        object.__setattr__(self, "rotations", rotations)
        if rotations.ndim != 2 or rotations.shape[1] != 3 or len(rotations) < 1:
            raise UnshutterError(f"a motion needs three rotations per row, got an array of shape {rotations.shape}")
        motion_file.check_rotations(rotations)
        motion_file.check_focal(self.focal_px)
        if np.linalg.norm(rotations, axis=1).max() >= _FARTHEST:
            raise UnshutterError("the motion turns the camera by 90 degrees or more")

    # ---- mapping ---------------------------------------------------------------------------------------

    @cached_property
    def tx_px(self) -> np.ndarray:
        """[H] columns by which each row's rotation moves the picture's centre [px]."""
        return motion_file.read_only(self.focal_px * self._matrices[:, 0, 2] / self._matrices[:, 2, 2])

    @cached_property
    def rz_rad(self) -> np.ndarray:
        """[H] angle by which each row's rotation turns a line of pixels at the picture's centre [rad]."""
        return motion_file.read_only(np.arctan2(-self._matrices[:, 0, 1], self._matrices[:, 1, 1]))

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the principal point: the picture's centre [px]."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion leaves the picture unchanged."""
        return not self.rotations.any()

    def rs_to_gs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        return rotated_rs_to_gs(*positions(col, row), self._rotation_at, self.focal_px, self.center, self.lens)

    def gs_to_rs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px] (exact inverse)."""
        return rotated_gs_to_rs(*positions(col, row), self._rotation_at, self.focal_px, self.center, lens=self.lens)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only and lay in front of the camera."""
        reach = self.width / 2 + np.abs(self.tx_px).max()
        row = np.arange(self.height, dtype=np.float64)
        wx, wy, wz = self._rotation_at(row)[1].T
        if self.lens is not None:
            col = np.linspace(-reach, reach, 9)[:, None] + self.center[0] + 0 * row
            slope = _row_residual(row, col, row, self._rotation_at, self.focal_px, self.center, self.lens)[1]
            if slope.min() <= 0:
                raise UnshutterError(_FOLDED)
            return
        x = np.array([[-reach], [reach]]) / self.focal_px
        y = (row - self.center[1]) / self.focal_px
        # rows by which a point at (x, y) moves while one row is read; linear in x, so the two ends suffice
        speed = self.focal_px * (wz * x - wx * (1 + y * y) + wy * x * y)
        if speed.max() >= 1:
            raise UnshutterError(_FOLDED)
        corners = np.array([[sx * reach, sy * self.height / 2, self.focal_px] for sx in (-1, 1) for sy in (-1, 1)])
        along = np.concatenate([self._matrices[:, 2], self._matrices[:, :, 2]])
        if (along @ corners.T).min() <= 0:
            raise UnshutterError("the motion turns part of the picture behind the camera")

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H], in rad per row, and velocity [H, 2], in px per row, at the picture's centre.

        The central ray (0, 0, 1) moves by the rates (w_x, w_y, w_z) x (0, 0, 1).
        """
        rates = slope(self._matrices) @ self._matrices.transpose(0, 2, 1)
        wx = rates[:, 2, 1]
        wy = rates[:, 0, 2]
        wz = rates[:, 1, 0]
        return wz, self.focal_px * np.stack([wy, -wx], axis=-1)

    @cached_property
    def _matrices(self) -> np.ndarray:
        """[H, 3, 3] rotation matrix of every row."""
        return rotation_matrix(self.rotations)

    @cached_property
    def _rotation_at(self) -> RowRotation:
        """Rotation at any row; extrapolated smoothly beyond the first and last rows, as in RowMotion."""
        rotations = _continued(self._matrices, BEYOND)
        look_up = row_rotation_from_samples(rotations)
        return lambda row: look_up(row + BEYOND)

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RotationMotion:
        """Returns the same camera motion relative to another reference row.

        Exact: the new GS picture is the old one rotated by R of the new reference row m, which leaves R(row) R(m)^T.
        """
        row = row_index(reference, self.height)
        if not self.rotations[row].any():
            return self if reference == self.reference else replace(self, reference=reference)
        rotations = rotation_vector(self._matrices @ self._matrices[row].T)
        rotations[row] = 0.0
        return replace(self, reference=reference, rotations=rotations)

    def resized(self, height: int, width: int) -> RotationMotion:
        """Returns this motion for the picture scaled to another size; the focal length scales with the width.

        Rows are matched at their centres; the rotation is extrapolated beyond the first and last rows.
        """
        if (height, width) == (self.height, self.width):
            return self
        motion_file.check_aspect(self.height, self.width, height, width)
        rotations = rotation_vector(self._rotation_at(matching_rows(self.height, height))[0])
        moved = replace(self, width=width, rotations=rotations, focal_px=self.focal_px * width / self.width)
        return moved.rereferenced(self.reference)

    def scaled(self, strength: float) -> RotationMotion:
        """Returns the motion with all rotation angles multiplied by ``strength``: 0 has no effect, 1 is this motion."""
        check_strength(strength)
        return self if strength == 1 else replace(self, rotations=self.rotations * strength)

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> JsonObject:
        lens = {} if self.lens is None else {"lens": self.lens.as_json()}
        return {"rotations_rad": self.rotations.tolist(), "focal_px": self.focal_px, **lens}

    @classmethod
    def _of_data(cls, data: JsonObject, common: Common) -> RotationMotion:
        lens = Lens.of_json(data["lens"]) if "lens" in data else None
        motion = cls(rotations=numbers(data["rotations_rad"]), focal_px=float(data["focal_px"]), lens=lens, **common)
        for key, worked_out in (("tx_px", motion.tx_px), ("rz_rad", motion.rz_rad)):
            written = numbers(data[key])
            if written.shape != worked_out.shape or not np.allclose(written, worked_out, rtol=1e-6, atol=1e-6):
                raise UnshutterError("the motion file contradicts itself: t_x and r_z are not those of its rotations")
        return motion


def _continued(rotations: np.ndarray, rows: int) -> np.ndarray:
    """Extends matrices [H, 3, 3] by ``rows`` rows at both ends, reflecting the rotations about each end.

    R(-k) = R(0) R(k)^T R(0): the odd reflection used by RowMotion, for rotations that do not commute.
    """
    for end in (-1, 1):
        missing = rows
        while missing:
            ordered = rotations[::end]  # the end to extend comes last
            last = ordered[-1]
            more = last @ ordered[-2 : -2 - missing : -1].transpose(0, 2, 1) @ last if len(ordered) > 1 else last[None]
            missing -= len(more)
            rotations = np.concatenate([ordered, more])[::end]
    return rotations
