"""Cubic splines over time with evenly spaced knots, and the least squares that fit them."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float64

ORDER = 4  # number of B-splines that are non-zero at any time


def basis(at: Float[np.ndarray, "*times"], knots: int) -> Float64[np.ndarray, "*times knots"]:
    """Returns the uniform cubic B-splines at times counted in knot intervals.

    Args:
        at: times; spline j is non-zero between j - 3 and j + 1, so that ``knots`` of them span 0 ... knots - 3.
        knots: number of splines.
    """
    first = np.clip(np.floor(at).astype(int), 0, knots - ORDER)
    u = at - first
    weights = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, 3 * (u + u**2 - u**3) + 1, u**3], axis=-1) / 6
    values = np.zeros((*at.shape, knots))
    np.put_along_axis(values, first[..., None] + np.arange(ORDER), weights, axis=-1)
    return values


def roughness(knots: int, order: int = 2) -> Float64[np.ndarray, "knots knots"]:
    """Returns the quadratic form for the sum of squared differences, of an order, of a spline's coefficients.

    With knots h apart, the integral of the squared second derivative is about ``roughness(knots, 2) / h**3``.
    """
    differences = np.diff(np.eye(knots), order, axis=0)
    return differences.T @ differences


def solve_banded(
    matrix: Float64[np.ndarray, "n n"], right: Float64[np.ndarray, "n"], block: int
) -> tuple[Float64[np.ndarray, "n"], list[Float64[np.ndarray, "k k"]]]:
    """Solves a symmetric, positive definite system that is zero beyond a band, block by block.

    Args:
        matrix: zero where row and column differ by more than ``block``.
        right: the right-hand side.
        block: size of the blocks.

    Returns:
        The solution, and the Schur complement of each diagonal block (see :func:`log_determinant`).

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    n = len(right)
    edges = [*range(0, n, block), n]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    x, left, solved, before = right.copy(), [], [], parts[0]
    for part, following in zip(parts, [*parts[1:], slice(n, n)], strict=True):
        above = matrix[part, following]
        left.append(matrix[part, part] if not left else matrix[part, part] - matrix[before, part].T @ solved[-1])
        every = np.linalg.solve(left[-1], np.concatenate([above, x[part, None]], axis=1))
        solved.append(every[:, :-1])
        x[part] = every[:, -1]
        x[following] -= above.T @ x[part]
        before = part
    for part, following, share in zip(parts[-2::-1], parts[:0:-1], solved[-2::-1], strict=True):
        x[part] -= share @ x[following]
    return x, left


def log_determinant(left: list[Float64[np.ndarray, "k k"]]) -> float:
    """Returns the logarithm of a matrix's determinant, from the diagonal blocks left by :func:`solve_banded`.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    return float(sum(2 * np.log(np.diag(np.linalg.cholesky(block))).sum() for block in left))
