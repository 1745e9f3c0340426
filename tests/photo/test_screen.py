"""Copies for screens: their size, colours and bits, compared with Pillow."""

import io

import numpy as np
import pytest
import pyvips
from PIL import Image

from support.drawn_photos import drawn
from unshutter.errors import UsageError
from unshutter.photo import Photo


def test_a_small_copy_of_a_jpeg() -> None:
    pixels = np.asarray(Image.fromarray(drawn(90, 120)).resize((1200, 900), Image.Resampling.BICUBIC))
    photo = Photo.from_bytes(Photo.from_array(pixels).to_bytes("jpeg", quality=95))
    copy = photo.screen_copy(400)
    assert copy.shape == (300, 400, 3) and copy.dtype == np.uint8
    expected = np.asarray(Image.fromarray(pixels).resize((400, 300), Image.Resampling.BICUBIC)).astype(float)
    assert np.abs(copy - expected).mean() < 2


@pytest.mark.parametrize("longest", [None, 120, 5000])
def test_nothing_is_enlarged(longest: int | None) -> None:
    pixels = drawn(90, 120)
    np.testing.assert_array_equal(Photo.from_array(pixels).screen_copy(longest), pixels)


@pytest.mark.parametrize("longest", [7, 33, 64, 119])
def test_any_size(longest: int) -> None:
    assert Photo.from_array(drawn(90, 120)).screen_copy(longest).shape == (round(90 * longest / 120), longest, 3)


def test_16_bits_grey_and_alpha() -> None:
    deep = np.full((64, 64), 257 * 100, np.uint16)
    np.testing.assert_array_equal(Photo.from_array(deep).screen_copy(), np.full((64, 64, 3), 100))
    clear = np.zeros((64, 64, 4), np.uint8)
    np.testing.assert_array_equal(Photo.from_array(clear).screen_copy(), np.full((64, 64, 3), 128))


def test_colours_by_the_profile() -> None:
    pixels = drawn(64, 96)
    image = pyvips.Image.new_from_array(pixels).copy(interpretation="srgb")
    wide = image.icc_transform("p3", input_profile="srgb")
    photo = Photo.from_bytes(wide.pngsave_buffer())
    assert np.abs(photo.to_array().astype(int) - pixels).max() > 10  # stored otherwise
    assert np.abs(photo.screen_copy().astype(int) - pixels).max() <= 3


def test_a_damaged_profile_is_passed_over() -> None:
    pixels = drawn(64, 96)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "tiff", icc_profile=b"no profile at all" * 20)
    np.testing.assert_array_equal(Photo.from_bytes(stream.getvalue()).screen_copy(), pixels)


def test_no_size_at_all() -> None:
    with pytest.raises(UsageError, match="at least 1 px"):
        Photo.from_array(drawn(64, 64)).screen_copy(0)
