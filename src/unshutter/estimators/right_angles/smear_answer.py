"""The motion of a photo that is visibly smeared: its size by the smears, its direction and shape by right angles.

A smear says |t_x| over the readout (estimators/smear.py), and that the camera did move. So each bump of the posterior
is taken twice, with t_x = +|t_x| and -|t_x| as one more observation of it, linear and Gaussian: its mean, its
covariance and its share follow in closed form. What right angles say of the direction is tempered, as is all that they
say of whether a camera moved (odds.py); where they do not decide it, the smear is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.right_angles.posterior import Posterior, displacement, expected_error, mixture_moments
from unshutter.estimators.smear import smear_of
from unshutter.motion.candidate import Candidate, KindOfMotion

_SIDE = 480  # px, short side of the copy in which smears are looked for
_TEMPER = 0.1  # share of what right angles say that counts
_SURE = 0.9  # probability of the direction
_LARGEST_ERROR = 0.6  # of a readout time, as a share: beyond, a smear says too little
_RIGHT, _RIGHT_SHARE = 1 / 256, 0.1  # rows, or share of the motion, to which it is right
_ACROSS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # t_x over the readout, by the coefficients


def candidates_by_smear(posterior: Posterior, view: View, estimator: str) -> tuple[Candidate, ...] | None:
    """The motions of a smeared photo, the likelier direction first; None where it is not smeared, or undecided.

    Args:
        posterior: of the photo's segments.
        view: the photo.
        estimator: whose answer it is.
    """
    limit, time = view.speed_limit, view.readout_s()
    if limit is None or not time.typical_s or view.exposure_is_merged():
        return None
    readout_error = math.log(time.longest_s / time.typical_s) / 2
    grey = view.grey(_SIDE)
    smear = smear_of(grey, view.height / grey.shape[0], limit, readout_error)
    if smear is None or readout_error > _LARGEST_ERROR:
        return None
    size = smear.tx_px / view.height
    sides = {sign: _Side.of(posterior, sign * size, smear.error * size) for sign in (-1, 1)}
    total = np.logaddexp(sides[-1].log_weight, sides[1].log_weight)
    shares = {sign: math.exp(side.log_weight - total) for sign, side in sides.items()}
    first, second = sorted(sides, key=lambda sign: -shares[sign])
    if shares[first] < _SURE:
        return None
    kind = cast(KindOfMotion, max(posterior.kinds, key=posterior.kinds.__getitem__))

    def candidate(sign: int, confidence: float | None) -> Candidate:
        motion = view.cubic_motion(sides[sign].motion.reshape(2, 3), estimator, confidence)
        error = sides[sign].error * view.height
        return Candidate(kind, motion, shares[sign], error, view.photo.orientation)

    still = Candidate("still", view.no_motion(estimator), 0.0, None, view.photo.orientation)
    return candidate(first, shares[first] * sides[first].right), candidate(second, None), still


@dataclass(frozen=True, eq=False)
class _Side:
    """The posterior with t_x over the readout known.

    Attributes:
        motion: [6] coefficients, the mean.
        error: expected displacement [rows].
        log_weight: logarithm of how likely this direction is, up to a constant.
    """

    motion: np.ndarray
    error: float
    log_weight: float

    @classmethod
    def of(cls, posterior: Posterior, across: float, error: float) -> _Side:
        """The posterior given that t_x is this over the readout, with this error [rows]."""
        optima = posterior.optima
        spread = optima.covariances / _TEMPER
        towards = spread @ _ACROSS  # [K, 6]
        variance = towards @ _ACROSS + error**2
        missing = across - optima.motions @ _ACROSS
        motions = optima.motions + towards * (missing / variance)[:, None]
        weights = _TEMPER * np.log(np.maximum(optima.share, 1e-30)) - 0.5 * (missing**2 / variance + np.log(variance))
        total = float(np.logaddexp.reduce(weights))
        share = np.exp(weights - total)
        covariances = spread - towards[:, :, None] * towards[:, None, :] / variance[:, None, None]
        mean, covariance = mixture_moments(share, motions, covariances)
        return cls(mean, expected_error(covariance), total)

    @property
    def right(self) -> float:
        """The probability that it is right, if this is the direction."""
        allowed = max(_RIGHT, _RIGHT_SHARE * displacement(self.motion))
        return math.erf(allowed / (math.sqrt(2) * max(self.error, 1e-6)))
