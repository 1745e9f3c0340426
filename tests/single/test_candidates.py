"""The motion to undo and the other candidates, of posteriors that are made up."""

from dataclasses import replace

import numpy as np
import pytest

from support.posteriors import posterior_of
from unshutter import View
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.single.candidates import candidates_of, modes_of
from unshutter.single.search import Optima, Posterior, displacement

PAN, SHAKE = np.array([0.1, 0, 0, 0, 0, 0]), np.array([-0.02, 0.05, 0, 0.01, 0, 0])


@pytest.fixture
def view(facade: np.ndarray) -> View:
    return View(Photo.from_array(facade))


def two_modes(evidence: float, share: float = 0.7) -> Posterior:
    """Two optima close to each other for a pan to the left, and one for shake."""
    shares = np.array([0.6 * share, 0.4 * share, 1 - share])
    motions = np.stack([PAN, 1.01 * PAN, SHAKE])
    optima = Optima(motions, np.tile(np.eye(6) * 1e-6, (3, 1, 1)), np.array([1, 1, 0]), shares)
    kinds = {"hand": 1 - share, "pan": share}
    return replace(posterior_of(shares @ motions, evidence), optima=optima, kinds=kinds)


@pytest.mark.parametrize(
    ("tx", "gain", "reason"), [(0.05, -0.5, "no right angles"), (0.5, 1.0, "more motion than a hand-held camera makes")]
)
def test_what_is_not_to_be_believed_is_no_motion(tx: float, gain: float, reason: str, view: View) -> None:
    motion = candidates_of(posterior_of(tx * PAN / 0.1, 1e3, 1e-3, gain), view, "me")[0].motion
    assert (motion.is_zero, motion.estimator) == (True, "me")
    assert reason in str(motion.reason)


def test_optima_that_look_the_same_are_one_mode() -> None:
    first, second = modes_of(two_modes(50))
    assert (first.kind, second.kind) == ("pan", "hand")
    assert (first.share, second.share) == pytest.approx((0.7, 0.3))
    np.testing.assert_allclose(first.motion, 1.004 * PAN)


def test_the_first_candidate_is_what_is_undone_and_one_is_the_photo_as_it_is(view: View) -> None:
    moved = candidates_of(two_modes(80), view, "me")
    assert [each.kind for each in moved] == ["pan", "pan", "hand", "still"]  # the mean, then what it is the mean of
    assert moved[0].motion.kind_shares == (("hand", pytest.approx(0.3)), ("pan", pytest.approx(0.7)))
    assert moved[-1].description == "as it is"
    assert moved[1].probability == pytest.approx(0.7 * (1 - moved[-1].probability))
    stood = candidates_of(two_modes(-20), view, "me")
    assert [each.kind for each in stood] == ["still", "pan", "hand"]
    assert stood[0].probability > 0.7 > moved[-1].probability


@pytest.mark.parametrize("evidence", [-20, -5, 5])
def test_what_is_called_as_it_is_moves_nothing_that_shows(evidence: float, view: View) -> None:
    candidates = candidates_of(posterior_of(PAN, evidence), view, "me")
    (still,) = (each for each in candidates if each.kind == "still")
    assert still.motion.largest_px < 1
    visible = candidates[0].motion.largest_px > 2
    assert visible == (evidence > -20) == (candidates[0].kind != "still")


def test_a_mean_that_looks_like_a_mode_is_not_listed_twice(view: View) -> None:
    assert [each.kind for each in candidates_of(two_modes(80, 0.97), view, "me")] == ["pan", "still"]


def test_a_mean_between_the_modes_states_no_probability(view: View) -> None:
    first, *modes, _ = candidates_of(two_modes(80, 0.5), view, "me")
    assert first.probability is None and "probability" not in first.described()
    assert all(mode.probability is not None and mode.probability > 0.1 for mode in modes) and len(modes) == 2


def test_at_any_odds_the_best_motion_comes_first_even_where_none_is_to_be_believed(view: View) -> None:
    unlike = replace(two_modes(80), lines_gain=-0.5)
    assert candidates_of(unlike, view, "me")[0].kind == "still"
    anyway = View(view.photo, Camera(at_any_odds=True))
    first = candidates_of(unlike, anyway, "me")[0]
    assert (first.kind, first.motion.reason) == ("pan", None)
    np.testing.assert_allclose(first.motion.tx_px[-1] / first.motion.height, 0.1, rtol=0.02)


def test_the_expected_error_is_in_pixels_of_the_photo(view: View) -> None:
    (first, *_) = candidates_of(posterior_of(PAN, 80, 0.004), view, "me")
    rows = np.random.default_rng(0).normal(0, 0.004, (4000, 6))
    expected = np.sqrt(np.mean([displacement(row) ** 2 for row in rows])) * view.height
    assert first.expected_error_px == pytest.approx(expected, rel=0.05)
