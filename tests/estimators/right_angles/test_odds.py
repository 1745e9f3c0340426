"""Whether a posterior's motion is undone, and how far it is believed: figures of made-up posteriors."""

import numpy as np
import pytest

from unshutter.estimators.right_angles.odds import judge
from unshutter.estimators.right_angles.search import Posterior, displacement

SHEAR_AND_BEND = np.array([0.08, -0.1, 0, 0, 0, 0])


def posterior(evidence: float, sigma: float = 0.004) -> Posterior:
    return Posterior(SHEAR_AND_BEND, np.eye(6) * sigma**2, evidence, 1.0, 60.0)


def left(evidence: float, opinion: np.ndarray | None = SHEAR_AND_BEND, **known: bool) -> float:
    """Share of the motion that is undone."""
    return displacement(judge(posterior(evidence), opinion, **known).motion) / displacement(SHEAR_AND_BEND)


def test_strong_evidence_is_followed_and_weak_evidence_is_not() -> None:
    assert left(80) == pytest.approx(1, abs=1e-3)
    assert left(-5) < 1e-3
    assert left(-5) < left(2) < left(5) < left(20)


def test_evidence_is_believed_less_where_the_network_says_something_else() -> None:
    assert left(10) > 0.9
    assert left(10, -SHEAR_AND_BEND) < 0.01


def test_without_a_network_and_with_a_known_roll_evidence_decides() -> None:
    assert left(-12, None) < 0.01
    assert left(30, None) > 0.95
    assert left(3, roll_known=True) < 0.2 < 0.8 < left(8, roll_known=True)


def test_who_says_that_the_camera_moved_is_believed() -> None:
    weak = next(evidence for evidence in np.arange(-5, 20, 0.5) if left(evidence) > 0.05)
    assert left(weak, moving=True) > 0.95


def test_confidence_falls_with_disagreement_and_with_the_expected_error() -> None:
    sure = judge(posterior(50), SHEAR_AND_BEND).confidence
    assert sure > 1.5 * judge(posterior(50), 0.5 * SHEAR_AND_BEND).confidence
    assert judge(posterior(50, 0.002)).confidence > 1.5 * judge(posterior(50, 0.02)).confidence


def test_what_clearly_stood_still_is_sure_and_what_might_have_moved_is_not() -> None:
    assert judge(posterior(-10), np.zeros(6)).confidence > 0.85 > judge(posterior(1), SHEAR_AND_BEND).confidence
