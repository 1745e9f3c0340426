"""Candidates in words and as JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

import unshutter
from unshutter import Candidate, Motion, RowMotion, UsageError
from unshutter.motion.finding import Finding, list_single
from unshutter.motion.verdict import judge
from unshutter.options import Undo
from unshutter.reasons import Code, Reason


def pan(tx_px: float, error_px: float | None = None, rows: int = 100) -> Finding:
    error = None if error_px is None else error_px / rows
    return Finding(RowMotion(80, np.linspace(0, tx_px, rows), np.zeros(rows)), expected_error=error)


STILL = Finding(RowMotion.zero(100, 80))


@pytest.mark.parametrize(
    ("orientation", "tx_px", "words"),
    [
        (1, 24, "pan to the left, 24 px"),  # the scene goes to the right
        (1, -24, "pan to the right, 24 px"),
        (3, 24, "pan to the right, 24 px"),  # stored upside down
        (6, 24, "pan upwards, 24 px"),  # stored with the scene's top on its left: the scene goes down
        (8, 24, "pan downwards, 24 px"),
    ],
)
def test_a_pan_says_where_the_camera_turned_as_the_photo_is_seen(orientation: int, tx_px: float, words: str) -> None:
    assert Candidate("pan", pan(tx_px), orientation=orientation).description == words


def test_other_kinds_say_how_far_pixels_move() -> None:
    assert Candidate("hand", pan(9)).description == "hand, 9.0 px"
    assert Candidate("still", STILL).description == "as it is"


def test_json_holds_a_motion_that_can_be_read_back() -> None:
    data = json.loads(json.dumps(Candidate("pan", pan(24, 1.23456), 0.123456).as_json()))
    assert (data["kind"], data["probability"], data["expected_error_px"]) == ("pan", 0.1235, 1.23)
    assert Finding.from_json(json.dumps(data["motion"])).motion == pan(24).motion


def test_a_candidate_is_resized_with_its_error() -> None:
    half = Candidate("pan", pan(24, 4.0), 0.5).resized(50, 40)
    assert half.expected_error_px == pytest.approx(2.0)
    assert half.motion.largest_px == pytest.approx(12, rel=0.03)


def test_each_number_says_what_it_is_the_chance_of() -> None:
    assert Candidate("hand", pan(9, 3.1), 0.62).described() == (
        "hand, 9.0 px (helps with a probability of 0.62, typically off by 3.1 px)"
    )
    within = Candidate("hand", pan(1.0, 17), 0.62)
    assert within.described() == "hand (helps with a probability of 0.62, no larger than its typical error of 17 px)"
    still = Candidate("still", STILL, 0.38)
    assert still.described() == "as it is (right with a probability of 0.38)"


@pytest.mark.parametrize(("found", "stated"), [(0.7893, 0.78), (0.999, 0.97), (0.78, 0.78), (0.0, 0.0)])
def test_one_number_is_the_same_wherever_it_is_stated(found: float, stated: float) -> None:
    finding = replace(pan(9), confidence=found, reason=Reason.of(Code.UNSURE, confidence=found, px=9))
    candidate = Candidate("hand", finding, found).as_stated()
    numbers = candidate.probability, candidate.finding.confidence, candidate.as_json()["probability"]
    assert numbers == (stated,) * 3
    assert f"{stated:.2f}" in candidate.described() and f"{stated:.2f}" in str(candidate.finding.reason)
    assert judge(finding, Undo()).confidence == stated  # of a motion from elsewhere


def test_that_nothing_helps_is_never_ruled_out() -> None:
    assert Candidate("still", STILL, 0.001).as_stated().probability == 0.03


def test_all_candidates_are_listed_or_one_is_chosen(basilica: tuple[np.ndarray, Motion]) -> None:
    with pytest.raises(UsageError, match="leave out candidate"):
        unshutter.candidates(basilica[0], candidate=99)


def test_a_method_that_finds_one_motion_has_two_candidates() -> None:
    assert [each.kind for each in list_single(pan(24))] == ["other", "still"]
    assert [each.kind for each in list_single(STILL)] == ["still"]


def test_the_shares_of_the_kinds_are_kept_in_motion_files() -> None:
    finding = replace(STILL, kind_shares=(("hand", 0.75), ("pan", 0.25)))
    assert json.loads(finding.to_json())["kinds"] == {"hand": 0.75, "pan": 0.25}
    assert Finding.from_json(finding.to_json()) == finding


def test_a_rectified_photo_has_its_candidates(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, _ = basilica
    listed = unshutter.candidates(picture)
    result = unshutter.rectify(picture)
    assert [each.kind for each in result.candidates] == [each.kind for each in listed]
    assert replace(listed[0].finding, candidates=listed) == unshutter.estimate(picture)
    assert sum(each.kind == "still" for each in listed) == 1
    assert unshutter.rectify(picture, motion=listed[0].motion).candidates == ()
