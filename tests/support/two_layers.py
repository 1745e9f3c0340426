"""A camera that sways before a wall with boards in front of it: near and far move differently."""

from functools import cache

import numpy as np

from support.drawn_photos import textured
from support.frame_pairs import sampled

HEIGHT, WIDTH, RATIO = 160, 240, 0.8
_MARGIN = 80  # px of the wall about the picture
_FAR, _NEAR, _PERIOD = 22.0, 50.0, 22.0  # px that each sways to either side, and in how many frames
_BOARDS = ((20, 60), (150, 70))  # left end and width [px]; each hides the wall from row 50 down


def frame(number, ratio=RATIO):
    """As a rolling shutter took it: grey."""
    return _seen(number + ratio * np.arange(HEIGHT)[:, None] / HEIGHT)


def instant(moment):
    """As a global shutter would have taken it."""
    return _seen(np.full((HEIGHT, 1), float(moment)))


def middle(number, ratio=RATIO):
    """The moment of a frame's middle row, as a global shutter would have taken it."""
    return instant(number + ratio / 2)


def half_straight(number, ratio=RATIO):
    """Halfway to the moment of its middle row."""
    return _seen(number + ratio / 4 + ratio / 2 * np.arange(HEIGHT)[:, None] / HEIGHT)


def _seen(time):
    col, row = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    sway = np.sin(2 * np.pi * time / _PERIOD)
    wall = _wall(_MARGIN)
    picture = sampled(wall, col + _MARGIN - _FAR * sway, row + _MARGIN)
    for left, wide in _BOARDS:
        on_board = col - left - _NEAR * sway
        covers = (on_board >= 0) & (on_board < wide) & (row >= 50)
        picture = np.where(covers, sampled(wall[::-1, ::-1], on_board + _MARGIN, row), picture)
    return picture


@cache
def _wall(margin):
    drawn = textured(HEIGHT + 2 * margin, WIDTH + 2 * margin, bands=1)[..., 0].astype(float)
    return np.clip(128 + 1.3 * (drawn - drawn.mean()), 30, 225).astype(np.uint8)
