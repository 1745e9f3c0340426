"""Thumbnails follow new pixels."""

import io
import struct

import numpy as np
import pytest
from PIL import Image

from support.drawn_photos import drawn, encoded
from support.tagged_files import (
    EXIF,
    blob_with_thumbnail,
    exif_blob,
    jpeg_thumbnail,
    jpeg_with,
    small_jpeg,
)
from unshutter.photo import Photo, exif
from unshutter.photo.formats import WRITTEN


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("target", WRITTEN)
def test_the_thumbnail_shows_the_new_pixels(target: str, order: str) -> None:
    before = drawn(300, 400)
    photo = Photo.from_bytes(encoded(before, "JPEG", quality=95, exif=blob_with_thumbnail(order)))
    after = np.ascontiguousarray(255 - before[20:220, 30:330])
    data = photo.with_pixels(after).to_bytes(target)
    assert small_jpeg()[-200:] not in data
    with Image.open(io.BytesIO(data)) as picture:
        exif = picture.info.get("exif")
    if target == "tiff":  # a TIFF's second directory is another page
        assert exif is None
        return
    shown = jpeg_thumbnail(exif)
    assert shown.size == (160, 107)
    expected = Image.fromarray(after).resize(shown.size, Image.Resampling.BOX)
    assert np.abs(np.asarray(shown).astype(int) - np.asarray(expected)).mean() < 4


@pytest.mark.parametrize("pixels", [drawn(bands=1), drawn(bands=4), drawn(bands=3, dtype=np.uint16)], ids=str)
def test_thumbnails_of_all_kinds_of_pixels(pixels: np.ndarray) -> None:
    photo = Photo.from_bytes(encoded(drawn(), "PNG", exif=blob_with_thumbnail()))
    data = photo.with_pixels(pixels).to_bytes("png")
    with Image.open(io.BytesIO(data)) as picture:
        picture.load()
        shown = jpeg_thumbnail(picture.info["exif"])
    assert shown.size == (80, 48)  # not enlarged
    assert abs(int(np.asarray(shown)[..., 0].mean()) - 128) < 40


def test_a_photo_that_is_only_copied_keeps_its_thumbnail() -> None:
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob_with_thumbnail()))
    assert small_jpeg() in photo.to_bytes() and small_jpeg() in photo.to_bytes("png")


def test_a_photo_without_a_thumbnail_gets_none() -> None:
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=exif_blob()))
    with Image.open(io.BytesIO(photo.with_pixels(~photo.pixels).to_bytes())) as picture:
        assert jpeg_thumbnail(picture.info["exif"]) is None


def test_where_there_is_no_room_the_thumbnail_goes() -> None:
    note = bytes(range(256)) * 240
    tags = Image.Exif()
    tags.get_ifd(EXIF)[0x927C] = note
    blob = exif.with_thumbnail(tags.tobytes(), small_jpeg())
    assert len(blob) < 65_000 and jpeg_thumbnail(blob) is not None
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob))
    changed = photo.with_pixels(np.random.default_rng(1).integers(0, 256, (200, 300, 3)).astype(np.uint8))
    for format in ("jpeg", "webp"):
        made = changed.encode(format)
        assert made.left_out == ("thumbnail",)
        with Image.open(io.BytesIO(made.data)) as picture:
            assert jpeg_thumbnail(picture.info["exif"]) is None
            assert picture.getexif().get_ifd(EXIF)[0x927C] == note


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tag_that_stands_twice_does_not_keep_the_old_thumbnail(order: str) -> None:
    blob = blob_with_thumbnail(order)
    entry = struct.pack(order + "HHIHH", 0x0112, 3, 1, 1, 0)
    added = bytearray(blob[:8] + bytes(6) + blob[14:])  # the first directory again, at the end, with a tag twice
    struct.pack_into(order + "I", added, 10, len(blob) - 6 + len(blob) % 2)
    blob = bytes(added[:6]) + blob[6:10] + bytes(added[10:]) + bytes(len(blob) % 2)
    (link,) = struct.unpack_from(order + "I", blob_with_thumbnail(order), 6 + 8 + 2 + 12)
    blob += struct.pack(order + "H", 2) + entry + entry + struct.pack(order + "I", link)
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob))
    data = photo.with_pixels(~photo.pixels).to_bytes()
    assert small_jpeg()[-200:] not in data
    with Image.open(io.BytesIO(data)) as picture:
        assert jpeg_thumbnail(picture.info["exif"]).size == (80, 48)


def test_a_second_exif_does_not_keep_the_old_thumbnail() -> None:
    second = (0xE1, blob_with_thumbnail())
    photo = Photo.from_bytes(jpeg_with(drawn(), second, second))
    assert small_jpeg()[-200:] not in photo.with_pixels(~photo.pixels).to_bytes()
