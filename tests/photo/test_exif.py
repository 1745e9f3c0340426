"""EXIF: blobs changed in place, and what a TIFF says itself."""

import io

import pytest
from PIL import Image

from support.drawn_photos import drawn, encoded
from support.tagged_files import (
    full_exif,
)
from unshutter.photo import exif


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("told", [False, True])
def test_orientation_is_put_into_any_blob(order: str, told: bool) -> None:
    tags = Image.Exif()
    tags.endian = order
    tags.update({0x0132: "2024:05:06 07:08:09", 0x010F: "Acme"} | ({0x0112: 1} if told else {}))
    blob = exif.with_orientation(tags.tobytes(), 6)
    again = Image.Exif()
    again.load(blob)
    assert dict(again) == {0x0132: "2024:05:06 07:08:09", 0x010F: "Acme", 0x0112: 6}
    assert exif.with_orientation(None, 1) is None
    made = exif.with_orientation(None, 8)
    again = Image.Exif()
    again.load(made)
    assert dict(again) == {0x0112: 8}


def test_a_tiff_keeps_what_it_says_itself():
    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF", tiffinfo={0x010F: "Own", 305: "mine"}))
    exif.add_to_tiff(stream, full_exif(), 6, 7)
    with Image.open(stream) as picture:
        tags = picture.getexif()
        assert (tags[0x010F], tags[0x0110], tags[0x0131]) == ("Own", "Model 1", "mine")
