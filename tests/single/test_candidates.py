"""The motion to undo and the other candidates, of posteriors that are made up."""

from dataclasses import replace

import numpy as np
import pytest

from support.posteriors import posterior_of
from unshutter import RowMotion, View
from unshutter.motion.verdict import judge, reason_to_leave
from unshutter.options import Camera, DecisionOptions, Moving, Undo
from unshutter.photo import Photo
from unshutter.reasons import Code, Reason
from unshutter.single.candidates import candidates_of, modes_of
from unshutter.single.prospects import MOST_AT_REST
from unshutter.single.search import Optima, Posterior, displacement

PAN, SHAKE = np.array([0.1, 0, 0, 0, 0, 0]), np.array([-0.05, 0.02, 0, 0.01, 0, 0])


@pytest.fixture
def view(facade: np.ndarray) -> View:
    return View(Photo.from_array(facade))


def anyway(view: View) -> View:
    """Of somebody who wants the likeliest motion, however unsure."""
    return View(view.photo, decision=DecisionOptions(least_confidence=0))


def two_modes(evidence: float, share: float = 0.7) -> Posterior:
    """Two optima close to each other for a pan to the left, and one for shake."""
    shares = np.array([0.6 * share, 0.4 * share, 1 - share])
    motions = np.stack([PAN, 1.01 * PAN, SHAKE])
    optima = Optima(motions, np.tile(np.eye(6) * 1e-6, (3, 1, 1)), np.array([1, 1, 0]), shares)
    kinds = {"hand": 1 - share, "pan": share, "quadratic": 0.0}
    return replace(posterior_of(shares @ motions, evidence), optima=optima, kinds=kinds)


@pytest.mark.parametrize(
    ("tx", "gain", "reason"), [(0.05, -0.5, "no right angles"), (0.5, 1.0, "more motion than a hand-held camera makes")]
)
def test_what_is_not_to_be_believed_is_no_motion(tx: float, gain: float, reason: str, view: View) -> None:
    found = candidates_of(posterior_of(tx * PAN / 0.1, 1e3, 1e-3, gain), view, "me")[0].finding
    assert (found.motion.is_zero, found.estimator) == (True, "me")
    assert reason in str(found.reason)


def test_optima_that_look_the_same_are_one_mode() -> None:
    mean, first, second = modes_of(two_modes(50))
    assert (mean.kind, first.kind, second.kind) == ("pan", "pan", "hand")
    assert (mean.share, first.share, second.share) == pytest.approx((1, 0.7, 0.3))
    np.testing.assert_allclose(first.motion, 1.004 * PAN)


def test_the_first_candidate_is_what_is_undone_and_one_is_the_photo_as_it_is(view: View) -> None:
    moved = candidates_of(two_modes(80), anyway(view), "me", PAN)
    assert sorted(each.kind for each in moved[:3]) == ["hand", "pan", "pan"]  # the mean, and what it is the mean of
    assert [each.probability for each in moved[:3]] == sorted((each.probability for each in moved[:3]), reverse=True)
    assert dict(moved[0].finding.kind_shares) == {"hand": pytest.approx(0.3), "pan": pytest.approx(0.7), "quadratic": 0}
    assert moved[-1].description == "as it is"
    assert moved[-1].probability == pytest.approx(1 - max(each.probability for each in moved[:-1]))
    assert all(each.probability == each.finding.confidence for each in moved[:-1])
    stood = candidates_of(two_modes(-20), view, "me", PAN)
    assert stood[0].kind == "still" and "still" not in [each.kind for each in stood[1:]]
    assert stood[0].probability > 0.7 > moved[-1].probability
    assert stood[0].finding.reason == Reason(Code.NO_VISIBLE_MOTION)


def test_that_nothing_moved_is_never_said_to_be_sure(view: View) -> None:
    still, moving = candidates_of(posterior_of(0.02 * PAN, -20), view, "me")
    assert moving.probability is not None and moving.probability < 1 - MOST_AT_REST
    assert still.probability == still.finding.confidence == MOST_AT_REST
    (alone,) = candidates_of(posterior_of(6 * PAN, -20), view, "me")  # what fits is no hand's, and not likely
    assert alone.finding.reason == Reason(Code.NO_VISIBLE_MOTION)
    assert alone.probability is not None and alone.probability < 0.8


@pytest.mark.parametrize("evidence", [-20, -5, 5])
def test_as_it_is_moves_nothing(evidence: float, view: View) -> None:
    (still,) = (each for each in candidates_of(posterior_of(PAN, evidence), view, "me") if each.kind == "still")
    assert still.motion.is_zero


def test_a_least_confidence_decides_instead_of_the_benefit(view: View) -> None:
    found = candidates_of(two_modes(80), anyway(view), "me", PAN)[0]
    assert found.probability is not None
    for least, kind in ((found.probability + 1e-6, "still"), (found.probability - 1e-6, found.kind)):
        first = candidates_of(
            two_modes(80), View(view.photo, decision=DecisionOptions(least_confidence=least)), "me", PAN
        )[0]
        assert first.kind == kind


@pytest.mark.parametrize(("way", "sign"), [("left", 1), ("right", -1), ("up", 0), ("yes", 0)])
def test_the_way_of_the_camera_decides_between_directions(way: Moving, sign: int, view: View) -> None:
    """PAN shifts the scene to the right as it is read: the camera turned left; shake goes the other way."""
    told = View(view.photo, Camera(moving=way))
    assert told.heading == sign
    found = [each for each in candidates_of(two_modes(80), told, "me") if each.kind != "still"]
    ways = {float(np.sign(each.motion.tx_px[-1])) for each in found}
    assert ways == ({float(sign)} if sign else {-1.0, 1.0})


def test_a_photo_whose_lines_show_no_motion_the_stated_way_is_left_alone(view: View) -> None:
    told = View(view.photo, Camera(moving="right"))
    (still,) = candidates_of(posterior_of(PAN, 80), told, "me", PAN)
    assert still.kind == "still" and still.finding.reason == Reason(Code.MOVED_OTHERWISE)


def test_a_mean_that_looks_like_a_mode_is_not_listed_twice(view: View) -> None:
    assert [each.kind for each in candidates_of(two_modes(80, 0.97), anyway(view), "me", PAN)] == ["pan", "still"]


def test_at_any_odds_the_best_motion_comes_first_even_where_none_is_to_be_believed(view: View) -> None:
    unlike = replace(two_modes(80), lines_gain=-0.5)
    assert candidates_of(unlike, view, "me")[0].kind == "still"
    first, *others = candidates_of(unlike, anyway(view), "me")
    assert first.kind != "still" and first.finding.reason is None
    assert all(first.probability >= each.probability for each in others if each.kind != "still")


def test_the_expected_error_is_in_pixels_of_the_photo(view: View) -> None:
    (first, *_) = candidates_of(posterior_of(PAN, 80, 0.004), anyway(view), "me", PAN)
    assert first.finding.expected_error is not None
    assert first.expected_error_px == pytest.approx(first.finding.expected_error * view.height)
    assert 0 < first.finding.expected_error < displacement(PAN)


@pytest.mark.parametrize("evidence", [2, 20])
def test_the_turning_point_is_where_the_folder_decides(evidence: float, view: View) -> None:
    def decided(log_odds: float):
        given = View(view.photo, decision=DecisionOptions(folder=log_odds))
        return candidates_of(two_modes(evidence), given, "me", PAN)[0].finding

    chance = decided(0).motion_odds
    assert chance is not None
    assert not decided(chance.decision_threshold + 0.01).motion.is_zero
    assert decided(chance.decision_threshold - 0.01).motion.is_zero
    again = decided(-3).motion_odds
    assert again is not None  # the photo itself says the same, whatever its folder
    assert (again.log_odds, again.decision_threshold) == pytest.approx((chance.log_odds, chance.decision_threshold))


def test_a_photo_that_was_moved_by_all_accounts_takes_no_part_in_its_folder(view: View) -> None:
    assert (
        candidates_of(two_modes(20), View(view.photo, Camera(moving="yes")), "me", PAN)[0].finding.motion_odds is None
    )
    assert candidates_of(replace(two_modes(20), lines_gain=-0.5), view, "me", PAN)[0].finding.motion_odds is None


# ---- what the user says of the camera ------------------------------------------------------------------------


def moving(view: View, way: Moving = "yes", least: float | None = None) -> View:
    return View(view.photo, Camera(moving=way), decision=DecisionOptions(least))


def test_a_camera_that_moved_may_be_faster_than_hands(view: View) -> None:
    fast = posterior_of(5 * PAN, 1e3, 1e-3)
    assert candidates_of(fast, view, "me")[0].finding.reason == Reason(Code.TOO_FAST_FOR_HANDS)
    assert [each.kind for each in candidates_of(fast, view, "me")] == ["still"]
    told = candidates_of(fast, moving(view), "me")
    assert [each.kind != "still" for each in told].count(True) == 1
    assert told[0].finding.reason is None or told[0].finding.reason.code is not Code.TOO_FAST_FOR_HANDS


@pytest.mark.parametrize("evidence", [-40, -20, -5])
@pytest.mark.parametrize(("size", "way"), [(1.0, "yes"), (0.1, "yes"), (0.1, "left")])
def test_whoever_says_that_the_camera_moved_is_not_told_that_it_did_not(
    evidence: float, size: float, way: Moving, view: View
) -> None:
    posterior = posterior_of(size * PAN, evidence)
    first, *others = candidates_of(posterior, moving(view, way), "me")
    assert first.finding.reason is not None
    assert first.finding.reason.code in (Code.UNSURE_HOW_MOVED, Code.MOVED_TOO_LITTLE)
    assert str(first.finding.reason).startswith("you said that the camera moved, but ")
    assert others and candidates_of(posterior, moving(view, way, least=0.0), "me")[0].motion.largest_px > 0


def test_a_motion_too_small_to_be_seen_is_not_called_no_motion_by_the_verdict(view: View) -> None:
    """Half a pixel that surely helps is smaller than the usual error, so it is left; the words know what was said."""
    posterior = posterior_of(0.01 * PAN, 200, 1e-6)
    first = candidates_of(posterior, moving(view), "me")[0]
    reason = judge(first.finding, Undo()).reason
    assert reason is not None and reason.code in (Code.MOVED_TOO_LITTLE, Code.UNSURE_HOW_MOVED)


def test_what_surely_helps_but_hardly_is_not_left_as_unsure_whether_it_helps(view: View) -> None:
    """Its error is as large as it is: to state the probability of help would contradict the decision."""
    motion = RowMotion.from_polynomials([0, 3], [0], view.height, view.width)
    assert reason_to_leave(0.97, motion).code is Code.HARDLY_HELPS
    assert reason_to_leave(0.6, motion) == Reason.of(Code.UNSURE, confidence=0.6, px=motion.largest_px)
