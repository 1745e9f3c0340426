"""Photos with a plain border round the picture are left unchanged: the camera did not see it."""

import numpy as np
import pytest

import unshutter
from support.drawn_photos import textured
from unshutter.reasons import Code
from unshutter.single.borders import has_border

PICTURE = textured(200, 300, bands=1)[..., 0]


def with_border(*, top=0, bottom=0, left=0, right=0, level=0):
    return np.pad(PICTURE, ((top, bottom), (left, right)), constant_values=level)


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("sides", [{"top": 30, "bottom": 30}, {"left": 8, "right": 40}, {"top": 9, "bottom": 60}])
def test_letterboxes_and_frames_are_borders(sides, level):
    framed = with_border(**sides, level=level)
    assert has_border(framed)
    noisy = framed + np.random.default_rng(0).integers(-2, 3, framed.shape)
    assert has_border(np.clip(noisy, 0, 255).astype(np.uint8))


def test_what_photos_show_is_no_border():
    assert not has_border(PICTURE)
    assert not has_border(np.full((200, 300), 7, np.uint8))
    assert not has_border(with_border(top=60, level=255))  # a sky above the sea
    rows, cols = np.mgrid[:200, :300]
    distance = np.hypot(rows - 100, cols - 150)
    assert not has_border(np.where(distance < 80, PICTURE, 250).astype(np.uint8))  # a thing before a plain wall
    fading = 255 - np.clip((np.minimum(rows, 199 - rows) - 20) * 4, 0, 200)
    assert not has_border(np.minimum(fading, PICTURE + fading * 0.5).clip(0, 255).astype(np.uint8))  # a vignette


def test_a_photo_with_a_border_is_left_unchanged():
    framed = np.repeat(with_border(top=40, bottom=40)[..., None], 3, axis=2)
    estimated = unshutter.estimate(framed)
    assert estimated.motion.is_zero and estimated.reason is not None and estimated.reason.code is Code.BORDER
