"""Pictures and positions as they are looked at, compared with Pillow."""

import numpy as np
import pytest
from PIL import Image, ImageOps

from unshutter.geometry.readout import Readout
from unshutter.serve.upright import arrows, corners_of, is_sideways, shares, upright

ORIENTATIONS = range(1, 9)


def _by_pillow(pixels: np.ndarray, orientation: int) -> np.ndarray:
    image = Image.fromarray(pixels)
    image.getexif()[0x0112] = orientation
    return np.asarray(ImageOps.exif_transpose(image))


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_pictures(orientation: int) -> None:
    pixels = np.arange(3 * 5 * 3, dtype=np.uint8).reshape(3, 5, 3)
    turned = upright(pixels, orientation)
    np.testing.assert_array_equal(turned, _by_pillow(pixels, orientation))
    assert is_sideways(orientation) == (turned.shape[:2] == (5, 3))


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_positions_go_with_their_pixels(orientation: int) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[7, 12] = 255
    row, col, _ = np.argwhere(upright(pixels, orientation))[0]
    height, width = upright(pixels, orientation).shape[:2]
    ((across, down),) = shares([12], [7], (50, 30), orientation)
    assert (across, down) == pytest.approx(((col + 0.5) / width, (row + 0.5) / height))


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_windows_go_with_their_pixels(orientation: int) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[3:20, 10:45] = 255
    turned = upright(pixels, orientation)
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
    for orientation in ORIENTATIONS:
        assert sorted(arrows(orientation).values()) == ["down", "left", "right", "up"]
