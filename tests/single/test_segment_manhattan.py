"""The default method, on photos."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.methods import check_facade_is_left_alone, check_photo_is_rectified
from unshutter import Motion, RowMotion
from unshutter.motion.finding import Candidate, Finding
from unshutter.options import DEFAULT_ESTIMATOR, Camera
from unshutter.photo import Photo
from unshutter.single.estimator import View
from unshutter.single.methods import SegmentManhattan
from unshutter.single.register import load
from unshutter.single.row_network import RowNetwork
from unshutter_lab.evaluation.metrics import motion_error


def test_the_size_of_the_photo_does_not_matter_much(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    half = np.asarray(picture.reshape(245, 2, 245, 2, 3).mean((1, 3)), np.uint8)
    found = unshutter.estimate(half).resized(490, 490)
    assert motion_error(found.motion, truth).epe < 0.5 * motion_error(RowMotion.zero(490, 490), truth).epe


def test_mirroring_mirrors_the_motion(basilica: tuple[np.ndarray, Motion]) -> None:
    """Up to what the detector finds differently."""
    picture, _ = basilica
    found, mirrored = unshutter.estimate(picture), unshutter.estimate(picture[:, ::-1].copy())
    opposite = RowMotion(found.motion.width, -mirrored.motion.tx_px, -mirrored.motion.rz_rad)
    assert motion_error(opposite, found.motion).epe < 1.0


def test_without_segments_it_says_so_and_does_nothing() -> None:
    grey = np.full((200, 300), 128, np.uint8)
    found = unshutter.estimate(grey)
    assert found.motion.is_zero
    assert "0 straight segments" in str(found.reason)
    assert json.loads(found.to_json())["reason"] == str(found.reason)
    np.testing.assert_array_equal(unshutter.rectify(grey).array, grey)


def test_it_states_its_confidence(basilica: tuple[np.ndarray, Motion]) -> None:
    check_photo_is_rectified(DEFAULT_ESTIMATOR, *basilica)


def test_an_undistorted_facade_is_left_alone(facade: np.ndarray) -> None:
    check_facade_is_left_alone(DEFAULT_ESTIMATOR, facade)


def test_answer_for_the_shipped_photo() -> None:
    """The values were written down once, so that a change meant to leave answers alone can be seen to do so.

    The photo is a file: drawing one needs OpenCV's remap, whose pixels differ by up to 3 levels between 4.x and 5.x.
    From the same pixels, 4.11 and 5.0 gave motions equal to 1e-5 px on 33 photos.
    """
    found = unshutter.estimate(Path(__file__).parents[2] / "examples" / "demo.jpg")
    rows = [98, 196, 294, 392]
    np.testing.assert_allclose(found.motion.tx_px[rows], (12.046339, 27.695562, 46.901871, 69.619463), rtol=1e-5)
    np.testing.assert_allclose(found.motion.rz_rad[rows], (0.00515312, 0.00800525, 0.00877954, 0.00769911), rtol=1e-5)
    assert found.confidence == 0.97  # the most that is ever stated; it was 0.9907 before there was a limit
    assert dict(found.kind_shares) == pytest.approx(
        {"quadratic": 0.7962091, "hand": 0.1995909, "pan": 0.0042001}, rel=1e-4
    )


def test_a_network_that_sees_pixels_draws_a_motion_towards_its_own_unless_it_is_sure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    u = np.arange(256) / 256
    seen = np.stack([12 * u, 0 * u])
    monkeypatch.setattr(RowNetwork, "motion_of", lambda self, square: seen)
    estimator = load()
    assert isinstance(estimator, SegmentManhattan)

    def end_of(view: View, confidence: float) -> float:
        finding = Finding(RowMotion(256, 10 * u, 0 * u), confidence=confidence)
        candidates = Candidate("hand", finding), Candidate("still", view.no_motion("me"))
        first, other = estimator._seconded(candidates, view, np.zeros((256, 256), np.uint8))
        assert first.finding.confidence == confidence and other is candidates[1]
        return float(first.motion.tx_px[-1])

    view = View(Photo.from_array(np.zeros((256, 256, 3), np.uint8)))
    assert 10.5 < end_of(view, 0.8) < 10.8
    assert end_of(view, 0.96) == end_of(replace(view, camera=Camera(roll_deg=0.0)), 0.8) == 10 * u[-1]
    seen = np.stack([-10 * u, 0 * u])
    assert 9.2 < end_of(view, 0.8) < 10
