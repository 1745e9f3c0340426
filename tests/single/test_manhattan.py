import numpy as np

import unshutter
from support.methods import check_facade_is_left_alone, check_photo_is_rectified
from unshutter import Motion, View
from unshutter.photo import Photo


def test_a_photo_is_rectified(basilica: tuple[np.ndarray, Motion]) -> None:
    check_photo_is_rectified("manhattan", *basilica)


def test_an_undistorted_facade_is_left_alone(facade: np.ndarray) -> None:
    check_facade_is_left_alone("manhattan", facade)


def test_what_cannot_be_used_is_declined() -> None:
    estimator = unshutter.load("manhattan")
    blank = estimator.estimate(View(Photo.from_array(np.full((200, 300), 128, np.uint8))))
    assert blank.motion.is_zero
    assert "0 straight segments" in str(blank.reason)
    wide = estimator.estimate(View(Photo.from_array(np.zeros((100, 400), np.uint8))))
    assert "2.5 times" in str(wide.reason)
