"""TIFF directories: read, written and carried over, even damaged ones."""

import io
import struct
import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.drawn_photos import drawn, encoded
from support.tagged_files import (
    full_exif,
)
from unshutter.photo import directories, exif

EXIF, GPS, INTEROPERABILITY = 0x8769, 0x8825, 0xA005
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 7: 1, 9: 4, 10: 8, 12: 8}


def check_plain_tiff(stream, pixels):
    """Pillow reads these pixels, whatever it says of the tags."""
    with warnings.catch_warnings(action="ignore"), Image.open(stream) as picture:
        np.testing.assert_array_equal(np.asarray(picture), pixels)


def trees(depth=0):
    plain = st.sampled_from(sorted(SIZES)).flatmap(
        lambda kind: st.integers(1, 9).flatmap(
            lambda count: st.binary(min_size=SIZES[kind] * count, max_size=SIZES[kind] * count).map(
                lambda data: directories.Entry(kind, count, data)
            )
        )
    )
    tags = st.sampled_from([0x010E, 0x010F, 0x0110, 0x0132, 0x8298, 0x9C9B] if depth == 0 else range(1, 0x7000))
    plain = st.dictionaries(tags, plain, min_size=1, max_size=6)
    if depth == 2:
        return plain
    if depth == 1:
        return st.tuples(plain, trees(2)).map(lambda t: t[0] | {INTEROPERABILITY: t[1]})
    return st.tuples(plain, trees(1), trees(2)).map(lambda t: t[0] | {EXIF: t[1], GPS: t[2]})


@settings(deadline=None, max_examples=30)
@given(trees(), st.sampled_from(["<", ">"]))
def test_directories_survive_blob_and_tiff(directory, order):
    blob = exif.of_tiff(directories.Tree(order, [directory]))
    assert blob is not None
    read = exif.read(blob)
    assert read is not None and read.order == order and read.pages == [directory]

    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF"))
    exif.add_to_tiff(stream, blob, 6, 7)
    check_plain_tiff(io.BytesIO(stream.getvalue()), drawn(6, 7))
    written = directories.read_tree(stream)
    assert written is not None
    again = exif.of_tiff(written)
    if order == "<":
        assert again == blob
    else:  # turned twice it is what it was
        plain = io.BytesIO(b"MM\0*\0\0\0\x08" + struct.pack(">HHHII", 1, 256, 4, 1, 7) + bytes(4))
        exif.add_to_tiff(plain, again, 6, 7)
        tree = directories.read_tree(plain)
        assert tree is not None and tree.pages[0] == directory | {256: directories.Entry(4, 1, b"\0\0\0\7")}


@settings(deadline=None, max_examples=80)
@given(st.data())
def test_damaged_directories_are_read_as_far_as_they_go(data):
    whole = bytearray(full_exif(data.draw(st.sampled_from(["<", ">"]))))
    for _ in range(data.draw(st.integers(1, 20))):
        whole[data.draw(st.integers(6, len(whole) - 1))] = data.draw(st.integers(0, 255))
    blob = bytes(whole[: data.draw(st.integers(7, len(whole)))])
    assert exif.focal_px(blob, 100, 100) is None or exif.focal_px(blob, 100, 100) > 0
    exif.with_size(blob, 30, 40)
    exif.with_orientation(blob, 6)
    assert not exif.has_thumbnail(exif.with_thumbnail(blob, None))
    exif.with_thumbnail(blob, b"a JPEG", 6)
    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF"))
    exif.add_to_tiff(stream, blob, 6, 7)
    check_plain_tiff(stream, drawn(6, 7))


def test_endless_directories_end():
    loop = b"II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, 256, 4, 1, 7) + struct.pack("<I", 8)
    tree = directories.read_tree(io.BytesIO(loop))
    assert tree is not None and len(tree.pages) == 1
    inside_itself = b"II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, EXIF, 4, 1, 8) + bytes(4)
    assert directories.read_tree(io.BytesIO(inside_itself)) is not None


def test_directories_that_share_their_values_take_no_more_memory_than_the_file_is_long():
    size, count = 60_000, 5000
    entries = b"".join(struct.pack("<HHII", 1000 + i, 7, size, 8) for i in range(count))
    data = b"II*\0" + struct.pack("<I", 8 + size) + bytes(size) + struct.pack("<H", count) + entries + bytes(4)
    tree = directories.read_tree(io.BytesIO(data))
    assert tree is not None
    held = sum(len(entry.data) for entry in tree.pages[0].values() if not isinstance(entry, dict))
    assert held <= 3 * len(data)


def test_many_tags_are_written_in_time_that_their_number_bounds():
    import time

    many = {tag: directories.Entry(7, 2000, bytes(2000)) for tag in range(1, 30_000)}
    start = time.process_time()
    written = directories.encoded(directories.in_other_order(many), 8, "<")
    assert time.process_time() - start < 5
    tree = directories.read_tree(io.BytesIO(b"II*\0\x08\0\0\0" + written))
    assert tree is not None and tree.pages[0] == many
