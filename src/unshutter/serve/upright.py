"""From stored pixels to the picture as it is looked at, by EXIF orientation 1 to 8; only this file knows how.

Positions for the page are shares of the upright picture's width and height, (0, 0) at its top left corner.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from unshutter.geometry.readout import Readout

# Orientation -> quarter turns clockwise after the picture was mirrored left to right, or not.
_TURNS = {
    1: (0, False),
    2: (0, True),
    3: (2, False),
    4: (2, True),
    5: (3, True),
    6: (1, False),
    7: (1, True),
    8: (3, False),
}
_READ = {
    Readout.TOP_TO_BOTTOM: (0, 1),
    Readout.BOTTOM_TO_TOP: (0, -1),
    Readout.LEFT_TO_RIGHT: (1, 0),
    Readout.RIGHT_TO_LEFT: (-1, 0),
}
_ARROWS = {(0, 1): "down", (0, -1): "up", (1, 0): "right", (-1, 0): "left"}


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Stored pixels [H, W, ...] as they are looked at."""
    turns, mirrored = _TURNS[orientation]
    return np.rot90(pixels[:, ::-1] if mirrored else pixels, -turns)


def is_sideways(orientation: int) -> bool:
    """Whether the upright picture's width is the stored one's height."""
    return _TURNS[orientation][0] % 2 == 1


def shares(col: Any, row: Any, size: tuple[int, int], orientation: int) -> np.ndarray:
    """[N, 2] shares (across, down) of the upright picture, of stored pixel positions.

    Args:
        col, row: [N] pixel centres at whole numbers.
        size: width and height of the stored pixels.
        orientation: EXIF orientation.
    """
    return _turned((np.asarray(col) + 0.5) / size[0], (np.asarray(row) + 0.5) / size[1], orientation)


def corners_of(window: tuple[float, float, float, float], orientation: int) -> list[float]:
    """(left, top, right, bottom) as shares of the upright picture, of a window in shares of the stored one."""
    left, top, right, bottom = window
    turned = _turned(np.array([left, right]), np.array([top, bottom]), orientation)
    return [*turned.min(axis=0).tolist(), *turned.max(axis=0).tolist()]


def arrows(orientation: int) -> dict[str, str]:
    """Where each direction of the readout points in the upright picture: up, down, left, right."""
    middle = np.array([0.5, 0.5])
    named = {}
    for readout, (right, down) in _READ.items():
        ends = middle + np.array([[0, 0], [right, down]])
        start, end = _turned(ends[:, 0], ends[:, 1], orientation)
        named[str(readout)] = _ARROWS[tuple(np.rint(end - start).astype(int).tolist())]
    return named


def _turned(across: np.ndarray, down: np.ndarray, orientation: int) -> np.ndarray:
    turns, mirrored = _TURNS[orientation]
    across = 1 - across if mirrored else across
    for _ in range(turns):
        across, down = 1 - down, across
    return np.stack([across, down], axis=-1)
