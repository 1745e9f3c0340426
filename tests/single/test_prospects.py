"""What undoing a motion would do, and what is decided by it: figures of made-up posteriors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.posteriors import posterior_of
from unshutter.single.candidates import modes_of
from unshutter.single.prior import Forest
from unshutter.single.prospects import HARM, LOST, MOVING, ExpectedBenefit, expected_benefit, features
from unshutter.single.search import Posterior, displacement

SHEAR_AND_BEND = np.array([0.08, -0.1, 0, 0, 0, 0])


def posterior(evidence: float, sigma: float = 0.004) -> Posterior:
    return posterior_of(SHEAR_AND_BEND, evidence, sigma)


def found(evidence: float, opinion: np.ndarray | None = SHEAR_AND_BEND, **known: Any) -> ExpectedBenefit:
    """What undoing the mean would do."""
    return expected_benefit(posterior(evidence), modes_of(posterior(evidence))[0], opinion, **known)


def test_strong_evidence_is_followed_and_weak_evidence_is_not() -> None:
    assert found(80).better > 0.8 and found(80).benefit > 0
    assert found(-12).better < 0.3 and found(-12).benefit < 0
    assert found(-12).better <= found(2).better + 0.1 <= found(80).better


def test_without_a_network_and_with_a_known_roll_evidence_decides() -> None:
    assert found(-12, None).better < found(80, None).better
    assert found(3, roll_known=True).benefit < 0 < found(20, roll_known=True).benefit


def test_who_says_that_the_camera_moved_is_believed() -> None:
    asked = found(-12)
    told = found(-12, shift=MOVING)
    assert told.better == pytest.approx(4 * asked.better / (1 + 3 * asked.better))


def test_size_and_error_are_of_the_motion() -> None:
    one = found(80)
    assert one.size == displacement(SHEAR_AND_BEND)
    assert 0 < one.error < one.size


def test_shear_and_turn_are_how_far_the_last_row_is_moved_and_turned() -> None:
    motion = np.array([0.08, -0.1, 0.03, 0.02, 0.05, -0.01])
    given = posterior_of(motion, 80)
    found = features(given, modes_of(given)[0], None)
    assert found["shear"] == pytest.approx(256 * 0.01)
    assert found["turn"] == pytest.approx(np.degrees(0.06))


@pytest.mark.parametrize(("better", "error"), [(0.9, 0.01), (0.5, 0.0), (0.9, 0.08)])
def test_a_benefit_is_gain_less_weighed_loss(better: float, error: float) -> None:
    one = ExpectedBenefit(better, error, 0.1)
    assert one.benefit == pytest.approx(better * (0.1 - error) - HARM * (1 - better) * LOST * 0.1)
    assert one.weighed(0) > one.benefit
    assert replace(one, error=0.2).benefit < 0  # an error beyond the motion is no gain, however probable


def test_the_forest_says_what_it_said_when_it_was_trained() -> None:
    """A node leads to the next where its figure is at most its number; leaves have no feature."""
    tree = {"feature": [[0, 1, -1, -1, -1]], "right": [[4, 3, 0, 0, 0]], "number": [[1.0, 5.0, -1.0, 2.0, 0.5]]}
    forest = Forest(("a", "b"), 0.25, 2, **{name: np.array(rows) for name, rows in tree.items()})
    cases = (1.0, 5.0, -0.75), (1.0, 5.1, 2.25), (1.1, 0.0, 0.75)
    for a, b, odds in cases:
        assert forest.of({"b": b, "a": a}) == pytest.approx(odds)
