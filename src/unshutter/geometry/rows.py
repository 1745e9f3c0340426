"""Rolling-shutter geometry, implemented once for NumPy arrays and torch tensors alike.

Convention (paper, Eq. 1, with the axes and signs of the predecessor's program): time runs along rows.
With coordinates relative to the rotation centre, columns to the right and rows down, pixel centres at whole
numbers, a point of the global-shutter (GS) picture appears in the rolling-shutter (RS) picture at

    col_rs = col_gs * cos(r) - row_gs * sin(r) + t
    row_rs = col_gs * sin(r) + row_gs * cos(r)

where t (t_x, in pixels) and r (r_z, in radians) are the motion of the RS row that saw the point, ``row_rs``.
All functions broadcast; nothing here depends on files, images or estimators.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Real

Array = Any
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

    Returns:
        (col, row) of the GS positions [px].

    Examples:
        >>> rs_to_gs(np.array([10.0]), np.array([5.0]), tx=np.array([2.0]), rz=np.array([0.0]))
        (array([8.]), array([5.]))
    """
    xp = namespace(rz)
    cos, sin = xp.cos(rz), xp.sin(rz)
    x, y = col - center[0] - tx, row - center[1]
    return x * cos + y * sin + center[0], y * cos - x * sin + center[1]


def gs_to_rs_by_row_map(
    col: Real[Array, "*#at"],
    row: Real[Array, "*#at"],
    tx: Float[Array, "*#at"],
    rz: Float[Array, "*#at"],
    center: tuple = (0.0, 0.0),
) -> tuple[Float[Array, "*at"], Float[Array, "*at"]]:
    """Converts GS positions to RS positions with a given motion for each GS position (paper, Eq. 1 as written).

    The paper's row block needs this: its row map states which row's motion to look up. With the
    motion of the true RS row it equals :func:`gs_to_rs`.

    Args:
        col, row: GS positions [px], any shape.
        tx, rz: motion [px], [rad] to apply to each position.
        center: (col, row) of the rotation centre [px].

    Returns:
        (col, row) of the RS positions [px].

    Examples:
        >>> gs_to_rs_by_row_map(np.array([8.0]), np.array([5.0]), tx=np.array([2.0]), rz=np.array([0.0]))
        (array([10.]), array([5.]))
    """
    xp = namespace(rz)
    cos, sin = xp.cos(rz), xp.sin(rz)
    x, y = col - center[0], row - center[1]
    return x * cos - y * sin + tx + center[0], x * sin + y * cos + center[1]


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

    Returns:
        (col, row) of the RS positions [px].

    Examples:
        >>> rows = np.arange(480.0)
        >>> motion = row_motion_from_samples(tx=rows / 8, rz=rows / 4000)
        >>> seen = gs_to_rs(np.array([100.0]), np.array([240.0]), motion)
        >>> tx, rz, _ = motion(seen[1])
        >>> np.round(rs_to_gs(*seen, tx, rz), 3)  # there and back
        array([[100.],
               [240.]])
    """
    x, y = col - center[0], row - center[1]
    v = constant(row + 0.0 * col)  # broadcast
    x_const, y_const = constant(x), constant(y)
    for _ in range(steps - 1):
        residual, slope = _row_residual(v, x_const, y_const, row_motion, center[1])
        v = constant(v - residual / slope)
    residual, slope = _row_residual(v, x, y, row_motion, center[1])
    v = v - residual / constant(slope)
    tx, rz, _ = row_motion(v)
    xp = namespace(rz)
    return x * xp.cos(rz) - y * xp.sin(rz) + tx + center[0], v


def _row_residual(v: Array, x: Array, y: Array, row_motion: MotionAtRow, center_row: Any) -> tuple[Array, Array]:
    _, rz, rz_slope = row_motion(v)
    xp = namespace(rz)
    cos, sin = xp.cos(rz), xp.sin(rz)
    residual = v - (x * sin + y * cos + center_row)
    return residual, 1.0 - (x * cos - y * sin) * rz_slope


def namespace(a: Array) -> Any:
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

    Args:
        tx, rz: samples at rows 0 ... H - 1 [px], [rad], shape [H].

    Examples:
        >>> motion = row_motion_from_samples(tx=np.array([0.0, 4.0]), rz=np.array([0.0, 0.2]))
        >>> tx, rz, slope = motion(np.array([0.5]))
        >>> tx, rz, slope
        (array([2.]), array([0.1]), array([0.2]))
    """
    xp = namespace(tx)
    last = tx.shape[0] - 1

    def look_up(samples: Array, below: Array, above: Array, weight: Array) -> Array:
        flat = [xp.take(samples, xp.reshape(i, (-1,)), axis=0) for i in (below, above)]
        low, high = (xp.reshape(f, below.shape) for f in flat)
        return low + (high - low) * weight

    def row_motion(v: Array) -> tuple[Array, Array, Array]:
        inside = xp.clip(v, 0, last)
        below = xp.astype(xp.clip(xp.floor(inside), 0, max(last - 1, 0)), xp.int64)
        above = xp.clip(below + 1, 0, last)
        weight = inside - xp.astype(below, v.dtype)
        moving = xp.astype((v >= 0) & (v <= last), v.dtype)
        slopes = xp.concat([rz[1:] - rz[:-1], xp.zeros_like(rz[:1])])
        slope = xp.reshape(xp.take(slopes, xp.reshape(below, (-1,)), axis=0), below.shape) * moving
        return look_up(tx, below, above, weight), look_up(rz, below, above, weight), slope

    return row_motion


def row_motion_from_polynomial(
    tx_coefficients: Float[Array, "*#batch tx_terms"],
    rz_coefficients: Float[Array, "*#batch rz_terms"],
    first: Any,
    last: Any,
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


def polynomial_projection(rows: int, degree: int, like: Float[Array, "..."]) -> Float[Array, "{rows} {degree+1}"]:
    """Returns the least-squares fit of a polynomial as a fixed matrix (the paper's trajectory module).

    ``coefficients = values @ projection`` is the fit over u = row / (rows - 1).

    Args:
        rows: number of samples, at least degree + 1.
        degree: degree of the polynomial.
        like: array that determines library, dtype and device of the matrix.

    Returns:
        The matrix [rows, degree + 1].

    Examples:
        >>> values = np.array([1.0, 2.0, 3.0])
        >>> np.round(values @ polynomial_projection(rows=3, degree=1, like=values), 3)  # 1 + 2 u
        array([1., 2.])
    """
    xp = namespace(like)
    u = xp.arange(rows, dtype=like.dtype, device=like.device) / max(rows - 1, 1)
    powers = xp.stack([u**k for k in range(degree + 1)], axis=-1)  # [rows, degree + 1]
    return xp.permute_dims(xp.linalg.pinv(powers), (1, 0))
