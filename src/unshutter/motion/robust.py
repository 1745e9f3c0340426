"""Weights for robust fits, which give outliers little influence.

Fits alternate between solving with the weights and computing new weights from what the solution leaves.
"""

from __future__ import annotations

import numpy as np

from unshutter.motion.shapes import Bool, Float, Float64, Real

_DEGREES = 3.0  # of freedom of Student's t, the model of the errors of tracks and matches
_RIDGE = 1e-12
_LEAST = 1e-30  # of a diagonal: where an unknown is in no equation
CORRELATED = 4.0  # errors of tracks and matches are correlated: n of them count as n / CORRELATED


def median(values: Float[np.ndarray, "*shape n"], count: np.ndarray | None = None) -> np.ndarray:
    """Returns medians along the last axis; np.median takes ten times as long for few values.

    Args:
        values: not NaN.
        count: number of values that count in each row, the first ones; the others are infinite. None: all count.
    """
    size = np.asarray(values.shape[-1] if count is None else count)
    if size.ndim:
        ordered = np.sort(values, axis=-1)
        low, high = (np.take_along_axis(ordered, k[..., None], -1)[..., 0] for k in ((size - 1) // 2, size // 2))
        return (low + high) / 2
    middle = sorted({(int(size) - 1) // 2, int(size) // 2})
    return np.partition(values, middle, axis=-1)[..., middle].mean(axis=-1)


def student_weights(
    squared: Float64[np.ndarray, "*shape"],
    used: Bool[np.ndarray, "*shape"],
    noise: float,
    finest: float = 0.02,
    rounds: int = 3,
) -> tuple[Float64[np.ndarray, "*shape"], float]:
    """Returns weights of points under Student's t in two dimensions, and their noise [px].

    Args:
        squared: squared distance of each point from its expected position [px^2].
        used: which entries hold a point; the others get zero weight.
        noise: current estimate [px]; NaN for none.
        finest: lower limit of the noise [px].
        rounds: number of steps towards the noise that these distances show.
    """
    known = squared[used]
    noise = np.sqrt(float(median(known)) / 1.4) if np.isnan(noise) else noise
    for _ in range(rounds):
        noise = max(noise, finest)
        noise = np.sqrt((_share(known, noise) * known).mean() / 2)
    noise = max(float(noise), finest)
    return used * _share(squared, noise) / noise**2, noise


def student_weights_of_each(
    squared: Float64[np.ndarray, "cases n"], used: Bool[np.ndarray, "cases n"], finest: float = 0.02, rounds: int = 3
) -> Float64[np.ndarray, "cases n"]:
    """Returns the :func:`student_weights` of some sets of points, each with a noise of its own."""
    count = np.maximum(used.sum(axis=-1), 1)
    noise = np.sqrt(median(np.where(used, squared, np.inf), count) / 1.4)[..., None]
    for _ in range(rounds):
        noise = np.maximum(noise, finest)
        noise = np.sqrt((used * _share(squared, noise) * squared).sum(axis=-1) / count / 2)[..., None]
    noise = np.maximum(noise, finest)
    return used * _share(squared, noise) / noise**2


def _share(squared: np.ndarray, noise: float | np.ndarray) -> np.ndarray:
    """Returns the influence of points, compared with that under normal errors."""
    return (_DEGREES + 2) / (_DEGREES + squared / noise**2)


def student_log_likelihoods(squared: Float64[np.ndarray, "*shape"], noise: float) -> Float64[np.ndarray, "*shape"]:
    """Returns the log probability of each point's distance under Student's t in two dimensions, up to a constant."""
    return -2 * np.log(noise) - (_DEGREES + 2) / 2 * np.log1p(squared / (_DEGREES * noise**2))


def falling_weights(squared: Float[np.ndarray, "*shape"], power: float) -> Float[np.ndarray, "*shape"]:
    """Returns 1 / (1 + squared)^power: Geman and McClure's weight for 2, Cauchy's for 1, nearly Huber's for 1/2.

    Args:
        squared: squared residuals, in units of the residual from which weights fall.
    """
    return 1 / (1 + squared) ** power


def weighted_least_squares(
    rows: Float64[np.ndarray, "*#cases n unknowns"],
    values: Float64[np.ndarray, "*cases n"],
    weights: Real[np.ndarray, "*#cases n"],
) -> Float64[np.ndarray, "*cases unknowns"]:
    """Solves small least-squares problems, all at once, by their normal equations.

    A ridge of 1e-12 of each equation settles unknowns that the rows do not determine.
    """
    weighted = (rows * weights[..., None]).swapaxes(-1, -2)
    normal = weighted @ rows
    diagonal = np.einsum("...ii->...i", normal)
    diagonal *= 1 + _RIDGE
    diagonal += _LEAST
    return np.linalg.solve(normal, weighted @ values[..., None])[..., 0]
