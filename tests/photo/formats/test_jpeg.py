"""JPEG: quality and subsampling like the input's, damage told from oddities, no room for long EXIF."""

import io

import numpy as np
import pytest
from PIL import Image
from PIL.JpegImagePlugin import get_sampling

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import EXIF, GPS
from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.photo.formats import WRITTEN, jpeg
from unshutter.photo.formats.picture_format import Coding


@pytest.mark.parametrize("quality", [5, 30, 49, 50, 75, 87, 92, 96, 100])
@pytest.mark.parametrize(("subsampling", "expected"), [("4:4:4", 0), ("4:2:2", 0), ("4:2:0", 2)])
def test_jpeg_is_saved_in_the_quality_it_came_in(quality, subsampling, expected):
    data = encoded(textured(48, 80), "JPEG", quality=quality, subsampling=subsampling)
    photo = Photo.from_bytes(data)
    saved = [Image.open(io.BytesIO(d)) for d in (data, photo.to_bytes(), photo.to_bytes(quality=60))]
    before, after, told = (picture.quantization for picture in saved)
    assert after == before and told != before
    assert get_sampling(saved[1]) == expected


def test_jpeg_quality_of_every_file_pillow_writes():
    for quality in range(1, 101):
        data = encoded(drawn(8, 8), "JPEG", quality=quality)
        assert jpeg.read_coding(io.BytesIO(data)).quality == quality
    assert jpeg.read_coding(io.BytesIO(b"\xff\xd8\xff\xda\0\4")) == Coding()


def test_a_jpeg_with_a_hole_is_damaged_but_harmless_oddities_are_not():
    data = encoded(textured(480, 640), "JPEG")
    holed = data[: len(data) // 2] + b"\xff\0" * 150 + data[len(data) // 2 + 300 :]  # ones only: no Huffman code
    with pytest.raises(UnshutterError, match="damaged or incomplete"):
        Photo.from_bytes(holed).to_array()
    scan = data.index(b"\xff\xda") + 11
    assert data[scan : scan + 3] == b"\0\x3f\0"  # first and last coefficient, bits
    padded, odd_header = data[:-2] + bytes(7) + data[-2:] + b"more", data[:scan] + b"\0\0\0" + data[scan + 3 :]
    for odd in (padded, odd_header):
        np.testing.assert_array_equal(Photo.from_bytes(odd).to_array(), Photo.from_bytes(data).to_array())
        np.testing.assert_array_equal(Photo.from_bytes(odd).grey(20), Photo.from_bytes(data).grey(20))


@pytest.mark.parametrize("target", WRITTEN)
def test_exif_too_long_for_a_jpeg_loses_the_makers_note_there_and_only_there(target: str) -> None:
    exif = Image.Exif()
    exif.update({0x010F: "Acme"})
    exif.get_ifd(EXIF).update({0x927C: bytes(80_000), 0x9003: "2024:05:06 07:08:09"})
    exif.get_ifd(GPS).update({1: "N", 2: (48.0, 51.0, 29.5)})
    data = Photo.from_bytes(encoded(drawn(), "PNG", exif=exif.tobytes())).to_bytes(target)
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
        assert tags[0x010F] == "Acme" and tags.get_ifd(GPS)[2] == (48.0, 51.0, 29.5)
        assert tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"
        assert (0x927C in tags.get_ifd(EXIF)) == (target != "jpeg")
