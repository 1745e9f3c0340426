"""Whether the camera moved at all, and how far an answer is to be believed.

Segments of one desk or facade repeat each other's errors, so that the evidence of the likelihood is overstated: where
the optimum lies is right more often than whether there is one. How much such evidence is worth was learned from photos
with known motions and without any (docs/own-model.md): a forest of small decision trees on nineteen figures of the
search (weights/odds.json), and logistic regressions for the confidence, which stand here with their numbers.
benchmarks/fit_odds.py fits both.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from unshutter.estimators.right_angles.search import Posterior, bend, displacement

_FOREST = Path(__file__).parents[2] / "weights" / "odds.json"
_STEEPNESS = 8.0  # of the way from no motion to all of it
_CAUTION = math.log(0.8)  # odds at which half of a motion is undone; those of photos in general count losses in full
_MOVING = math.log(0.2)  # and where the camera is known to have moved
_EVEN = 1e-9  # odds at which a motion is just as likely as none
_PX = 256.0  # rows of the picture in which displacements are weighed


@dataclass(frozen=True)
class Judgement:
    """What is made of a posterior.

    Attributes:
        motion: [6] coefficients to undo; next to nothing where the camera hardly moved.
        confidence: probability that it is right to 1 px of 256 rows (mean displacement).
    """

    motion: np.ndarray
    confidence: float


def judge(
    posterior: Posterior,
    opinion: np.ndarray | None = None,
    roll_known: bool = False,
    moving: bool = False,
    at_any_odds: bool = False,
) -> Judgement:
    """Weighs a posterior's motion against none.

    Args:
        posterior: of the photo's segments.
        opinion: [6] the network's answer, where it was asked.
        roll_known: whether the camera's roll is known, and so cannot be taken for shear.
        moving: whether the camera is known to have moved: from a train, a car, a drone.
        at_any_odds: whether all of the motion is wanted, however likely it is that there was none. The confidence is
            then the motion's, which is not calibrated where the odds are against it.
    """
    if roll_known:
        odds = _odds_upright(posterior)
    else:
        odds = _odds_alone(posterior) if opinion is None else _forest().odds(figures(posterior, opinion)) - _CAUTION
    odds += _CAUTION - _MOVING if moving else 0.0
    if at_any_odds:
        right = _probability(_right(posterior, opinion, max(odds, _EVEN)))
        return Judgement(posterior.motion, right * min(2 * _probability(max(odds, -50.0)), 1.0))
    motion = posterior.motion / (1 + math.exp(-np.clip(_STEEPNESS * odds, -50, 50)))
    return Judgement(motion, _probability(_right(posterior, opinion, odds)))


def figures(posterior: Posterior, opinion: np.ndarray) -> dict[str, float]:
    """What the forest looks at; displacements in px of 256 rows.

    Args:
        posterior: of the photo's segments.
        opinion: [6] the network's answer.
    """
    return {
        "evidence": posterior.evidence,
        "lines_gain": posterior.lines_gain,
        "gain_at_rest": posterior.gain_at_rest,
        "weight": posterior.weight,
        "answer_bend": _PX * bend(opinion),
        "answer_size": _PX * displacement(opinion),
        "disagreement": _PX * displacement(opinion - posterior.motion),
        "error": _PX * posterior.expected_error,
        "size": _PX * posterior.size,
        "bend": _PX * bend(posterior.motion),
        "breadth": posterior.breadth,
        "against": posterior.against,
        "in_favour": posterior.in_favour,
        "roll": abs(math.degrees(posterior.pose.roll)),
        "roll_at_rest": abs(math.degrees(posterior.pose_at_rest.roll)),
        "tilt": math.degrees(posterior.pose.tilt),
        "tilt_at_rest": math.degrees(posterior.pose_at_rest.tilt),
        "focal": posterior.pose.log_focal,
        "focal_at_rest": posterior.pose_at_rest.log_focal,
    }


@dataclass(frozen=True)
class Forest:
    """Gradient-boosted decision trees, all of the same size: their leaves' values add up to the logarithm of odds.

    Attributes:
        features: names of the figures that nodes ask for.
        baseline: what the leaves' values are added to.
        depth: steps from a root to its farthest leaf.
        feature, threshold, left, right, value: [trees, nodes]: a node leads to ``left`` where its figure is at most the
            threshold, else to ``right``; a leaf leads to itself and has a value.
    """

    features: tuple[str, ...]
    baseline: float
    depth: int
    feature: np.ndarray
    threshold: np.ndarray
    left: np.ndarray
    right: np.ndarray
    value: np.ndarray

    def odds(self, figures: dict[str, float]) -> float:
        """Logarithm of the odds that undoing the motion is better than leaving it."""
        given = np.array([figures[name] for name in self.features])
        tree, node = np.arange(len(self.value)), np.zeros(len(self.value), int)
        for _ in range(self.depth):
            below = given[self.feature[tree, node]] <= self.threshold[tree, node]
            node = np.where(below, self.left[tree, node], self.right[tree, node])
        return self.baseline + float(self.value[tree, node].sum())


@cache
def _forest() -> Forest:
    data = json.loads(_FOREST.read_text(encoding="utf-8"))
    arrays = {name: np.array(data[name]) for name in ("feature", "threshold", "left", "right", "value")}
    return Forest(tuple(data["features"]), data["baseline"], data["depth"], **arrays)


def _odds_alone(posterior: Posterior) -> float:
    """The same without a network: the evidence at a quarter of what it says, less two nats."""
    return (0.25 * posterior.evidence - 2) / _STEEPNESS


def _odds_upright(posterior: Posterior) -> float:
    """The same where the camera's roll is known: the evidence of photos without motion hardly ever exceeds 8 nats."""
    return 0.12 * posterior.evidence - 0.7


def _right(posterior: Posterior, opinion: np.ndarray | None, odds: float) -> float:
    """Logarithm of the odds that the answer is right to 1 px of 256 rows."""
    odds = min(max(odds, -4.0), 6.0)
    error = _PX * posterior.expected_error
    if opinion is None:
        error = math.log(error + 0.1)
        return -1.626 - 1.512 * error + 0.266 * odds if odds > 0 else -0.845 - 0.835 * error - 9.461 * odds
    answer = _PX * displacement(opinion)
    if odds <= 0:
        return 0.459 - 0.240 * math.log(answer + 0.3) - 0.638 * math.log(error + 0.1) - 0.722 * odds
    apart = _PX * displacement(opinion - posterior.motion)
    return (
        -6.250
        - 0.606 * math.log(apart / math.hypot(1, answer / 25) + 0.3)  # the larger its answer, the more it errs
        - 0.236 * math.log(_PX * posterior.size + 0.3)
        + 0.056 * posterior.lines_gain
        + 1.085 * math.log(posterior.weight)
        + 0.318 * odds
    )


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds))
