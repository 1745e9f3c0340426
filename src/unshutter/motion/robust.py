"""Weights for robust fits, which give outliers little influence.

Fits alternate between solving with the weights and computing new weights from what the solution leaves.
"""

from __future__ import annotations

import numpy as np

from unshutter.motion.shapes import Bool, Float, Float64

_DEGREES = 3.0  # of freedom of Student's t, the model of the errors of tracks and matches
CORRELATED = 4.0  # errors of tracks and matches are correlated: n of them count as n / CORRELATED


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
    noise = np.sqrt(np.median(known) / 1.4) if np.isnan(noise) else noise
    for _ in range(rounds):
        noise = max(noise, finest)
        share = (_DEGREES + 2) / (_DEGREES + known / noise**2)
        noise = np.sqrt((share * known).mean() / 2)
    noise = max(float(noise), finest)
    return used * (_DEGREES + 2) / (_DEGREES + squared / noise**2) / noise**2, noise


def student_log_likelihoods(squared: Float64[np.ndarray, "*shape"], noise: float) -> Float64[np.ndarray, "*shape"]:
    """Returns the log probability of each point's distance under Student's t in two dimensions, up to a constant."""
    return -2 * np.log(noise) - (_DEGREES + 2) / 2 * np.log1p(squared / (_DEGREES * noise**2))


def falling_weights(squared: Float[np.ndarray, "*shape"], power: float) -> Float[np.ndarray, "*shape"]:
    """Returns 1 / (1 + squared)^power: Geman and McClure's weight for 2, Cauchy's for 1, nearly Huber's for 1/2.

    Args:
        squared: squared residuals, in units of the residual from which weights fall.
    """
    return 1 / (1 + squared) ** power
