"""WebP: lossless files stay so."""

import struct

import numpy as np
import pytest

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import SRGB, check_rich_exif, rich_exif
from unshutter.photo import Photo

PACKET = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF/></x:xmpmeta>'


@pytest.mark.parametrize("lossless", [False, True])
@pytest.mark.parametrize("extended", [False, True])  # with an ICC profile the coding is behind other chunks
def test_lossless_webp_stays_lossless(lossless, extended):
    more = {"icc_profile": SRGB + bytes(1 - len(SRGB) % 2)} if extended else {}  # of odd length: padded
    photo = Photo.from_bytes(encoded(textured(48, 80), "WEBP", lossless=lossless, **more))
    changed = photo.with_pixels(~photo.pixels)
    assert np.array_equal(Photo.from_bytes(changed.to_bytes()).to_array(), changed.to_array()) == lossless
    assert not np.array_equal(Photo.from_bytes(changed.to_bytes(quality=50)).to_array(), changed.to_array())


def with_chunk(data: bytes, name: bytes, content: bytes) -> bytes:
    """A WebP with one chunk more at its end."""
    data += name + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)
    return data[:4] + struct.pack("<I", len(data) - 8) + data[8:]


def test_xmp_is_read_however_its_chunk_is_spelt():
    extended = encoded(drawn(), "WEBP", icc_profile=SRGB)
    for name in (b"XMP ", b"XMP\0"):
        file = Photo.from_bytes(with_chunk(extended, name, PACKET)).encode("jpeg")
        assert PACKET in file.data and file.left_out == ()


def test_exif_that_the_header_does_not_announce_is_read():
    file = Photo.from_bytes(with_chunk(encoded(drawn(), "WEBP"), b"EXIF", rich_exif())).encode("jpeg")
    check_rich_exif(file.data)


def test_what_no_result_gets_is_named():
    data = encoded(drawn(), "WEBP", exif=rich_exif(), xmp=PACKET)
    assert Photo.from_bytes(data).encode().left_out == ()
    assert Photo.from_bytes(with_chunk(data, b"XMP\0", PACKET)).encode().left_out == ("other data",)
    assert Photo.from_bytes(with_chunk(data, b"EXIF", rich_exif())).encode().left_out == ("other data",)
    assert Photo.from_bytes(with_chunk(data, b"ABCD", b"own")).encode().left_out == ("other data",)
    assert Photo.from_bytes(data + bytes(9)).encode().left_out == ()  # fill
    assert Photo.from_bytes(data + b"of a program").encode().left_out == ("other data",)
