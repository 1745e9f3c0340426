"""Streets with depth: where each pixel moves, and the nearest motion of rows."""

import numpy as np
import pytest

from support.drawn_places import streets
from unshutter.motion import RowMotion
from unshutter_lab.synthesis.handheld import draw_hand
from unshutter_lab.synthesis.panorama import Camera, Place
from unshutter_lab.synthesis.place_photos import Rotating
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.streets import Passing, Street, draw_street, nearest_motion

CAMERA = Camera.of_view(60, 80, 60, yaw=40, tilt=5, roll=1)
NO_RATE = np.zeros(2)
STEADY = RotationLog(np.array([-1.0, 1.0]), NO_RATE, NO_RATE, NO_RATE)


@pytest.fixture(scope="module")
def street() -> Street:
    return draw_street(np.random.default_rng(3), Place(streets(1)), CAMERA)


def own() -> np.ndarray:
    return np.indices((CAMERA.height, CAMERA.width))[::-1].astype(float)


def test_a_camera_that_only_turns_sees_no_parallax(street: Street) -> None:
    log = draw_hand(np.random.default_rng(1), 0.3)
    moved = street.moved(Passing(CAMERA, log, 0.1))
    truth = np.array(Rotating(CAMERA, log, 0.1).motion().gs_to_rs(*own())) - own()
    np.testing.assert_allclose(moved, truth, atol=0.01)


def test_what_is_near_moves_farther(street: Street) -> None:
    once, twice = (
        np.hypot(*street.moved(Passing(CAMERA, STEADY, readout_s, (0.8, -0.3)))) for readout_s in (0.05, 0.1)
    )
    assert (once[0] < 1e-4).all()  # the first row
    assert once.max() > 1 and once[-1].max() > 1.3 * once[-1].min()
    assert twice[-1].max() == pytest.approx(2 * once[-1].max(), rel=0.1)


def test_the_nearest_motion_of_one_without_parallax_is_that_motion() -> None:
    truth = RowMotion.from_polynomials([0, 6, -3], [0, 0.01, 0.004], 60, 80)
    truth = truth.rereferenced("first")
    found = nearest_motion(np.array(truth.gs_to_rs(*own())) - own())
    np.testing.assert_allclose(found.tx_px, truth.tx_px, atol=0.05)
    np.testing.assert_allclose(found.rz_rad, truth.rz_rad, atol=5e-4)
