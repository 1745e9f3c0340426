"""AVIF: bit depth, orientation by its boxes, grey."""

import io
import struct

import numpy as np
import pytest
import pyvips
from PIL import Image

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import (
    full_exif,
)
from unshutter.photo import Photo, boxes


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


def test_the_file_is_the_same_however_many_threads_there_are():
    """Batches use one for each photo, a single photo all: the encoder would cut it into as many tiles."""
    photo, before = Photo.from_array(textured(512, 768)), pyvips.concurrency_get()
    try:
        made = []
        for threads in (1, 2, 8):
            pyvips.concurrency_set(threads)
            made.append(photo.to_bytes("avif"))
            assert pyvips.concurrency_get() == threads
    finally:
        pyvips.concurrency_set(before)
    assert made[0] == made[1] == made[2]


def box(name: bytes, content: bytes, size: int | None = None) -> bytes:
    """A box; with a size of 64 bits (1), or one that means all that follows (0)."""
    if size == 1:
        return struct.pack(">I4sQ", 1, name, 16 + len(content)) + content
    return struct.pack(">I4s", 8 + len(content) if size is None else size, name) + content


def with_moved_pixels(made: bytes, by: int) -> bytes:
    """The content of ``meta`` of an AVIF whose places count from 0, made right for pixels that moved."""
    meta = dict(boxes.inside(made))[b"meta"]
    at = meta.index(b"iloc") + 4
    assert meta[at] == 0 and meta[at + 4 : at + 6] == b"\x44\x00"  # version; offset and length of 32 bits, no base
    moved, at = bytearray(meta), at + 8
    for _ in range(struct.unpack_from(">H", meta, at - 2)[0]):
        (offset,) = struct.unpack_from(">I", meta, at + 6)
        struct.pack_into(">I", moved, at + 6, offset + by)
        at += 14
    return bytes(moved)


@pytest.mark.parametrize("kind", ["pixels first, 64 bits", "64 bits", "to the end"])
def test_boxes_of_every_size_are_read(kind: str) -> None:
    made = encoded(textured(48, 80), "AVIF", quality=95, exif=full_exif(orientation=6))
    whole = dict(boxes.inside(made))
    ftyp, mdat = box(b"ftyp", whole[b"ftyp"]), whole[b"mdat"]
    meta_bytes = len(whole[b"meta"])
    before = len(ftyp) + 8 + meta_bytes + 8
    if kind == "pixels first, 64 bits":
        data = ftyp + box(b"mdat", mdat, 1) + box(b"meta", with_moved_pixels(made, len(ftyp) + 16 - before))
    elif kind == "64 bits":
        data = ftyp + box(b"meta", with_moved_pixels(made, 8), 1) + box(b"mdat", mdat)
    else:
        data = ftyp + box(b"mdat", mdat) + box(b"meta", with_moved_pixels(made, len(ftyp) + 8 - before), 0)
    one, other = Photo.from_bytes(made), Photo.from_bytes(data)
    assert other.orientation == one.orientation == 6
    assert (other.height, other.width) == (48, 80)
    assert np.array_equal(other.pixels, one.pixels)
    assert boxes.read_coding(io.BytesIO(data)) == boxes.read_coding(io.BytesIO(made))


def test_boxes_that_make_no_sense_end_the_reading() -> None:
    for head in (struct.pack(">I4sQ", 1, b"meta", 3), struct.pack(">I4s", 7, b"meta"), struct.pack(">I4s", 1, b"meta")):
        assert boxes.read_coding(io.BytesIO(head)) == boxes.BoxCoding()
        assert list(boxes.inside(head)) == []
    many = struct.pack(">I4s", 8, b"free") * 1_000_000
    assert len(list(boxes.top_level_extents(io.BytesIO(many)))) <= 10_000


def test_exif_without_the_number_before_it_keeps_its_header() -> None:
    """Decoders skip four bytes, here the TIFF header's own."""
    photo = Photo.from_bytes(encoded(textured(48, 80), "JPEG", exif=full_exif(orientation=1)))
    data = photo.to_bytes("avif")
    told = boxes.extent(io.BytesIO(data), b"Exif")
    assert told is not None
    start, changed = told.at + 4 + 6, bytearray(data)  # behind the number and the prefix
    struct.pack_into(">II", changed, told.numbers_at, told.at - told.base + 10, told.length - 10)
    data, blob = bytes(changed), data[start : start + told.length - 10]
    again = Image.open(io.BytesIO(Photo.from_bytes(data).to_bytes())).getexif()
    assert again[0x010F] == Image.open(io.BytesIO(photo.to_bytes())).getexif()[0x010F]
    junk = data.replace(blob, bytes(len(blob)))
    assert Photo.from_bytes(junk).focal_px() is None
    assert not Image.open(io.BytesIO(Photo.from_bytes(junk).to_bytes())).getexif()
