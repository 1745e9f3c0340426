"""Which motions are undone, and what is said of the others."""

import re
from dataclasses import replace

import numpy as np
import pytest

from unshutter.errors import UsageError
from unshutter.motion import RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import Certainty, judge
from unshutter.options import Rectify, Undo
from unshutter.reasons import Cause, Code, Reason
from unshutter.run.report import about


def sheared(px: float, confidence: float | None = None, height: int = 80) -> Finding:
    return Finding(RowMotion.from_polynomials([0, px], [0], height, 100), confidence=confidence)


@pytest.mark.parametrize(
    ("found", "least", "cause", "told"),
    [
        (sheared(41.2, 0.936), 0.5, "", "points moved by up to 41 px, confidence 0.93: likely"),
        (sheared(4.2, 0.5), 0.5, "", "points moved by up to 4.2 px, confidence 0.50: tentative"),
        (sheared(4.2), 1.0, "", "points moved by up to 4.2 px"),
        (sheared(4.2, 0.0), 0.0, "", "points moved by up to 4.2 px, confidence 0.00: doubtful"),
        (sheared(0.51, 1.0), 0.5, "", "points moved by up to 0.5 px, confidence 0.97: sure"),
        (
            sheared(124, 0.36),
            0.5,
            "not sure",
            "not sure enough: it would help with a probability of 0.36; "
            "--min-confidence 0.3 would move it by up to 124 px",
        ),
        (
            sheared(12, 0.4999),
            0.5,
            "not sure",
            "not sure enough: it would help with a probability of 0.49; "
            "--min-confidence 0.4 would move it by up to 12 px",
        ),
        (
            sheared(12, 0.049),
            0.5,
            "not sure",
            "not sure enough: it would help with a probability of 0.04; "
            "--min-confidence 0 would move it by up to 12 px",
        ),
        (sheared(0.49), 0.5, "less than half a pixel", None),
        (sheared(0.49, 0.1), 0.0, "less than half a pixel", None),
        (sheared(0.49, 0.314), 0.5, "no motion", "no visible motion"),
        (
            replace(sheared(0.0, 0.7), reason=Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=0.7)),
            0.5,
            "not sure",
            "not sure whether the camera moved: leaving the photo is right with a probability of 0.70; "
            "--moving says that it did",
        ),
        (
            replace(sheared(9.0, 0.93), expected_error=0.026),
            0.5,
            "",
            "points moved by up to 9.0 px, confidence 0.93: likely, typically off by 2.1 px",
        ),
        (
            replace(sheared(1.0, 0.93), expected_error=0.2),
            0.5,
            "",
            "points moved by no more than the typical error of 16 px, confidence 0.93: likely",
        ),
        (sheared(1.9, 0.9, 512), 0.5, "no motion", None),
        (sheared(2.1, 0.9, 512), 0.5, "", None),
        (sheared(1.9, None, 512), 0.5, "", None),
        (sheared(0.0, 0.9), 0.5, "no motion", "no motion"),
        (replace(sheared(0.0), reason=Reason.stated("too few lines")), 0.5, "nothing to go by", "too few lines"),
    ],
)
def test_what_is_undone_and_what_is_said(found: Finding, least: float, cause: str, told: str | None) -> None:
    verdict = judge(found, Undo(min_confidence=least))
    assert verdict.cause == (cause or None)
    assert verdict.changes == (not cause) == (verdict.reason is None) == (not verdict.sentence)
    assert told in (None, about(verdict))
    assert verdict.as_json()["changed"] == verdict.changes


@pytest.mark.parametrize(
    ("strength", "said", "left_px"),
    [
        (1, "typically off by 2.1 px", None),
        (0.5, "up to 20 px left on purpose", 20.0),
        (1.5, "up to 20 px more than was found, on purpose", -20.0),
    ],
)
def test_a_strength_says_what_it_leaves_instead_of_the_error_of_all(strength: float, said: str, left_px) -> None:
    found = replace(sheared(40.0, 0.93), expected_error=0.026)
    verdict = judge(found, Undo(strength=strength))
    assert verdict.described() == f"points moved by up to {40 * strength:.0f} px, confidence 0.93: likely, {said}"
    assert verdict.as_json().get("left_px") == left_px
    assert ("expected_error_px" in verdict.as_json()) == (strength == 1)


@pytest.mark.parametrize("code", [Code.HARDLY_HELPS, Code.UNSURE_HOW_MOVED, Code.MOVED_TOO_LITTLE, Code.UNSURE])
def test_what_is_advised_where_a_motion_is_hardly_measurable_undoes_it(code: Code) -> None:
    """1.5 px of 600 rows: any least confidence but 0 calls that no visible motion."""
    found = sheared(1.5, 0.6, 600)
    reason = Reason.of(code, confidence=0.6, px=1.5)
    told = about(judge(replace(found, motion=found.motion.scaled(0), reason=reason), Undo()))
    within_error = code in (Code.HARDLY_HELPS, Code.MOVED_TOO_LITTLE)
    how = "undo it all the same" if within_error else "move it by up to 1.5 px"
    assert told.endswith(f"; --min-confidence 0 would {how}") and "0.0 px" not in told
    assert judge(found, Undo(min_confidence=0)).changes


def test_what_is_said_to_be_enough_is_enough() -> None:
    verdict = judge(sheared(124, 0.36), Undo(min_confidence=0.5))
    enough = float(about(verdict).partition("--min-confidence ")[2].split()[0])
    assert judge(sheared(124, 0.36), Undo(min_confidence=enough)).changes


def test_no_strength_changes_nothing_and_says_so() -> None:
    verdict = judge(Finding(sheared(30).motion.scaled(0), confidence=0.9), Undo(strength=0))
    assert (verdict.cause, verdict.sentence) == (Cause.STRENGTH_0, "a strength of 0 undoes nothing")


def test_what_is_left_alone_is_written_as_no_motion_with_the_reason() -> None:
    left = judge(sheared(124, 0.36), Undo(min_confidence=0.5)).carried_out
    assert left.motion.is_zero and left.motion.width == 100
    assert (left.confidence, left.reason) == (0.36, Reason.of(Code.UNSURE, confidence=0.36, px=124.0))


def test_the_largest_displacement_counts_turns_at_the_sides() -> None:
    assert sheared(7).motion.largest_px == pytest.approx(7)
    turned = RowMotion(101, np.zeros(51), np.r_[np.zeros(50), 0.1])  # the last row, 25 px below the middle
    # a turn by a of a point at distance r moves it by 2 r sin(a / 2)
    assert turned.largest_px == pytest.approx(2 * np.hypot(50, 25) * np.sin(0.05))
    tilted = RotationMotion(width=101, rotations=np.r_[np.zeros((50, 3)), [[0.01, 0, 0]]], focal_px=100.0)
    assert tilted.tx_px.max() == pytest.approx(0)
    assert tilted.largest_px > 0.9  # up or down, which t_x does not tell


def test_a_given_motion_is_undone_however_sure() -> None:
    assert Rectify(motion="m.json").settled().undo.min_confidence == 0  # pyright: ignore[reportArgumentType]
    assert Rectify().undo.min_confidence is None
    with pytest.raises(UsageError, match="leave out --min-confidence"):
        Undo(min_confidence=0.7).at_any_confidence()


@pytest.mark.parametrize("wrong", [-0.1, 1.1, float("nan")])
def test_a_confidence_that_cannot_be(wrong: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 1"):
        Undo(min_confidence=wrong)


@pytest.mark.parametrize(
    ("tx_px", "confidence", "certainty", "look"),
    [
        (90, 0.95, "sure", False),
        (90, 0.94, "likely", False),
        (90, 0.79, "tentative", True),
        (6, 0.5, "tentative", False),
    ],
)
def test_a_large_motion_that_is_unsure_asks_for_a_look(
    tx_px: float, confidence: float, certainty: str, look: bool
) -> None:
    verdict = judge(sheared(tx_px, confidence), Undo())
    assert (verdict.certainty, verdict.needs_a_look) == (certainty, look)
    assert ("please look" in verdict.described()) == look
    assert (verdict.as_json()["certainty"], verdict.as_json()["please_look"]) == (certainty, look)


@pytest.mark.parametrize("percent", range(101))
def test_the_word_predicts_the_decision(percent: int) -> None:
    """By default, what is changed is sure, likely or tentative; what is left has a reason and none of these words."""
    verdict = judge(sheared(30, percent / 100), Undo())
    said = set(re.findall(r"\w+", verdict.described().replace("not sure", "")))
    if verdict.changes:
        assert verdict.certainty in (Certainty.SURE, Certainty.LIKELY, Certainty.TENTATIVE)
        assert said & set(Certainty) == {verdict.certainty}
    else:
        assert Certainty.of(percent / 100) is Certainty.DOUBTFUL
        assert verdict.certainty is None and not said & {*Certainty, "confidence"}
    assert judge(sheared(30, percent / 100), Undo(min_confidence=0)).certainty is Certainty.of(min(percent, 97) / 100)
