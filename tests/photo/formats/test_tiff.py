"""TIFF: compression, pages, BigTIFF, IPTC and tags of its own."""

import io

import numpy as np
import pytest
import pyvips
from PIL import Image

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import (
    ABOUT_CAMERA,
    EXIF,
    full_exif,
)
from unshutter.photo import Photo
from unshutter.photo.tags import exif


@pytest.mark.parametrize(("compression", "expected"), [("raw", 1), ("tiff_lzw", 5), ("packbits", 8), ("jpeg", 8)])
def test_tiff_stays_uncompressed_or_lzw(compression, expected):
    photo = Photo.from_bytes(encoded(textured(48, 80), "TIFF", compression=compression))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        assert picture.tag_v2[259] == expected
        np.testing.assert_array_equal(np.asarray(picture), photo.to_array())


def test_tags_that_only_tiff_keeps_stay_there():
    tags = Image.Exif()
    tags.update(ABOUT_CAMERA | {0x4746: 4})
    tags.get_ifd(EXIF)[0xFE00] = b"of my own"
    photo = Photo.from_bytes(Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes())).to_bytes("tiff"))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        assert picture.getexif()[0x4746] == 4
        assert picture.getexif().get_ifd(EXIF)[0xFE00] == b"of my own"


def test_a_tiff_with_a_smaller_copy_of_itself_is_one_photo():
    stream = io.BytesIO()
    small = Image.fromarray(drawn(12, 20))
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.fromarray(drawn()).save(stream, "TIFF", save_all=True, append_images=[small])
    np.testing.assert_array_equal(Photo.from_bytes(stream.getvalue()).to_array(), drawn())


def test_big_tiff_is_left_alone():
    big = pyvips.Image.new_from_array(drawn()).tiffsave_buffer(bigtiff=True)
    stream = io.BytesIO(big)
    exif.add_to_tiff(stream, full_exif(), 48, 80)
    assert stream.getvalue() == big
    photo = Photo.from_bytes(big)
    np.testing.assert_array_equal(photo.to_array(), drawn())
    np.testing.assert_array_equal(Photo.from_bytes(photo.to_bytes()).to_array(), drawn())
