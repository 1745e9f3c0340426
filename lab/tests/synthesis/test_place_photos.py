"""Photos of places by a moving camera: its motion between rows, and the blur of long exposures."""

import numpy as np
import pytest

from support.drawn_places import cube, smooth, streets
from unshutter_lab.synthesis.handheld import draw_hand
from unshutter_lab.synthesis.panorama import Camera, Place, row_matrices
from unshutter_lab.synthesis.place_photos import Moving, Quadratic, Rotating, take_photo, with_noise
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import draw_quadratic

CAMERA = Camera(90, 120, 100.0, yaw=20, tilt=8, roll=-3)
YARD = Place(streets(0))


def pan(degrees_per_s: float, readout_s: float = 0.05) -> Rotating:
    times = np.linspace(-1, 1, 201)
    return Rotating(CAMERA, RotationLog(times, 0 * times + np.radians(degrees_per_s), 0 * times, 0 * times), readout_s)


def hand() -> Rotating:
    return Rotating(CAMERA, draw_hand(np.random.default_rng(2), 0.3), 0.1)


@pytest.mark.parametrize("moving", [pan(40.0), hand(), Quadratic.drawn(np.random.default_rng(1), CAMERA)])
def test_the_matrices_are_those_of_the_motion(moving: Moving) -> None:
    rows = np.arange(90.0)
    np.testing.assert_allclose(moving.matrices(rows), row_matrices(moving.motion(), 100.0), atol=1e-9)
    assert moving.motion().reference == "first"
    between = moving.matrices(np.array([30.0, 30.5, 31.0]))
    np.testing.assert_allclose(between[1], (between[0] + between[2]) / 2, atol=1e-5)
    before, first, after = moving.matrices(np.array([-2.0, 0.0, 2.0]))  # it moves on beyond the picture
    np.testing.assert_allclose(first, np.eye(3), atol=1e-12)
    assert np.abs(before - np.eye(3)).max() > 1e-5
    np.testing.assert_allclose(before + after, 2 * np.eye(3), atol=0.4 * np.abs(after - before).max())


def test_a_camera_that_pans_to_the_left_moves_the_scene_to_the_right() -> None:
    motion = pan(40.0).motion()
    assert motion.tx_px[-1] == pytest.approx(100 * np.tan(np.radians(40 * 0.05 * 89 / 90)), rel=1e-6)
    seen, still = take_photo(YARD, CAMERA, pan(40.0)), take_photo(YARD, CAMERA, None)
    shift = round(motion.tx_px[80])
    at = slice(79, 82)
    same = np.abs(seen[at, 20:].astype(int) - still[at, 20 - shift : -shift]).mean()
    assert same < 0.3 * np.abs(seen[at, 20:].astype(int) - still[at, 20:]).mean()


def test_quadratics_are_those_of_the_pairs() -> None:
    camera = Camera(256, 300, 250.0)
    for seed in range(6):
        found = Quadratic.drawn(np.random.default_rng(seed), camera).motion()
        crop = draw_quadratic(np.random.default_rng(seed), 256, 356).crop
        np.testing.assert_allclose(found.tx_px, crop.tx_px, atol=1e-9)
        np.testing.assert_allclose(found.rz_rad, crop.rz_rad, atol=1e-12)


def test_an_exposure_is_the_mean_of_linear_light_over_the_rows_own_time() -> None:
    moving, rows = pan(60.0), np.arange(90.0)
    blurred = take_photo(YARD, CAMERA, moving, exposed_rows=30.0)
    moments = [YARD.seen(CAMERA, moving.matrices(rows + at)) / 255 for at in np.linspace(-15, 15, 61)]
    light = np.mean([np.where(m <= 0.04045, m / 12.92, ((m + 0.055) / 1.055) ** 2.4) for m in moments], 0)
    encoded = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    assert np.abs(blurred / 255 - encoded).mean() < 0.006
    sharp = take_photo(YARD, CAMERA, moving)
    assert np.abs(blurred.astype(int) - sharp).mean() > 2
    assert edges(blurred, 1) < 0.65 * edges(sharp, 1)
    assert edges(blurred, 0) > 0.7 * edges(sharp, 0)  # it pans: levels stay sharp


def edges(picture: np.ndarray, axis: int) -> float:
    return float((np.diff(picture.astype(float), axis=axis) ** 2).mean())


def test_a_camera_that_stands_still_is_never_blurred() -> None:
    np.testing.assert_array_equal(take_photo(YARD, CAMERA, None, exposed_rows=40.0), YARD.seen(CAMERA))
    np.testing.assert_array_equal(take_photo(YARD, CAMERA, pan(0.0), exposed_rows=40.0), YARD.seen(CAMERA))


def test_noise_has_the_deviation_that_is_asked_for() -> None:
    grey = np.full((80, 80, 3), 120, np.uint8)
    noisy = with_noise(grey, 3.0, np.random.default_rng(0)).astype(float)
    assert noisy.std() == pytest.approx(3.0, rel=0.05) and noisy.mean() == pytest.approx(120, abs=0.1)
    assert with_noise(grey * 0, 3.0, np.random.default_rng(0)).min() == 0


def test_smooth_places_are_blurred_little() -> None:
    place = Place(cube(smooth))
    sharp, blurred = (take_photo(place, CAMERA, hand(), exposed) for exposed in (0.0, 20.0))
    assert np.abs(sharp.astype(int) - blurred).mean() < 1.0
