"""Robust non-linear least squares for a few unknowns (Levenberg-Marquardt with reweighting)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float

Residuals = Callable[[np.ndarray], np.ndarray]
# residuals -> (cost of each, weight of each: derivative of the cost with respect to the squared residual)
Loss = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def squared(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Squared loss r^2: nothing is treated as an outlier."""
    return r * r, np.ones_like(r)


def cauchy(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Cauchy loss log(1 + r^2): the influence of outliers decreases with distance."""
    return np.log1p(r * r), 1 / (1 + r * r)


def geman_mcclure(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Geman-McClure loss r^2 / (1 + r^2): outliers lose all influence."""
    return r * r / (1 + r * r), 1 / (1 + r * r) ** 2


def minimise(
    residuals: Residuals,
    start: Float[np.ndarray, "unknowns"],
    loss: Loss = squared,
    steps: int = 50,
    tolerance: float = 1e-10,
) -> tuple[Float[np.ndarray, "unknowns"], float]:
    """Minimises the summed costs of the residuals, near a start; never worse than the start.

    Args:
        residuals: unknowns [P] -> residuals [N], each divided by its expected size. Steps to non-finite residuals are
            rejected.
        start: [P], unknowns of the order of 1 or less.
        loss: cost of a residual.
        steps: maximum number of steps.
        tolerance: stop when a step gains less than this share of the cost, and moves less than its square root.

    Returns:
        Unknowns [P], and their cost.
    """
    x = np.array(start, dtype=np.float64)
    r = residuals(x)
    cost = float(loss(r)[0].sum())
    damping = 1e-3
    for _ in range(steps):
        weights = loss(r)[1]
        J = forward_differences(residuals, x, r, 1e-7 * np.maximum(1.0, np.abs(x)))
        normal = (J.T * weights) @ J
        gradient = J.T @ (weights * r)
        while damping < 1e12:
            diagonal = damping * np.maximum(np.diag(normal), 1e-9 * max(float(np.trace(normal)), 1e-300))
            step = -np.linalg.solve(normal + np.diag(diagonal), gradient)
            tried = residuals(x + step)
            tried_cost = float(loss(tried)[0].sum())
            if tried_cost < cost:
                break
            damping *= 10
        else:
            break
        gain, cost = cost - tried_cost, tried_cost
        x, r, damping = x + step, tried, max(damping / 10, 1e-12)
        if gain <= tolerance * cost and np.abs(step).max() < np.sqrt(tolerance):
            break
    return x, cost


def forward_differences(
    residuals: Residuals,
    x: Float[np.ndarray, "*at unknowns"],
    r: Float[np.ndarray, "*at residuals"],
    steps: Float[np.ndarray, "unknowns"],
) -> Float[np.ndarray, "*at residuals unknowns"]:
    """Returns the Jacobian dr/dx, to first order in the steps.

    Args:
        residuals: unknowns [..., P] -> residuals [..., N].
        x: the unknowns at which to differentiate.
        r: residuals at x.
        steps: [P] change of each unknown.

    Returns:
        [..., N, P].
    """
    columns = []
    for k, step in enumerate(steps):
        moved = x.copy()
        moved[..., k] += step
        columns.append((residuals(moved) - r) / step)
    return np.stack(columns, axis=-1)
