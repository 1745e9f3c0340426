"""Methods that see lines, through the detector."""

import numpy as np
import pytest

import unshutter
from support.covering import thorough
from support.line_scenes import FOCAL, HEIGHT, QUADRATIC, WIDTH, drawn_picture, share_left, turning
from unshutter.motion import RotationMotion


@pytest.mark.parametrize(
    ("name", "degrees", "left"),
    [
        ("lao2018", ((0, 0, 7),), 0.15),
        thorough("lao2018", ((0, 0, -5),), 0.15),
        ("rengarajan2016", QUADRATIC, 0.15),
        thorough("rengarajan2016", ((0, -4, -3),), 0.15),
        ("purkait2017", ((0, 0, 7),), 0.1),
        thorough("purkait2017", ((0, 0, -5),), 0.1),
    ],
)
def test_the_motion_of_a_drawn_picture_is_found_and_found_again(name: str, degrees: tuple, left: float) -> None:
    truth = turning(*degrees)
    picture = drawn_picture(truth)
    found, again = (unshutter.estimate(picture, estimator=name, focal_px=FOCAL) for _ in range(2))
    motion = found.motion
    assert isinstance(motion, RotationMotion)
    assert (motion.focal_px, found.estimator, motion.height, motion.width) == (FOCAL, name, HEIGHT, WIDTH)
    assert not motion.rotations[0].any()
    assert share_left(motion, truth) < left
    np.testing.assert_array_equal(again.motion.tx_px, motion.tx_px)  # seeded


@pytest.mark.parametrize("name", ["lao2018", "rengarajan2016", "purkait2017"])
def test_without_lines_nothing_is_done_and_the_reason_is_given(name: str) -> None:
    found = unshutter.estimate(np.full((200, 300), 128, np.uint8), estimator=name)
    assert found.motion.is_zero
    assert "only 0" in str(found.reason)
