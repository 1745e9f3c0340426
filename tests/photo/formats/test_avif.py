"""AVIF: bit depth, orientation by its boxes, grey."""

import io

import numpy as np
import pytest
import pyvips

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import (
    full_exif,
)
from unshutter.photo import Photo
from unshutter.photo.formats import boxes


@pytest.mark.parametrize(("bits", "step"), [(10, 64), (12, 16)])
def test_avif_keeps_its_bit_depth(bits, step):
    pixels = drawn(bands=3, dtype=np.uint16)
    made = pyvips.Image.new_from_array(pixels).copy(interpretation="rgb16")
    photo = Photo.from_bytes(made.heifsave_buffer(compression="av1", bitdepth=bits, Q=95))
    again = Photo.from_bytes(photo.to_bytes(quality=95)).to_array()
    assert again.dtype == np.uint16
    assert np.all(again % step == 0) and np.any(again % (2 * step))  # as many bits as before, and no more
    assert Photo.from_bytes(Photo.from_array(pixels).to_bytes("avif")).to_array().max() % 16 == 0  # 12 by default


@pytest.mark.parametrize("orientation", range(1, 9))
def test_avif_of_other_programs_is_read_as_stored(orientation):
    pixels = textured(48, 80)
    photo = Photo.from_bytes(encoded(pixels, "AVIF", quality=95, exif=full_exif(orientation=orientation)))
    assert photo.orientation == orientation and photo.to_array().shape == (photo.height, photo.width, photo.bands)
    assert np.abs(photo.to_array().astype(int) - pixels).mean() < 8
    grey = photo.grey(24)
    assert grey.shape == (24, 40)
    assert boxes.read_coding(io.BytesIO(photo.to_bytes("jpeg"))) == boxes.BoxCoding()  # not one


def test_grey_avif_stays_grey_inside():
    pixels = textured(48, 80, 1)[..., 0]
    photo = Photo.from_bytes(encoded(pixels, "AVIF", quality=95))
    assert photo.bands == 1 and photo.to_array().shape == (48, 80)
    assert np.abs(photo.to_array().astype(int) - pixels).mean() < 8
