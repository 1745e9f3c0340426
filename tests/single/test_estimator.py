"""A photo as estimators see it, and the motions that they answer with."""

import numpy as np
import pytest

from unshutter import RotationMotion, UsageError, View
from unshutter.options import Camera
from unshutter.photo import Photo


@pytest.fixture
def photo() -> Photo:
    return Photo.from_array(np.arange(100 * 200, dtype=np.uint16).reshape(100, 200))


def test_the_focal_length_is_the_given_one_or_a_guess(photo: Photo) -> None:
    assert View(photo).focal_px() == pytest.approx(0.85 * 300)
    assert View(photo, Camera(focal_px=123.0)).focal_px() == 123
    with pytest.raises(UsageError, match="focal-px"):
        View(photo, Camera(focal_px=0.0))


def test_a_guess_gives_way_to_what_is_known(photo: Photo) -> None:
    assert View(photo, guessed_focal_px=77.0).focal_px() == 77
    assert View(photo, guessed_focal_px=77.0).known_focal_px() is None
    assert View(photo, Camera(focal_px=123.0), guessed_focal_px=77.0).focal_px() == 123


def test_the_line_that_was_read_first_is_the_top_row(photo: Photo) -> None:
    view = View(photo, Camera("right-to-left"))
    assert (view.height, view.width, view.up) == (200, 100, (-1, 0))
    assert view.grey().shape == (200, 100)
    assert view.no_motion("me", "for no reason").motion.scan_direction == "right-to-left"


def test_a_cubic_motion_starts_at_rest(photo: Photo) -> None:
    coefficients = np.array([[0.1, -0.2, 0.3], [0.01, 0.02, -0.03]])
    found = View(photo).cubic_motion(coefficients, "me", confidence=0.5)
    assert found.motion.tx_px[0] == found.motion.rz_rad[0] == 0
    assert (found.motion.width, found.estimator, found.confidence) == (200, "me", 0.5)
    first, last = 0.5 / 100, 99.5 / 100
    tx, rz = (np.polynomial.Polynomial([0, *c]) for c in coefficients)
    assert found.motion.tx_px[-1] == pytest.approx(100 * (tx(last) - tx(first)))
    assert found.motion.rz_rad[-1] == pytest.approx(rz(last) - rz(first))


def test_rotations_that_no_camera_makes_are_declined(photo: Photo) -> None:
    turning = np.linspace(0, 1, 100)[:, None] * np.array([0.0, 0.0, 0.1])
    found = View(photo, Camera(focal_px=300.0)).rotation_motion(turning, "me")
    assert isinstance(found.motion, RotationMotion)
    assert (found.motion.focal_px, found.estimator, found.motion.reference) == (300, "me", "first")
    folded = View(photo, Camera(focal_px=300.0)).rotation_motion(14 * turning, "me")
    assert folded.motion.is_zero
    assert str(folded.reason).startswith("no camera can make the motion that was found")
