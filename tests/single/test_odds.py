"""Whether a posterior's motion is undone, and how far it is believed: figures of made-up posteriors."""

from typing import Any

import numpy as np
import pytest

from support.posteriors import posterior_of
from unshutter.single.candidates import MOVING, judge
from unshutter.single.prior import Forest
from unshutter.single.search import Posterior, displacement

SHEAR_AND_BEND = np.array([0.08, -0.1, 0, 0, 0, 0])


def posterior(evidence: float, sigma: float = 0.004) -> Posterior:
    return posterior_of(SHEAR_AND_BEND, evidence, sigma)


def left(evidence: float, opinion: np.ndarray | None = SHEAR_AND_BEND, **known: Any) -> float:
    """Share of the motion that is undone."""
    return displacement(judge(posterior(evidence), opinion, **known).motion) / displacement(SHEAR_AND_BEND)


def test_strong_evidence_is_followed_and_weak_evidence_is_not() -> None:
    assert left(80) == pytest.approx(1, abs=1e-3)
    assert left(-12) < 0.2
    assert left(-12) <= left(-5) <= left(2) <= left(5) < left(30)


def test_without_a_network_and_with_a_known_roll_evidence_decides() -> None:
    assert left(-12, None) < 0.02
    assert left(30, None) > 0.95
    assert left(3, roll_known=True) < 0.2 < 0.8 < left(8, roll_known=True)


def test_who_says_that_the_camera_moved_is_believed() -> None:
    weak = next(evidence for evidence in np.arange(-5, 20, 0.5) if left(evidence) > 0.05)
    assert left(weak, caution=MOVING) > 0.95


def test_confidence_falls_with_disagreement_and_with_the_expected_error() -> None:
    sure = judge(posterior(50), SHEAR_AND_BEND).confidence
    assert sure > 1.5 * judge(posterior(50), 0.5 * SHEAR_AND_BEND).confidence
    assert judge(posterior(50, 0.002)).confidence > 1.5 * judge(posterior(50, 0.02)).confidence


def test_what_clearly_stood_still_is_sure_and_what_might_have_moved_is_not() -> None:
    assert judge(posterior(-10), np.zeros(6)).confidence > 0.7 > judge(posterior(1), SHEAR_AND_BEND).confidence


def test_the_forest_says_what_it_said_when_it_was_trained() -> None:
    """A node leads to the left where its figure is at most the threshold; leaves lead to themselves."""
    tree = {"feature": [[0, 1, 0, 0, 0]], "threshold": [[1.0, 5.0, 0, 0, 0]], "left": [[1, 3, 2, 3, 4]]}
    tree |= {"right": [[2, 4, 2, 3, 4]], "value": [[0, 0, 0.5, -1.0, 2.0]]}
    forest = Forest(("a", "b"), 0.25, 2, **{name: np.array(rows) for name, rows in tree.items()})
    cases = (1.0, 5.0, -0.75), (1.0, 5.1, 2.25), (1.1, 0.0, 0.75)
    for a, b, odds in cases:
        assert forest.odds({"b": b, "a": a}) == pytest.approx(odds)
