"""Derives the motion to undo, and the other candidates, from the posterior of a photo's segments."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.right_angles.odds import BOUNDED, CAUTION, MOVING, Judgement, judge
from unshutter.estimators.right_angles.posterior import Posterior, displacement, expected_error, mixture_moments
from unshutter.motion.candidate import Candidate, KindOfMotion
from unshutter.motion.verdict import least_visible_px
from unshutter.reasons import Code, Reason

LEAST_GAIN = -0.1  # of the lines over chance [nats per unit of weight]; below it, the lines are not those of buildings
LARGEST = 45 / 256  # rows of displacement; larger than any by hand or in the test data
_TIGHT = 10 / 256  # rows of t_x over a readout: a speed limit below it bounds the possible harm
_MOST_MODES = 3
_LEAST_SHARE = 0.05  # least share of a mode worth showing
_ALIKE = 1.5 / 256  # rows: motions closer than this,
_ALIKE_SHARE = 0.15  # or than this share of their size, look the same
_LEAST_UNDONE = 0.5  # least share of the mean that is undone; below it, the photo is left unchanged


@dataclass(frozen=True, eq=False)
class Mode:
    """A group of posterior optima that look the same.

    Attributes:
        motion: [6] coefficients: their mean.
        error: expected displacement if this is the true mode [rows].
        kind: kind of the most probable of them.
        share: their posterior probability, given that the camera moved.
    """

    motion: np.ndarray
    error: float
    kind: str
    share: float


def candidates_of(
    posterior: Posterior, view: View, estimator: str, opinion: np.ndarray | None = None
) -> tuple[Candidate, ...]:
    """Returns the possible motions of a photo, the one to undo first; zero with a reason if none is accepted.

    Args:
        posterior: posterior of the photo's segments.
        view: the photo.
        estimator: name of the estimator.
        opinion: [6] the network's estimate, if it was run.
    """
    judgement, modes = _judgement(posterior, view, opinion), modes_of(posterior)

    def candidate(mode: Mode, confidence: float | None = None) -> Candidate:
        motion = view.cubic_motion(mode.motion.reshape(2, 3), estimator, confidence)
        motion = replace(motion, kind_shares=tuple(posterior.kinds.items()))
        kind, probability = cast(KindOfMotion, mode.kind), judgement.moved * mode.share
        return Candidate(kind, motion, probability, mode.error * view.height, view.photo.orientation)

    still = Candidate("still", view.no_motion(estimator), 1 - judgement.moved, None, view.photo.orientation)
    reason = _reason_against(posterior, judgement)
    if reason is not None and not (view.camera.at_any_odds and modes):
        return (replace(still, motion=view.no_motion(estimator, reason)), *map(candidate, modes))
    if reason is not None:
        return (*map(candidate, modes), still)
    alike = [mode for mode in modes if _alike(mode.motion, posterior.motion)]
    kind = max(posterior.kinds, key=posterior.kinds.__getitem__)
    mean = Mode(judgement.motion, posterior.expected_error, kind, sum(mode.share for mode in alike))
    undone = candidate(mean, judgement.confidence)
    undone = undone if alike else replace(undone, probability=None)  # between the modes: no probability applies
    if displacement(judgement.motion) < _LEAST_UNDONE * posterior.size:
        if undone.motion.largest_px >= least_visible_px(view.height):
            return (replace(undone, probability=None), *map(candidate, modes), still)
        return (replace(still, motion=undone.motion), *map(candidate, modes))
    return (undone, *(candidate(mode) for mode in modes if mode not in alike), still)


def modes_of(posterior: Posterior) -> list[Mode]:
    """Returns the most probable modes that a hand-held camera can make, in order of probability."""
    optima, names = posterior.optima, list(posterior.kinds)
    groups: list[list[int]] = []
    for k in np.argsort(-optima.share, kind="stable"):
        home = next((group for group in groups if _alike(optima.motions[group[0]], optima.motions[k])), None)
        groups.append([int(k)]) if home is None else home.append(int(k))
    modes = []
    for group in groups:
        share = optima.share[group] / optima.share[group].sum()
        mean, covariance = mixture_moments(share, optima.motions[group], optima.covariances[group])
        modes.append(
            Mode(mean, expected_error(covariance), names[optima.kind[group[0]]], float(optima.share[group].sum()))
        )
    likely = [mode for mode in modes if mode.share >= _LEAST_SHARE and displacement(mode.motion) <= LARGEST]
    return sorted(likely, key=lambda mode: -mode.share)[:_MOST_MODES]


def _judgement(posterior: Posterior, view: View, opinion: np.ndarray | None) -> Judgement:
    roll_known = view.attitude_deg()[0] is not None
    return judge(posterior, opinion, roll_known, _caution(view), view.camera.at_any_odds)


def _caution(view: View) -> float:
    """Returns the threshold on the log odds of motion; the same rule for single photos and folders."""
    limit = view.speed_limit
    if view.camera.moving or (limit is not None and limit.smeared):
        return MOVING
    bounded = limit is not None and np.median(limit.tx_px) < _TIGHT * view.height
    return BOUNDED if bounded else CAUTION


def _reason_against(posterior: Posterior, judgement: Judgement) -> Reason | None:
    """Returns why no motion is accepted, or None if one is."""
    if posterior.lines_gain < LEAST_GAIN:
        return Reason(Code.NO_RIGHT_ANGLES)
    return Reason(Code.TOO_FAST_FOR_HANDS) if displacement(judgement.motion) > LARGEST else None


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    size = max(displacement(one), displacement(other))
    return displacement(one - other) < max(_ALIKE, _ALIKE_SHARE * size)
