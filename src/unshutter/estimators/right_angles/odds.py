"""Whether the camera moved at all, and how far an answer is to be believed.

Segments of one desk or facade repeat each other's errors, so that the evidence of the likelihood is overstated: where
the optimum lies is right more often than whether there is one. How much such evidence is worth was learned from photos
with known motions and without any (docs/own-model.md): logistic regressions on a handful of figures that the search
has anyway. They stand here with their numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unshutter.estimators.right_angles.search import Posterior, bend, displacement

_STEEPNESS = 8.0  # of the way from no motion to all of it
_CAUTION = math.log(1.9)  # how much better than even the odds must be: most photos have no motion to speak of
_MOVING = math.log(0.4)  # and where the user says that the camera was
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
    posterior: Posterior, opinion: np.ndarray | None = None, roll_known: bool = False, moving: bool = False
) -> Judgement:
    """Weighs a posterior's motion against none.

    Args:
        posterior: of the photo's segments.
        opinion: [6] the network's answer, where it was asked.
        roll_known: whether the camera's roll is known, and so cannot be taken for shear.
        moving: whether the camera is known to have moved: from a train, a car, a drone.
    """
    if roll_known:
        odds = _odds_upright(posterior)
    else:
        odds = _odds_alone(posterior) if opinion is None else _odds_beside(posterior, opinion)
    if opinion is not None or roll_known:
        odds -= _MOVING if moving else _CAUTION
    motion = posterior.motion / (1 + math.exp(-np.clip(_STEEPNESS * odds, -50, 50)))
    return Judgement(motion, _probability(_right(posterior, opinion, odds)))


def _odds_beside(posterior: Posterior, opinion: np.ndarray) -> float:
    """Logarithm of the odds that undoing the motion is better than leaving it, with a network's answer beside it."""
    return (
        -1.2179
        + 0.0094 * posterior.evidence
        + 0.4396 * _log(posterior.evidence)
        + 0.4161 * posterior.lines_gain
        + 0.2150 * _log(_PX * bend(opinion))
        + 0.2404 * _log(_PX * displacement(opinion))
        - 0.8728 * _log(_PX * displacement(opinion - posterior.motion))
    )


def _odds_alone(posterior: Posterior) -> float:
    """The same without one: the evidence at a quarter of what it says, less two nats, which is caution enough."""
    return (0.25 * posterior.evidence - 2) / _STEEPNESS


def _odds_upright(posterior: Posterior) -> float:
    """The same where the camera's roll is known: the evidence of photos without motion hardly ever exceeds 8 nats."""
    return 0.12 * posterior.evidence - 0.06


def _right(posterior: Posterior, opinion: np.ndarray | None, odds: float) -> float:
    """Logarithm of the odds that the answer is right to 1 px of 256 rows."""
    odds = min(max(odds, -4.0), 6.0)
    if opinion is None:
        error = math.log(_PX * posterior.expected_error + 0.1)
        return -1.626 - 1.512 * error + 0.266 * odds if odds > 0 else -0.845 - 0.835 * error - 9.461 * odds
    answer = _PX * displacement(opinion)
    if odds <= 0:
        return -0.216 - 0.376 * math.log(answer + 0.3) - 0.714 * odds
    apart = _PX * displacement(opinion - posterior.motion)
    return (
        -6.961
        - 0.696 * math.log(apart / math.hypot(1, answer / 25) + 0.3)  # the larger its answer, the more it errs
        - 0.498 * math.log(_PX * posterior.size + 0.3)
        + 0.146 * posterior.lines_gain
        + 1.557 * math.log(posterior.weight)
    )


def _log(figure: float) -> float:
    """Grows with a figure and keeps its sign, but slowly."""
    return math.copysign(math.log1p(abs(figure)), figure)


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds))
