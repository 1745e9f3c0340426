"""Cubic splines over time with knots at even distances, and the least squares that finds them."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float64

ORDER = 4  # B-splines that differ from zero at any time


def basis(at: Float[np.ndarray, "*times"], knots: int) -> Float64[np.ndarray, "*times knots"]:
    """The uniform cubic B-splines at times counted in knot intervals.

    Args:
        at: times; spline j is not zero between j - 3 and j + 1, so that ``knots`` of them span 0 ... knots - 3.
        knots: number of splines.
    """
    first = np.clip(np.floor(at).astype(int), 0, knots - ORDER)
    u = at - first
    weights = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, 3 * (u + u**2 - u**3) + 1, u**3], axis=-1) / 6
    values = np.zeros((*at.shape, knots))
    np.put_along_axis(values, first[..., None] + np.arange(ORDER), weights, axis=-1)
    return values


def roughness(knots: int, order: int = 2) -> Float64[np.ndarray, "knots knots"]:
    """Quadratic form of a spline's coefficients: the sum of their squared differences of an order.

    With knots h apart, the integral of the squared second derivative is about ``roughness(knots, 2) / h**3``.
    """
    differences = np.diff(np.eye(knots), order, axis=0)
    return differences.T @ differences


def solve_banded(
    matrix: Float64[np.ndarray, "n n"], right: Float64[np.ndarray, "n"], block: int
) -> tuple[Float64[np.ndarray, "n"], float]:
    """Solves a symmetric, positive definite system that is zero beyond a band, by block Cholesky factors.

    Args:
        matrix: zero where row and column differ by more than ``block``.
        right: the right-hand side.
        block: size of the blocks.

    Returns:
        The solution, and the logarithm of the matrix's determinant.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """
    n = len(right)
    edges = [*range(0, n, block), n]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    x, log_determinant = right.copy(), 0.0
    inverses: list[np.ndarray] = []  # of the diagonal factors
    below: list[np.ndarray] = []
    for k, part in enumerate(parts):
        diagonal = matrix[part, part]
        if k:
            lower = matrix[part, parts[k - 1]] @ inverses[-1].T
            below.append(lower)
            diagonal = diagonal - lower @ lower.T
            x[part] -= lower @ x[parts[k - 1]]
        factor = np.linalg.cholesky(diagonal)
        log_determinant += 2 * float(np.log(np.diag(factor)).sum())
        inverses.append(np.linalg.inv(factor))
        x[part] = inverses[-1] @ x[part]
    for k in range(len(parts) - 1, -1, -1):
        if k + 1 < len(parts):
            x[parts[k]] -= below[k].T @ x[parts[k + 1]]
        x[parts[k]] = inverses[k].T @ x[parts[k]]
    return x, log_determinant
