"""Videos behind JPEGs: kept whole in the rectified photo, wherever a phone has put them."""

import io
import shutil
import struct
import subprocess

import numpy as np
import pytest

from support.drawn_photos import encoded, textured
from support.motion_photos import DEPTHS, TIME, VERSION, VIDEO, VIDEO_BLOCK, item, motion_photo, packet, trailer
from unshutter import Photo, RowMotion
from unshutter.cli import main
from unshutter.photo.embedded_video import appended_video

WHOLE = trailer(TIME, VIDEO_BLOCK, VERSION)


def drawn() -> np.ndarray:
    return textured(96, 128)


def samsung(video_length: int, padding: int, end: bytes) -> bytes:
    """A motion photo as newer phones write it: with Google's XMP and Samsung's trailer."""
    items = item("Primary", 0).replace('Padding="7"', f'Padding="{padding}"')
    items += item("MotionPhoto", video_length, "video/mp4").replace('Padding="7"', 'Padding="0"')
    return motion_photo(drawn(), packet(items, 'Cam:MotionPhoto="1"'), end)


def picture_end(data: bytes) -> int:
    """Where the picture of a JPEG ends; none of the things behind it in these tests holds such bytes."""
    return data.index(b"\xff\xd9\0\0") + 2


# ---- rectified, from end to end ----------------------------------------------------------------------------


@pytest.mark.parametrize("end", [VIDEO, WHOLE])
def test_a_rectified_motion_photo_still_has_its_video(tmp_path, end):
    told = len(end) - end.index(VIDEO)
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(motion_photo(drawn(), packet("", f'Cam:MicroVideo="1" Cam:MicroVideoOffset="{told}"'), end))
    motion = tmp_path / "motion.json"
    RowMotion.from_polynomials([0, 9], [0], 96, 128).save(motion)
    out = tmp_path / "out.jpg"
    assert main(["rectify", str(photo), "-o", str(out), "--motion", str(motion), "--edges", "keep"]) == 0
    assert not np.array_equal(Photo.open(out).pixels, Photo.open(photo).pixels)
    data = out.read_bytes()
    assert data.endswith(b"\xff\xd9" + end)
    assert data[len(data) - told :].startswith(VIDEO)  # where the XMP says it is
    assert b'MicroVideoOffset="%d"' % told in data


# ---- Samsung's trailer -------------------------------------------------------------------------------------


def test_the_trailer_alone_makes_a_motion_photo():
    data = encoded(drawn(), "JPEG") + WHOLE
    photo = Photo.from_bytes(data)
    file = photo.with_pixels(~photo.pixels).encode()
    assert file.data.endswith(b"\xff\xd9" + WHOLE) and file.left_out == ()
    assert photo.encode("png").left_out == ("film",)


def test_blocks_that_were_true_of_the_old_pixels_go():
    photo = Photo.from_bytes(encoded(drawn(), "JPEG") + trailer(DEPTHS, TIME, VIDEO_BLOCK, DEPTHS, VERSION))
    file = photo.with_pixels(~photo.pixels).encode()
    assert file.data.endswith(b"\xff\xd9" + WHOLE)
    assert file.left_out == ("depth map",)


@pytest.mark.parametrize("reaches_the_end", [True, False])
def test_xmp_says_where_the_video_is_after_blocks_are_gone(reaches_the_end):
    end = trailer(TIME, DEPTHS, VIDEO_BLOCK, DEPTHS)
    told = len(end) - end.index(VIDEO) if reaches_the_end else len(VIDEO)
    photo = Photo.from_bytes(samsung(told, end.index(VIDEO), end))
    data = photo.with_pixels(~photo.pixels).to_bytes()
    kept = trailer(TIME, VIDEO_BLOCK)
    assert data.endswith(b"\xff\xd9" + kept)
    padding, length = kept.index(VIDEO), len(kept) - kept.index(VIDEO) if reaches_the_end else len(VIDEO)
    assert b'Item:Padding="%d"' % padding in data and b'Item:Length="%d"' % length in data
    if reaches_the_end:
        assert data[-length:].startswith(VIDEO)
    assert data[picture_end(data) + padding :].startswith(VIDEO)


def damaged(change):
    whole = bytearray(WHOLE)
    at = whole.index(b"SEFH")
    change(whole, at)
    return bytes(whole)


def _number(offset, value):
    return lambda whole, at: struct.pack_into("<I", whole, at + offset, value)


@pytest.mark.parametrize(
    "end",
    [
        b"SEFT",
        struct.pack("<I", 12) + b"SEFT",
        struct.pack("<I", 0xFFFFFFFF) + b"SEFT",
        damaged(_number(8, 1000)),  # blocks
        damaged(_number(16, 1 << 30)),  # how far before the directory the first one begins
        damaged(_number(20, 1 << 30)),  # its size
        damaged(_number(20, len(TIME) + 1)),  # it overlaps the next one
        damaged(lambda whole, at: struct.pack_into("<I", whole, 4, 10_000)),  # its name's length
        trailer(TIME, VERSION),
        trailer(VIDEO_BLOCK.replace(b"ftyp", b"fake")),
    ],
)
def test_what_is_no_trailer_with_a_video_is_left_alone(end):
    data = encoded(drawn(), "JPEG") + end
    assert appended_video(io.BytesIO(data), None) is None
    assert Photo.from_bytes(data).to_bytes().endswith(b"\xff\xd9")


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="needs exiftool")
def test_exiftool_finds_the_video(tmp_path):
    photo = Photo.from_bytes(encoded(drawn(), "JPEG") + trailer(DEPTHS, TIME, VIDEO_BLOCK, VERSION))
    path = tmp_path / "out.jpg"
    photo.with_pixels(~photo.pixels).save(path)
    found = subprocess.run(["exiftool", "-b", "-EmbeddedVideoFile", path], capture_output=True, check=True).stdout
    assert found == VIDEO
