"""Estimates the motion of a visibly smeared photo: its size from the smears, its direction and shape from right angles.

A smear gives |t_x| over the readout (estimators/smear.py) and shows that the camera moved. Each mode of the posterior
is therefore taken twice, with t_x = +|t_x| and -|t_x| as a further linear Gaussian observation; its mean, covariance
and share follow in closed form. The evidence of right angles on the direction is tempered, as is their evidence on
whether the camera moved (odds.py); if they do not decide the direction, the smear is not used.
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

_SIDE = 480  # px, short side of the copy in which smears are measured
_TEMPER = 0.1  # exponent that tempers the evidence of right angles
_SURE = 0.9  # least probability of the direction
_LARGEST_ERROR = 0.6  # largest relative error of the readout time for which smears are used
_RIGHT, _RIGHT_SHARE = 1 / 256, 0.1  # tolerance of a correct motion: rows, or share of it
_ACROSS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # derivative of t_x over the readout by the coefficients


def candidates_by_smear(posterior: Posterior, view: View, estimator: str) -> tuple[Candidate, ...] | None:
    """Returns the motions of a smeared photo, the likelier direction first; None if there is no clear smear.

    Args:
        posterior: posterior of the photo's segments.
        view: the photo.
        estimator: name of the estimator.
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
    """The posterior given t_x over the readout.

    Attributes:
        motion: [6] coefficients, the mean.
        error: expected displacement [rows].
        log_weight: log probability of this direction, up to a constant.
    """

    motion: np.ndarray
    error: float
    log_weight: float

    @classmethod
    def of(cls, posterior: Posterior, across: float, error: float) -> _Side:
        """Returns the posterior given t_x over the readout with its error [rows]."""
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
        """Probability that the motion is right, given that the direction is."""
        allowed = max(_RIGHT, _RIGHT_SHARE * displacement(self.motion))
        return math.erf(allowed / (math.sqrt(2) * max(self.error, 1e-6)))
