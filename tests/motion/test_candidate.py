"""Candidates in words and as JSON."""

import json

import numpy as np
import pytest

import unshutter
from unshutter import Candidate, Motion, RowMotion
from unshutter.motion.verdict import alone


def pan(tx_px: float, rows: int = 100) -> RowMotion:
    return RowMotion(80, np.linspace(0, tx_px, rows), np.zeros(rows))


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
    assert Candidate("still", RowMotion.zero(100, 80)).description == "as it is"


def test_json_holds_a_motion_that_can_be_read_back() -> None:
    data = json.loads(json.dumps(Candidate("pan", pan(24), 0.123456, 1.23456).as_json()))
    assert (data["kind"], data["probability"], data["expected_error_px"]) == ("pan", 0.1235, 1.23)
    assert Motion.from_json(json.dumps(data["motion"])) == pan(24)


def test_a_candidate_is_resized_with_its_error() -> None:
    half = Candidate("pan", pan(24), 0.5, 4.0).resized(50, 40)
    assert half.expected_error_px == 2.0
    assert half.motion.largest_px == pytest.approx(12, rel=0.03)


def test_a_method_that_finds_one_motion_has_two_candidates() -> None:
    assert [each.kind for each in alone(pan(24))] == ["other", "still"]
    assert [each.kind for each in alone(RowMotion.zero(9, 9))] == ["still"]


def test_the_shares_of_the_kinds_are_kept_in_motion_files() -> None:
    motion = RowMotion(80, np.zeros(9), np.zeros(9), kind_shares=(("hand", 0.75), ("pan", 0.25)))
    assert json.loads(motion.to_json())["kinds"] == {"hand": 0.75, "pan": 0.25}
    assert Motion.from_json(motion.to_json()) == motion


def test_a_rectified_photo_has_its_candidates(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, _ = basilica
    listed = unshutter.candidates(picture)
    result = unshutter.rectify(picture)
    assert [each.kind for each in result.candidates] == [each.kind for each in listed]
    assert listed[0].motion == unshutter.estimate(picture)
    assert sum(each.kind == "still" for each in listed) == 1
    assert unshutter.rectify(picture, motion=listed[0].motion).candidates == ()
