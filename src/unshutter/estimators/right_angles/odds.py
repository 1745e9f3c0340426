"""Determines whether the camera moved at all, and the confidence of an answer.

The errors of segments on one desk or facade are correlated, so the evidence of the likelihood is overstated: the
location of the optimum is more reliable than its existence. The value of such evidence was learned from photos with
known motions and without motion (own-model.md): a forest of small decision trees on the figures of the search, and
logistic regressions for the confidence. calibration.py reads both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unshutter.estimators.right_angles.calibration import shipped
from unshutter.estimators.right_angles.posterior import PX, Posterior, bend, displacement

_STEEPNESS = 8.0  # of the transition from no motion to all of it
CAUTION = math.log(0.8)  # log odds at which half of a motion is undone; for photos in general, losses count in full
BOUNDED = math.log(0.35)  # if the photo's exposure and sharpness rule out all but small motions
MOVING = math.log(0.2)  # if the camera is known to have moved
_EVEN = 1e-9  # log odds at which motion is just more likely than none


@dataclass(frozen=True)
class Judgement:
    """The conclusion drawn from a posterior.

    Attributes:
        motion: [6] coefficients to undo; almost zero if the camera barely moved.
        confidence: probability that it is right (docs/research).
        moved: probability that there was motion worth undoing.
    """

    motion: np.ndarray
    confidence: float
    moved: float


def judge(
    posterior: Posterior,
    opinion: np.ndarray | None = None,
    roll_known: bool = False,
    caution: float = CAUTION,
    at_any_odds: bool = False,
) -> Judgement:
    """Weighs a posterior's motion against no motion.

    Args:
        posterior: posterior of the photo's segments.
        opinion: [6] the network's estimate, if it was run.
        roll_known: whether the camera's roll is known and so cannot be mistaken for shear.
        caution: log odds at which half of the motion is undone.
        at_any_odds: whether to return the whole motion, however likely it is that there was none. The confidence is
            then the motion's, which is not calibrated if the odds are against it.
    """
    in_favour = _odds_upright(posterior) if roll_known else _odds(posterior, opinion)
    odds, moved = in_favour - caution, _probability(float(np.clip(in_favour, -50, 50)))
    if at_any_odds:
        right = _probability(_right(posterior, opinion, max(odds, _EVEN)))
        return Judgement(posterior.motion, right * min(2 * _probability(max(odds, -50.0)), 1.0), moved)
    motion = posterior.motion * _probability(float(np.clip(_STEEPNESS * odds, -50, 50)))
    return Judgement(motion, _probability(_right(posterior, opinion, odds)), moved)


def figures(posterior: Posterior, opinion: np.ndarray) -> dict[str, float]:
    """Returns the features of the forest; displacements in px of 256 rows.

    Args:
        posterior: posterior of the photo's segments.
        opinion: [6] the network's estimate.
    """
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
    """Returns the features of the confidence: mostly log displacements in px of 256 rows.

    Args:
        posterior: posterior of the photo's segments.
        opinion: [6] the network's estimate, if it was run.
        odds: log odds that there was motion.
    """
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


def _odds(posterior: Posterior, opinion: np.ndarray | None) -> float:
    if opinion is None:
        return shipped().odds_without_network.log_odds({"evidence": posterior.evidence})
    return shipped().forest.odds(figures(posterior, opinion))


def _odds_upright(posterior: Posterior) -> float:
    """Returns the log odds if the camera's roll is known; without motion the evidence rarely exceeds 8 nats."""
    return 0.12 * max(posterior.evidence_of.values()) - 0.7 + CAUTION


def _right(posterior: Posterior, opinion: np.ndarray | None, odds: float) -> float:
    """Returns the log odds that the answer is right, as defined by the confidence of :class:`Motion`."""
    name = ("rectified" if odds > 0 else "left") + (" without network" if opinion is None else "")
    return shipped().confidence[name].log_odds(confidence_figures(posterior, opinion, odds))


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds))
