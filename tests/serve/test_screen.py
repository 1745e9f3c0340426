"""Positions as the page shows them, compared with pictures that are turned upright."""

import numpy as np
import pytest

from unshutter.geometry.readout import Orientation, Readout
from unshutter.serve.jobs.screen import arrows, corners_of, shares


@pytest.mark.parametrize("orientation", list(Orientation))
def test_positions_go_with_their_pixels(orientation: Orientation) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[7, 12] = 255
    row, col, _ = np.argwhere(orientation.upright(pixels))[0]
    height, width = orientation.upright(pixels).shape[:2]
    ((across, down),) = shares([12], [7], (50, 30), orientation)
    assert (across, down) == pytest.approx(((col + 0.5) / width, (row + 0.5) / height))


@pytest.mark.parametrize("orientation", list(Orientation))
def test_windows_go_with_their_pixels(orientation: Orientation) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[3:20, 10:45] = 255
    turned = orientation.upright(pixels)
    rows, cols, _ = np.nonzero(turned)
    height, width = turned.shape[:2]
    expected = [cols.min() / width, rows.min() / height, (cols.max() + 1) / width, (rows.max() + 1) / height]
    assert corners_of((10 / 50, 3 / 30, 45 / 50, 20 / 30), orientation) == pytest.approx(expected)


def test_arrows() -> None:
    assert arrows(1) == {
        Readout.TOP_TO_BOTTOM: "down",
        Readout.BOTTOM_TO_TOP: "up",
        Readout.LEFT_TO_RIGHT: "right",
        Readout.RIGHT_TO_LEFT: "left",
    }
    assert arrows(6)[Readout.TOP_TO_BOTTOM] == "left"  # a phone held upright: stored rows stand, the first on the right
    for orientation in Orientation:
        assert sorted(arrows(orientation).values()) == ["down", "left", "right", "up"]
