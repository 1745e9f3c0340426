"""The expected benefit of undoing a motion: the probability that it helps, and the error that remains.

The errors of segments on one desk or facade are correlated, so the evidence of the likelihood is overstated: the
location of the optimum is more reliable than its existence. What such evidence is worth was therefore learned from
photos with known motions and without motion, whole and cropped (docs/research/own-model-calibration.md): one forest of
small decision trees gives the probability that the result is closer to the truth than the photo is, another the error
that remains if it is. Both read the figures of the search and of the motion in question.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.options import MIN_CONFIDENCE
from unshutter.single.prior import shipped
from unshutter.single.search import PX, bend, displacement

if TYPE_CHECKING:
    import numpy as np

    from unshutter.motion.finding import KindOfMotion
    from unshutter.single.prior import BenefitCalibration
    from unshutter.single.search import Posterior

HARM = 1.0  # a pixel lost counts as this many gained (docs/research/own-model-calibration.md shows other values)
LOST = 0.83  # of a motion: what undoing it costs where it harms (median of the calibration)
MOVING = math.log(4)  # added to the log odds if the camera moved by its smears, or its user: then four in five do
# most that is stated of a photo decided again in view of its folder: of such photos, .61 of 31, .74 of 39 and .85 of
# 100 came closer to the truth, whatever they stated (docs/research/own-model-folders.md)
MOST_IN_FOLDER = 0.7
# most that is stated of a photo that shows no motion: whatever such photos state, it barely tells those that moved
# unseen from the others (docs/research/own-model-attempts.md)
MOST_AT_REST = 0.9
FAINT_PX = 0.1  # of 256 rows: added to errors before their logarithm is taken
_MOST = 50.0  # log odds


@dataclass(frozen=True, eq=False)
class Mode:
    """A candidate motion of the posterior."""

    motion: np.ndarray  # [6] coefficients
    error: float  # expected displacement if it is of the right kind [rows]
    share: float  # its posterior probability, given that the camera moved
    kind: KindOfMotion = "other"


@dataclass(frozen=True)
class ExpectedBenefit:
    """The expected benefit of undoing a motion."""

    better: float  # probability that the result is closer to the truth than the photo
    error: float  # expected mean displacement that remains if it is [rows]
    size: float  # mean displacement by the motion [rows]

    @property
    def log_odds(self) -> float:
        """Log odds that the result is closer to the truth than the photo."""
        return _log_odds(self.better)

    @property
    def decision_threshold(self) -> float:
        """Number to add to the log odds for the motion to be worth undoing; a large number if it never is."""
        lost = HARM * LOST * self.size
        gained = self.size - self.error
        needed = max(lost / (lost + gained), MIN_CONFIDENCE) if gained > 0 else 1.0
        return _log_odds(needed) - self.log_odds if needed < 1 else 2 * _MOST

    @property
    def benefit(self) -> float:
        """Expected gain [rows], with losses weighed by :data:`HARM`; a motion is worth undoing if this is positive."""
        return self.weighed(HARM)

    def weighed(self, harm: float) -> float:
        """Returns the expected gain with another weight of losses, in the unit of error and size."""
        return self.better * max(self.size - self.error, 0.0) - harm * (1 - self.better) * LOST * self.size


def expected_benefit(
    posterior: Posterior, mode: Mode, network_motion: np.ndarray | None, roll_known: bool = False, shift: float = 0.0
) -> ExpectedBenefit:
    """Returns the expected benefit of undoing a motion, if half of all cameras moved.

    Args:
        network_motion: [6] the network's estimate; None if it was not asked.
        roll_known: whether the camera's roll is known and so cannot be mistaken for shear.
        shift: added to the log odds, for photos of which more or fewer moved.
    """
    size = displacement(mode.motion)
    known = calibration_of(network_motion is not None)
    asked = features(posterior, mode, network_motion)
    error = max(math.exp(known.error.of(asked)) - FAINT_PX, 0.0) / PX
    if roll_known:  # fitted to 137 photos with known attitudes, moved and still
        better = _probability(0.147 * max(posterior.evidence_of.values()) - 0.742 + shift) * mode.share
    else:
        better = _probability(known.better.of(asked) + shift)
    return ExpectedBenefit(better, error, size)


def calibration_of(with_network: bool) -> BenefitCalibration:
    """Returns the calibration for searches with or without the network's estimate."""
    return shipped().with_network if with_network else shipped().without_network


def features(posterior: Posterior, mode: Mode, network_motion: np.ndarray | None) -> dict[str, float]:
    """Returns the features of the forests by name; displacements in px of 256 rows, angles in degrees."""
    (roll, tilt, focal, _), (roll_at_rest, tilt_at_rest, focal_at_rest, _) = posterior.pose, posterior.pose_at_rest
    found = {
        "evidence": posterior.evidence,
        "lines_gain": posterior.lines_gain,
        "gain_at_rest": posterior.gain_at_rest,
        "weight": posterior.weight,
        "error": PX * posterior.expected_error,
        "size": PX * posterior.size,
        "bend": PX * bend(posterior.motion),
        "breadth": posterior.breadth,
        "against": posterior.against,
        "in_favour": posterior.in_favour,
        "roll": abs(math.degrees(roll)),
        "roll_at_rest": abs(math.degrees(roll_at_rest)),
        "tilt": math.degrees(tilt),
        "tilt_at_rest": math.degrees(tilt_at_rest),
        "focal": focal,
        "focal_at_rest": focal_at_rest,
        **{f"evidence for {kind}": evidence for kind, evidence in posterior.evidence_of.items()},
        **{f"share of {kind}": share for kind, share in posterior.kinds.items()},
        "own_size": PX * displacement(mode.motion),
        "own_bend": PX * bend(mode.motion),
        "own_share": mode.share,
        "own_error": PX * mode.error,
        "to_mean": PX * displacement(mode.motion - posterior.motion),
        "shear": PX * abs(float(mode.motion[:3].sum())),
        "turn": math.degrees(abs(float(mode.motion[3:].sum()))),
    }
    if network_motion is None:
        return found
    return found | {
        "answer_bend": PX * bend(network_motion),
        "answer_size": PX * displacement(network_motion),
        "disagreement": PX * displacement(network_motion - posterior.motion),
        "to_answer": PX * displacement(mode.motion - network_motion),
    }


def _log_odds(probability: float) -> float:
    least = math.exp(-_MOST)
    return math.log(max(probability, least)) - math.log(max(1 - probability, least))


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-min(max(log_odds, -_MOST), _MOST)))
