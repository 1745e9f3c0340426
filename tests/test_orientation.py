"""Orientations, compared with Pillow's, and with each other."""

import numpy as np
import pytest
from PIL import Image, ImageOps

from support.covering import covering
from unshutter.orientation import Orientation

PIXELS = np.arange(3 * 5 * 3, dtype=np.uint8).reshape(3, 5, 3)


def _by_pillow(pixels: np.ndarray, orientation: int) -> np.ndarray:
    image = Image.fromarray(pixels)
    image.getexif()[0x0112] = orientation
    return np.asarray(ImageOps.exif_transpose(image))


@pytest.mark.parametrize("orientation", list(Orientation))
def test_pictures(orientation: Orientation) -> None:
    upright = orientation.upright(PIXELS)
    np.testing.assert_array_equal(upright, _by_pillow(PIXELS, orientation))
    np.testing.assert_array_equal(orientation.stored(upright), PIXELS)
    assert orientation.size(3, 5) == upright.shape[:2]


@pytest.mark.parametrize("orientation", list(Orientation))
def test_names_are_those_of_pillow_and_editors(orientation: Orientation) -> None:
    by_name = {
        "NORMAL": PIXELS,
        "FLIP_LEFT_RIGHT": PIXELS[:, ::-1],
        "ROTATE_180": PIXELS[::-1, ::-1],
        "FLIP_TOP_BOTTOM": PIXELS[::-1],
        "TRANSPOSE": PIXELS.swapaxes(0, 1),
        "ROTATE_CLOCKWISE": PIXELS[::-1].swapaxes(0, 1),
        "TRANSVERSE": PIXELS[::-1, ::-1].swapaxes(0, 1),
        "ROTATE_COUNTERCLOCKWISE": PIXELS.swapaxes(0, 1)[::-1],
    }
    np.testing.assert_array_equal(orientation.upright(PIXELS), by_name[orientation.name])


@pytest.mark.parametrize(("first", "second"), covering([*Orientation], [*Orientation][3:] + [*Orientation][:3]))
def test_two_in_a_row_are_one(first: Orientation, second: Orientation) -> None:
    both = first.then(second)
    np.testing.assert_array_equal(both.upright(PIXELS), second.upright(first.upright(PIXELS)))


@pytest.mark.parametrize("orientation", list(Orientation))
def test_points_and_directions_follow_the_pixels(orientation: Orientation) -> None:
    pixels = np.zeros((30, 50), np.uint8)
    pixels[7, 12], pixels[3, 12] = 255, 100  # the second one is straight above the first
    upright = orientation.upright(pixels)
    (row, col), (row_above, col_above) = np.argwhere(upright == 255)[0], np.argwhere(upright == 100)[0]
    height, width = upright.shape
    place = orientation.upright_point(12.5 / 50, 7.5 / 30)
    assert place == pytest.approx(((col + 0.5) / width, (row + 0.5) / height))
    assert orientation.upright_direction(0, -4) == (col_above - col, row_above - row)
    assert orientation.upright_direction(*orientation.scene_up) == (0, -1)


def test_other_numbers_count_as_normal() -> None:
    assert Orientation(0) is Orientation(9) is Orientation.NORMAL
    with pytest.raises(ValueError, match="is not a valid"):
        Orientation("up")
