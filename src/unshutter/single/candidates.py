"""The motion to undo and the other candidates, from the posterior of a photo's segments: whether it moved, how sure.

The errors of segments on one desk or facade are correlated, so the evidence of the likelihood is overstated: the
location of the optimum is more reliable than its existence. The value of such evidence was learned from photos with
known motions and without motion (own-model.md): a forest of small decision trees on the figures of the search, and
logistic regressions for the confidence (prior.py reads both).

The smear of a photo gives |t_x| over the readout (sharpness.py) and shows that the camera moved. Each mode of the
posterior is then taken twice, with t_x = +|t_x| and -|t_x| as a further linear Gaussian observation; its mean,
covariance and share follow in closed form. The evidence of right angles on the direction is tempered, as is their
evidence on whether the camera moved; if they do not decide the direction, the smear is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from unshutter.motion.verdict import Candidate, KindOfMotion, least_visible_px, probability_right
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter.single.prior import shipped
from unshutter.single.search import PX, Posterior, bend, displacement, expected_error, mixture_moments
from unshutter.single.sharpness import smear_of

_STEEPNESS = 8.0  # of the transition from no motion to all of it
CAUTION = math.log(0.8)  # log odds at which half of a motion is undone; for photos in general, losses count in full
MOVING = math.log(0.2)  # if the camera is known to have moved
_EVEN = 1e-9  # log odds at which motion is just more likely than none


@dataclass(frozen=True)
class Judgement:
    """The conclusion drawn from a posterior."""

    motion: np.ndarray  # [6] coefficients to undo; almost zero if the camera barely moved
    confidence: float  # probability that it is right (docs/research)
    moved: float  # probability that there was motion worth undoing


def judge(
    posterior: Posterior,
    opinion: np.ndarray | None = None,
    roll_known: bool = False,
    caution: float = CAUTION,
    at_any_odds: bool = False,
) -> Judgement:
    """Weighs a posterior's motion against no motion.

    Args:
        roll_known: whether the camera's roll is known and so cannot be mistaken for shear.
        caution: log odds at which half of the motion is undone.
        at_any_odds: whether to return the whole motion, however likely it is that there was none. The confidence is
            then the motion's, which is not calibrated if the odds are against it.
    """
    if roll_known:  # without motion the evidence then rarely exceeds 8 nats
        in_favour = 0.12 * max(posterior.evidence_of.values()) - 0.7 + CAUTION
    elif opinion is None:
        in_favour = shipped().odds_without_network.log_odds({"evidence": posterior.evidence})
    else:
        in_favour = shipped().forest.odds(figures(posterior, opinion))
    odds, moved = in_favour - caution, _probability(float(np.clip(in_favour, -50, 50)))
    if at_any_odds:
        right = _probability(_log_odds_right(posterior, opinion, max(odds, _EVEN)))
        return Judgement(posterior.motion, right * min(2 * _probability(max(odds, -50.0)), 1.0), moved)
    motion = posterior.motion * _probability(float(np.clip(_STEEPNESS * odds, -50, 50)))
    return Judgement(motion, _probability(_log_odds_right(posterior, opinion, odds)), moved)


def figures(posterior: Posterior, opinion: np.ndarray) -> dict[str, float]:
    """Returns the features of the forest; displacements in px of 256 rows."""
    return {
        "evidence": posterior.evidence,
        "lines_gain": posterior.lines_gain,
        "gain_at_rest": posterior.gain_at_rest,
        "weight": posterior.weight,
        "answer_bend": PX * bend(opinion),
        "answer_size": PX * displacement(opinion),
        "disagreement": PX * displacement(opinion - posterior.motion),
        "error": PX * posterior.expected_error,
        "size": PX * posterior.size,
        "bend": PX * bend(posterior.motion),
        "breadth": posterior.breadth,
        "against": posterior.against,
        "in_favour": posterior.in_favour,
        "roll": abs(math.degrees(posterior.pose.roll)),
        "roll_at_rest": abs(math.degrees(posterior.pose_at_rest.roll)),
        "tilt": math.degrees(posterior.pose.tilt),
        "tilt_at_rest": math.degrees(posterior.pose_at_rest.tilt),
        "focal": posterior.pose.log_focal,
        "focal_at_rest": posterior.pose_at_rest.log_focal,
        **{f"evidence for {kind}": evidence for kind, evidence in posterior.evidence_of.items()},
        **{f"share of {kind}": share for kind, share in posterior.kinds.items()},
    }


def confidence_figures(posterior: Posterior, opinion: np.ndarray | None, odds: float) -> dict[str, float]:
    """Returns the features of the confidence: mostly log displacements in px of 256 rows."""
    common = {
        "error": math.log(PX * posterior.expected_error + 0.1),
        "size": math.log(PX * posterior.size + 0.3),
        "lines_gain": posterior.lines_gain,
        "weight": math.log(posterior.weight),
        "odds": min(max(odds, -4.0), 6.0),
    }
    if opinion is None:
        return common
    answer, apart = (PX * displacement(each) for each in (opinion, opinion - posterior.motion))
    # larger estimates of the network have larger errors
    return common | {"answer": math.log(answer + 0.3), "apart": math.log(apart / math.hypot(1, answer / 25) + 0.3)}


def _log_odds_right(posterior: Posterior, opinion: np.ndarray | None, odds: float) -> float:
    name = ("rectified" if odds > 0 else "left") + (" without network" if opinion is None else "")
    return shipped().confidence[name].log_odds(confidence_figures(posterior, opinion, odds))


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds))


_SIDE = 480  # px, short side of the copy in which smears are measured
_TEMPER = 0.1  # exponent that tempers the evidence of right angles
_SURE = 0.9  # least probability of the direction
_LARGEST_ERROR = 0.6  # largest relative error of the readout time for which smears are used
_ACROSS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # derivative of t_x over the readout by the coefficients


def candidates_by_smear(posterior: Posterior, view: View, estimator: str) -> tuple[Candidate, ...] | None:
    """Returns the motions of a smeared photo, the likelier direction first; None if there is no clear smear."""
    limit, time = view.speed_limit, view.readout_s()
    if limit is None or not time.typical_s or view.photo.is_merged():
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
    right = probability_right(PX * displacement(sides[first].motion), PX * sides[first].error)  # given the direction
    return candidate(first, shares[first] * right), candidate(second, None), still


@dataclass(frozen=True, eq=False)
class _Side:
    """The posterior given t_x over the readout."""

    motion: np.ndarray  # [6] coefficients, the mean
    error: float  # expected displacement [rows]
    log_weight: float  # log probability of this direction, up to a constant

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


LEAST_GAIN = -0.1  # of the lines over chance [nats per unit of weight]; below it, the lines are not those of buildings
LARGEST = 45 / 256  # rows of displacement; larger than any by hand or in the test data
_MOST_MODES = 3
_LEAST_SHARE = 0.05  # least share of a mode worth showing
_ALIKE = 1.5 / 256  # rows: motions closer than this,
_ALIKE_SHARE = 0.15  # or than this share of their size, look the same
_LEAST_UNDONE = 0.5  # least share of the mean that is undone; below it, the photo is left unchanged


@dataclass(frozen=True, eq=False)
class Mode:
    """A group of posterior optima that look the same."""

    motion: np.ndarray  # [6] coefficients: their mean
    error: float  # expected displacement if this is the true mode [rows]
    kind: str  # kind of the most probable of them
    share: float  # their posterior probability, given that the camera moved


def candidates_of(
    posterior: Posterior, view: View, estimator: str, opinion: np.ndarray | None = None
) -> tuple[Candidate, ...]:
    """Returns the possible motions of a photo, the one to undo first; zero with a reason if none is accepted."""
    roll_known = view.attitude_deg()[0] is not None
    limit = view.speed_limit  # the same rule for single photos and folders
    caution = MOVING if view.camera.moving or (limit is not None and limit.smeared) else CAUTION
    judgement = judge(posterior, opinion, roll_known, caution, view.camera.at_any_odds)
    modes = modes_of(posterior)

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


def _reason_against(posterior: Posterior, judgement: Judgement) -> Reason | None:
    """Returns why no motion is accepted, or None if one is."""
    if posterior.lines_gain < LEAST_GAIN:
        return Reason(Code.NO_RIGHT_ANGLES)
    return Reason(Code.TOO_FAST_FOR_HANDS) if displacement(judgement.motion) > LARGEST else None


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    size = max(displacement(one), displacement(other))
    return displacement(one - other) < max(_ALIKE, _ALIKE_SHARE * size)
