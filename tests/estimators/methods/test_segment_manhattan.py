"""The default method, on photos."""

import json

import numpy as np
import pytest

import unshutter
from support.methods import check_facade_is_left_alone, check_photo_is_rectified
from unshutter import Motion, RowMotion
from unshutter.evaluation.metrics import motion_error
from unshutter.options import DEFAULT_ESTIMATOR


def test_the_shipped_model_finds_the_motion_of_a_photo(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    found = unshutter.estimate(picture)
    nothing = motion_error(RowMotion.zero(truth.height, truth.width), truth).epe
    assert nothing > 5
    assert (found.height, found.width, found.estimator) == (truth.height, truth.width, DEFAULT_ESTIMATOR)
    assert found.tx_px[0] == found.rz_rad[0] == 0
    assert motion_error(found, truth).epe < 0.35 * nothing


def test_an_undistorted_facade_is_left_nearly_alone(facade: np.ndarray) -> None:
    found = unshutter.estimate(facade)
    assert np.abs(found.tx_px).max() * 256 / found.height < 2.5
    assert np.degrees(np.abs(found.rz_rad).max()) < 1


def test_the_size_of_the_photo_does_not_matter_much(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    half = np.asarray(picture.reshape(245, 2, 245, 2, 3).mean((1, 3)), np.uint8)
    found = unshutter.estimate(half).resized(490, 490)
    assert motion_error(found, truth).epe < 0.5 * motion_error(RowMotion.zero(490, 490), truth).epe


def test_mirroring_mirrors_the_motion(basilica: tuple[np.ndarray, Motion]) -> None:
    """Up to what the detector finds differently."""
    picture, _ = basilica
    found, mirrored = unshutter.estimate(picture), unshutter.estimate(picture[:, ::-1].copy())
    opposite = RowMotion(found.width, -mirrored.tx_px, -mirrored.rz_rad)
    assert motion_error(opposite, found).epe < 1.0


def test_without_segments_it_says_so_and_does_nothing() -> None:
    grey = np.full((200, 300), 128, np.uint8)
    motion = unshutter.estimate(grey)
    assert motion.is_zero
    assert "0 straight segments" in motion.reason
    assert json.loads(motion.to_json())["reason"] == motion.reason
    np.testing.assert_array_equal(unshutter.rectify(grey), grey)


def test_a_panorama_is_declined() -> None:
    motion = unshutter.estimate(np.zeros((100, 400), np.uint8))
    assert motion.is_zero
    assert "2.5 times" in motion.reason


def test_it_states_its_confidence(basilica: tuple[np.ndarray, Motion]) -> None:
    check_photo_is_rectified(DEFAULT_ESTIMATOR, *basilica)


def test_an_undistorted_facade_is_left_alone(facade: np.ndarray) -> None:
    check_facade_is_left_alone(DEFAULT_ESTIMATOR, facade)


def test_the_answer_is_what_it_was(rolling_facade: np.ndarray) -> None:
    """Figures of a drawn picture, written down once: a change of the code that is to change no answer changes none."""
    found = unshutter.estimate(rolling_facade)
    rows = [104, 209, 314, 419]
    np.testing.assert_allclose(found.tx_px[rows], (3.515585, -1.610879, -15.441822, -37.964321), rtol=1e-5)
    np.testing.assert_allclose(found.rz_rad[rows], (0.02470333, 0.04940118, 0.07423768, 0.09959689), rtol=1e-5)
    assert found.confidence == pytest.approx(0.1441075, rel=1e-5)
