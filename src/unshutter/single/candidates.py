"""The motion to undo and the other candidates, from the posterior of a photo's segments.

The candidates are the mean of the posterior, its most probable modes, and the photo as it is. What undoing each would
do is known from experience (prospects.py); the one with the largest expected benefit is undone, if that is positive.

The smears of a photo give the speed of every row, except for its sign (smear.py), and show that the camera moved. Each
mode of the posterior is then taken twice, with either sign as two further linear Gaussian observations; its mean,
covariance and share follow in closed form. The evidence of right angles on the direction is tempered. A motion along
the wrong direction doubles the distortion, so the photo is left unchanged unless one of them is likely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from unshutter.motion.finding import Candidate, KindOfMotion, MotionOdds
from unshutter.motion.verdict import LIKELY, PROBABLE, is_measurable, reason_to_leave
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter.single.prospects import MOST_AT_REST, MOVING, ExpectedBenefit, Mode, calibration_of, expected_benefit
from unshutter.single.search import Optima, Posterior, displacement, expected_error, mixture_moments
from unshutter.single.sharpness import BLUR
from unshutter.single.smear import Smear, smear_of

_ACROSS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # derivative of t_x over the readout by the coefficients


def candidates_by_smear(posterior: Posterior, view: View, estimator: str) -> tuple[Candidate, ...] | None:
    """Lists the motions of a smeared photo, the one to undo first; returns None if there is no clear smear."""
    limit = view.speed_limit
    time = view.readout_s()
    if limit is None or not time.seconds or view.photo.is_merged():
        return None
    readout_error = math.log(time.longest_s / time.seconds) / 2
    grey = view.grey(BLUR.side)
    smear = smear_of(grey, view.height / grey.shape[0], limit, readout_error)
    if smear is None or readout_error > BLUR.readout_error:
        return None
    sides = [_Side.of(posterior, smear, sign) for sign in (-1, 1)]
    if view.heading:
        sides = [max(sides, key=lambda side: view.heading * float(side.motion @ _ACROSS))]
    total = np.logaddexp.reduce([side.log_weight for side in sides])
    kind = cast(KindOfMotion, max(posterior.kinds, key=posterior.kinds.__getitem__))
    moving: list[Candidate] = []
    benefits: list[ExpectedBenefit] = []
    for side in sorted(sides, key=lambda side: -side.log_weight):
        share = math.exp(side.log_weight - total)
        better = BLUR.stated if view.heading else BLUR.misled / 2 + (1 - BLUR.misled) * share
        mode = Mode(side.motion, side.error, share, kind)
        benefits.append(ExpectedBenefit(better, BLUR.error_left * side.error, displacement(side.motion)))
        moving.append(_candidate(mode, benefits[-1], posterior, view, estimator))
    if limit.refutes(moving[0].motion):
        return None
    first = benefits[0]
    least = view.decision.least_confidence
    if _is_undone(first, least) and (first.better >= LIKELY or least is not None):
        return (*moving, _still(view, estimator, None, 1 - first.better))
    reason = reason_to_leave(first.better, moving[0].motion, moved=True) if view.heading else Reason(Code.WHICH_WAY)
    return (_still(view, estimator, reason, 1 - first.better), *moving)


@dataclass(frozen=True, eq=False)
class _Side:
    """The posterior given the speed of the rows."""

    motion: np.ndarray  # [6] coefficients, the mean
    error: float  # expected displacement [rows]
    log_weight: float  # log probability of this direction, up to a constant

    @classmethod
    def of(cls, posterior: Posterior, smear: Smear, sign: int) -> _Side:
        """Returns the posterior given the speed that smears show, in the direction of this sign."""
        optima = posterior.optima
        J_speed = smear.jacobian()
        spread = optima.covariances / BLUR.temper
        towards = spread @ J_speed.T  # [K, 6, 2]
        covariance = J_speed @ towards + smear.covariance  # [K, 2, 2]
        missing = sign * smear.speed - optima.motions @ J_speed.T  # [K, 2]
        gain = towards @ np.linalg.inv(covariance)
        motions = optima.motions + np.einsum("kij,kj->ki", gain, missing)
        distance = np.einsum("ki,kij,kj->k", missing, np.linalg.inv(covariance), missing)
        weights = BLUR.temper * np.log(np.maximum(optima.share, 1e-30))
        weights = weights - 0.5 * (distance + np.linalg.slogdet(covariance)[1])
        total = float(np.logaddexp.reduce(weights))
        mean, left = mixture_moments(np.exp(weights - total), motions, spread - gain @ towards.swapaxes(1, 2))
        return cls(mean, expected_error(left), total)


LEAST_GAIN = -0.1  # of the lines over chance [nats per unit of weight]; below it, the lines are not those of buildings
LARGEST = 45 / 256  # rows of displacement; larger than any by hand or in the test data


def candidates_of(
    posterior: Posterior, view: View, estimator: str, network_motion: np.ndarray | None = None
) -> tuple[Candidate, ...]:
    """Lists the possible motions of a photo, the one to undo first; if none should be, zero motion with a reason.

    Args:
        network_motion: [6] the network's estimate, if the posterior includes one.
    """
    camera = view.camera
    if view.heading:
        if not (view.heading * (posterior.optima.motions @ _ACROSS) > 0).any():  # none goes the way that was stated
            return (_still(view, estimator, Reason(Code.MOVED_OTHERWISE), None),)
        posterior = _heading(posterior, view.heading)
    roll_known = view.attitude_deg()[0] is not None
    shift = MOVING if camera.moving else MOVING * view.edges.smeared + view.decision.folder
    modes = modes_of(posterior, math.inf if camera.moving else LARGEST)
    benefits = [expected_benefit(posterior, mode, network_motion, roll_known, shift) for mode in modes]
    weighed = [each.better if view.decision.any else each.benefit for each in benefits]
    if weighed and weighed[0] > 0:  # of the mean
        weighed[0] *= 1.5  # a few lines decide between two alike
    best = max(range(len(modes)), key=weighed.__getitem__, default=None)
    order = sorted(range(len(modes)), key=lambda k: (k != best, -benefits[k].better))
    moving = tuple(_candidate(modes[k], benefits[k], posterior, view, estimator) for k in order)
    motion_odds = None if camera.moving else _motion_odds(benefits, view.decision.folder, network_motion is not None)
    at_rest = 1 - max((each.better for each in benefits), default=0.0)
    reason = Reason(Code.NO_RIGHT_ANGLES) if posterior.lines_gain < LEAST_GAIN else None
    if reason is None and not camera.moving and displacement(posterior.motion) > LARGEST:
        mean = expected_benefit(posterior, _mean(posterior), network_motion, roll_known, shift)
        at_rest = min(at_rest, 1 - mean.better)
        reason = Reason(Code.TOO_FAST_FOR_HANDS) if mean.better > PROBABLE else None
    if reason is not None and not view.decision.any:
        return (_still(view, estimator, reason, None), *moving)
    if best is None or not _is_undone(benefits[best], view.decision.least_confidence):
        reason = Reason(Code.NO_VISIBLE_MOTION)
        if best is not None:
            reason = reason_to_leave(benefits[best].better, moving[0].motion, bool(camera.moving))
        return (_with_motion_odds(_still(view, estimator, reason, at_rest), motion_odds), *moving)
    first = moving[0].motion
    if camera.moving and not view.decision.any and not is_measurable(first.largest_px, first.height):
        return (_still(view, estimator, reason_to_leave(benefits[best].better, first, moved=True), at_rest), *moving)
    return (_with_motion_odds(moving[0], motion_odds), *moving[1:], _still(view, estimator, None, at_rest))


def _motion_odds(benefits: list[ExpectedBenefit], folder_log_odds: float, with_network: bool) -> MotionOdds | None:
    """Returns the evidence that the camera moved, apart from that of the folder; None if there is none."""
    if not benefits:
        return None
    slope, constant = calibration_of(with_network).moved
    helps = max(each.log_odds for each in benefits) - folder_log_odds
    return MotionOdds(slope * helps + constant, min(each.decision_threshold for each in benefits) + folder_log_odds)


def _with_motion_odds(candidate: Candidate, motion_odds: MotionOdds | None) -> Candidate:
    return replace(candidate, finding=replace(candidate.finding, motion_odds=motion_odds))


def _heading(posterior: Posterior, sign: int) -> Posterior:
    """Returns the posterior given the sign of t_x over the readout, which an optimum has."""
    optima = posterior.optima
    chosen = np.flatnonzero(sign * (optima.motions @ _ACROSS) > 0)
    share = optima.share[chosen] / optima.share[chosen].sum()
    left = Optima(optima.motions[chosen], optima.covariances[chosen], optima.kind[chosen], share)
    motion, covariance = mixture_moments(left.share, left.motions, left.covariances)
    kinds = {name: float(share[left.kind == k].sum()) for k, name in enumerate(posterior.kinds)}
    return replace(posterior, motion=motion, covariance=covariance, optima=left, kinds=kinds)


def modes_of(posterior: Posterior, largest: float = LARGEST) -> list[Mode]:
    """Returns the mean of the posterior, then its most probable modes that differ from it.

    Args:
        largest: displacement [rows] above which they are left out; by default, more than a hand-held camera makes.
    """
    optima = posterior.optima
    names = cast(list[KindOfMotion], list(posterior.kinds))
    groups: list[list[int]] = []
    for k in np.argsort(-optima.share, kind="stable"):
        home = next((group for group in groups if _alike(optima.motions[group[0]], optima.motions[k])), None)
        groups.append([int(k)]) if home is None else home.append(int(k))
    modes = []
    for group in groups:
        total = float(optima.share[group].sum())
        mean, covariance = mixture_moments(
            optima.share[group] / total, optima.motions[group], optima.covariances[group]
        )
        modes.append(Mode(mean, expected_error(covariance), total, names[optima.kind[group[0]]]))
    whole = _mean(posterior)
    others = [mode for mode in modes if mode.share >= 0.05 and not _alike(mode.motion, whole.motion)]
    possible = [mode for mode in (whole, *others) if displacement(mode.motion) <= largest]
    return sorted(possible, key=lambda mode: -mode.share)[:4]


def _mean(posterior: Posterior) -> Mode:
    kind = cast(KindOfMotion, max(posterior.kinds, key=posterior.kinds.__getitem__))
    return Mode(posterior.motion, posterior.expected_error, 1.0, kind)


def _candidate(mode: Mode, found: ExpectedBenefit, posterior: Posterior, view: View, estimator: str) -> Candidate:
    finding = view.cubic_motion(mode.motion.reshape(2, 3), estimator, found.better)
    finding = replace(finding, expected_error=found.error, kind_shares=tuple(posterior.kinds.items()))
    return Candidate(mode.kind, finding, found.better, view.photo.orientation)


_OF_THE_MOTION = {Code.UNSURE, Code.WHICH_WAY, Code.HARDLY_HELPS, Code.UNSURE_HOW_MOVED, Code.MOVED_TOO_LITTLE}


def _still(view: View, estimator: str, reason: Reason | None, probability: float | None) -> Candidate:
    known = None if probability is None else min(probability, MOST_AT_REST)
    stated = None if reason is None else known
    if reason is not None and reason.code in _OF_THE_MOTION:
        stated = 1 - (probability or 0.0)  # of the motion that is not undone
    finding = replace(view.no_motion(estimator, reason), confidence=stated)
    return Candidate("still", finding, known, view.photo.orientation)


def _is_undone(found: ExpectedBenefit, least: float | None) -> bool:
    return found.benefit > 0 if least is None else found.better >= least


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    size = max(displacement(one), displacement(other))
    return displacement(one - other) < max(1.5 / 256, 0.15 * size)  # rows, and a share of their size
