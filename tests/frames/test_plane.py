import cv2
import numpy as np
import pytest

from support.drawn_photos import textured
from unshutter.frames.plane import moved, plane_between

WIDE = cv2.cvtColor(textured(300, 400), cv2.COLOR_RGB2GRAY)


def crop(picture, left, top):
    return picture[top : top + 200, left : left + 280].copy()


@pytest.mark.parametrize(("across", "down"), [(0, 0), (3, -2), (-45, 8)])
def test_a_shift_even_of_a_sixth_of_the_width(across, down) -> None:
    plane = plane_between(crop(WIDE, 60, 50), crop(WIDE, 60 - across, 50 - down))
    points = np.array([[[20.0, 30.0], [250.0, 180.0]]], np.float32)
    np.testing.assert_allclose(moved(plane, points) - points, [[[across, down], [across, down]]], atol=0.1)


def test_perspective() -> None:
    truth = np.array([[1.02, 0.03, -5.0], [-0.02, 0.99, 4.0], [1e-4, -5e-5, 1.0]])
    first = crop(WIDE, 60, 50)
    second = cv2.warpPerspective(first, truth, (280, 200), flags=cv2.INTER_CUBIC)
    points = np.array([[[40.0, 40.0], [240.0, 160.0]]], np.float32)
    np.testing.assert_allclose(moved(plane_between(first, second), points), moved(truth, points), atol=0.3)


def test_nothing_to_follow_is_no_motion() -> None:
    blank = np.full((200, 280), 20, np.uint8)
    np.testing.assert_array_equal(plane_between(blank, blank), np.eye(3))
