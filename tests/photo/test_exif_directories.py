"""EXIF and TIFF directories: read, written and carried over, even damaged ones."""

import io
import struct
import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.camera_files import full_exif
from support.drawn_photos import drawn, encoded
from unshutter.photo import Photo, metadata, new_pixels

EXIF, GPS, INTEROPERABILITY = 0x8769, 0x8825, 0xA005
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 7: 1, 9: 4, 10: 8, 12: 8}


def check_plain_tiff(stream, pixels):
    """Pillow reads these pixels, whatever it says of the tags."""
    with warnings.catch_warnings(action="ignore"), Image.open(stream) as picture:
        np.testing.assert_array_equal(np.asarray(picture), pixels)


def directories(depth=0):
    plain = st.sampled_from(sorted(SIZES)).flatmap(
        lambda kind: st.integers(1, 9).flatmap(
            lambda count: st.binary(min_size=SIZES[kind] * count, max_size=SIZES[kind] * count).map(
                lambda data: metadata.Entry(kind, count, data)
            )
        )
    )
    tags = st.sampled_from([0x010E, 0x010F, 0x0110, 0x0132, 0x8298, 0x9C9B] if depth == 0 else range(1, 0x7000))
    plain = st.dictionaries(tags, plain, min_size=1, max_size=6)
    if depth == 2:
        return plain
    if depth == 1:
        return st.tuples(plain, directories(2)).map(lambda t: t[0] | {INTEROPERABILITY: t[1]})
    return st.tuples(plain, directories(1), directories(2)).map(lambda t: t[0] | {EXIF: t[1], GPS: t[2]})


@settings(deadline=None, max_examples=60)
@given(directories(), st.sampled_from(["<", ">"]))
def test_directories_survive_blob_and_tiff(directory, order):
    blob = metadata.exif_of_tiff(metadata.Tree(order, [directory]))
    assert blob is not None
    read = metadata.read_exif(blob)
    assert read is not None and read.order == order and read.pages == [directory]

    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF"))
    metadata.add_exif_to_tiff(stream, blob, 6, 7)
    check_plain_tiff(io.BytesIO(stream.getvalue()), drawn(6, 7))
    written = metadata.read_tree(stream)
    assert written is not None
    again = metadata.exif_of_tiff(written)
    if order == "<":
        assert again == blob
    else:  # turned twice it is what it was
        plain = io.BytesIO(b"MM\0*\0\0\0\x08" + struct.pack(">HHHII", 1, 256, 4, 1, 7) + bytes(4))
        metadata.add_exif_to_tiff(plain, again, 6, 7)
        tree = metadata.read_tree(plain)
        assert tree is not None and tree.pages[0] == directory | {256: metadata.Entry(4, 1, b"\0\0\0\7")}


@settings(deadline=None, max_examples=200)
@given(st.data())
def test_damaged_directories_are_read_as_far_as_they_go(data):
    whole = bytearray(full_exif(data.draw(st.sampled_from(["<", ">"]))))
    for _ in range(data.draw(st.integers(1, 20))):
        whole[data.draw(st.integers(6, len(whole) - 1))] = data.draw(st.integers(0, 255))
    blob = bytes(whole[: data.draw(st.integers(7, len(whole)))])
    assert metadata.focal_px(blob, 100, 100) is None or metadata.focal_px(blob, 100, 100) > 0
    new_pixels.exif_with_size(blob, 30, 40)
    new_pixels.exif_with_orientation(blob, 6)
    assert not new_pixels.has_thumbnail(new_pixels.exif_with_thumbnail(blob, None))
    new_pixels.exif_with_thumbnail(blob, b"a JPEG", 6)
    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF"))
    metadata.add_exif_to_tiff(stream, blob, 6, 7)
    check_plain_tiff(stream, drawn(6, 7))


def test_a_tiff_keeps_what_it_says_itself():
    stream = io.BytesIO(encoded(drawn(6, 7), "TIFF", tiffinfo={0x010F: "Own", 305: "mine"}))
    metadata.add_exif_to_tiff(stream, full_exif(), 6, 7)
    with Image.open(stream) as picture:
        tags = picture.getexif()
        assert (tags[0x010F], tags[0x0110], tags[0x0131]) == ("Own", "Model 1", "mine")


def test_big_tiff_is_left_alone():
    import pyvips

    big = pyvips.Image.new_from_array(drawn()).tiffsave_buffer(bigtiff=True)
    stream = io.BytesIO(big)
    metadata.add_exif_to_tiff(stream, full_exif(), 48, 80)
    assert stream.getvalue() == big
    photo = Photo.from_bytes(big)
    np.testing.assert_array_equal(photo.to_array(), drawn())
    np.testing.assert_array_equal(Photo.from_bytes(photo.to_bytes()).to_array(), drawn())


def test_endless_directories_end():
    loop = b"II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, 256, 4, 1, 7) + struct.pack("<I", 8)
    tree = metadata.read_tree(io.BytesIO(loop))
    assert tree is not None and len(tree.pages) == 1000
    inside_itself = b"II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, EXIF, 4, 1, 8) + bytes(4)
    assert metadata.read_tree(io.BytesIO(inside_itself)) is not None
