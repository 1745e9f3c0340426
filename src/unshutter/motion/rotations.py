"""Geometry of a camera that rotates about all three axes, for NumPy arrays and torch tensors alike.

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

import numpy as np

from unshutter.motion.geometry import constant, namespace
from unshutter.motion.lens import Lens
from unshutter.motion.shapes import Array, Float

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
    start: Float[Array, "*at"] | None = None,
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts GS positions to RS positions, the exact inverse of :func:`rotated_rs_to_gs`.

    Newton's method on the RS row v, which must be the row to which its own rotation moves the point. The residual
    is below 1e-3 px for rotations up to 15 degrees about each axis over the rows (tested). In torch the derivative
    is that of the implicit function: all steps but the last run on constants.

    Args:
        col, row: GS positions [px], of the same shape.
        center: (col, row) of the principal point [px].
        steps: maximum number of Newton steps.
        start: RS rows that are near the result [px], from which fewer steps lead to it; by default the GS rows.

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
    v = constant(row if start is None else start)
    col_const = constant(col)
    row_const = constant(row)
    for _ in range(steps - 1):
        residual, slope = row_residual(v, col_const, row_const, row_rotation, focal_px, center, lens)
        step = constant(residual / slope)
        v = v - step
        if not xp.any(xp.abs(step) > _SETTLED_PX):  # the next step is quadratically smaller; NaN stays NaN
            break
    residual, slope = row_residual(v, col, row, row_rotation, focal_px, center, lens)
    v = v - residual / constant(slope)
    rotation, _ = row_rotation(v)
    return rotate_position(col, row, rotation, focal_px, center, lens)[0] + 0.0 * v, v  # both NaN or neither


def row_residual(
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


def continued(rotations: np.ndarray, rows: int) -> np.ndarray:
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
