"""Damaged files: a clear error or a picture of the size the file says, never a traceback, a hang or much memory.

``UNSHUTTER_FUZZ_CASES`` says how many cases each test tries (300 by default); thousands take minutes:

    UNSHUTTER_FUZZ_CASES=20000 python -m pytest tests/photo/test_fuzz.py
"""

import faulthandler
import functools
import os
import sys
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from support.drawn_photos import drawn, encoded
from unshutter import Motion, RowMotion, UnshutterError
from unshutter.photo import Photo

CASES = int(os.environ.get("UNSHUTTER_FUZZ_CASES", "300"))
MAX_PIXELS = 4_000_000
MOST_MEMORY = 600_000_000  # bytes above what was used before: many times what a picture of 4 megapixels takes
HANG_S = 60
thorough = settings(
    max_examples=CASES, deadline=None, database=None, suppress_health_check=list(HealthCheck), derandomize=CASES <= 300
)


def with_metadata(**options) -> bytes:
    """A JPEG with EXIF, ICC and XMP by Pillow."""
    from PIL import Image, ImageCms

    exif = Image.Exif()
    exif[0x010F], exif[0x0112] = "Maker", 6
    exif.get_ifd(0x8769)[0xA405] = 28
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return encoded(drawn(), "JPEG", exif=exif, icc_profile=profile, xmp=b"<x:xmpmeta/>", **options)


@functools.cache
def seeds() -> dict[str, bytes]:
    """Whole files of every format and of many kinds."""
    files = {
        "jpeg": with_metadata(),
        "jpeg, progressive": with_metadata(progressive=True),
        "jpeg, grey": encoded(drawn(bands=1)[..., 0], "JPEG"),
        "png, palette": palette_png(),
        "tiff, lzw": encoded(drawn(), "TIFF", compression="tiff_lzw"),
        "tiff, jpeg": encoded(drawn(), "TIFF", compression="jpeg"),
        "webp, lossless": encoded(drawn(), "WEBP", lossless=True),
    }
    for bands in (1, 2, 3, 4):
        deep = Photo.from_array(drawn(bands=bands, dtype=np.uint16))
        files[f"png, 16 bit, {bands}"] = deep.to_bytes("png")
        files[f"tiff, 16 bit, {bands}"] = deep.to_bytes("tiff")
    rich = Photo.from_bytes(files["jpeg"])
    for format in ("png", "webp", "tiff", "avif"):
        files[format] = rich.to_bytes(format)
    return files | camera_files()


def camera_files() -> dict[str, bytes]:
    """HEIC and raw, where the extras and what writes them are installed."""
    from support.camera_files import dng, heic, linear

    files = {}
    if find_spec("pi_heif") and find_spec("pillow_heif"):
        files["heic"] = heic(drawn(), orientation=6, xmp=b"<x:xmpmeta/>")
        files["heic, 10 bit"] = heic(drawn(dtype=np.uint16))
        files["heic, alpha"] = heic(drawn(bands=4))
    if find_spec("rawpy") and find_spec("tifffile"):
        files["raw"] = dng(linear(drawn()), orientation=8)
    return files


def palette_png() -> bytes:
    import io

    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(drawn()).quantize(16).save(stream, "PNG")
    return stream.getvalue()


# ---- what happens to files -----------------------------------------------------------------------------------

Change = Callable[[bytearray, int, int, int], None]  # of a file, at a place, with a length and a value


def flip(data: bytearray, at: int, length: int, value: int) -> None:
    data[at] ^= 1 << value % 8


def noise(data: bytearray, at: int, length: int, value: int) -> None:
    data[at : at + length] = np.random.default_rng(value).bytes(min(length, len(data) - at))


def cut(data: bytearray, at: int, length: int, value: int) -> None:
    del data[at:]


def drop(data: bytearray, at: int, length: int, value: int) -> None:
    del data[at : at + length]


def double(data: bytearray, at: int, length: int, value: int) -> None:
    data[at:at] = data[at : at + length] * (1 + value % 50)


def extreme(data: bytearray, at: int, length: int, value: int) -> None:
    """A number that sizes, counts and offsets are seldom."""
    number = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFF0)[value % 10]
    size = (1, 2, 4, 8)[length % 4]
    order = "little" if value & 16 else "big"
    data[at : at + size] = (number & (1 << 8 * size) - 1).to_bytes(size, order)


CHANGES: tuple[Change, ...] = (flip, noise, cut, drop, double, extreme, extreme)


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A whole file with one to six changes, half of them within its first 400 bytes, where the headers are."""
    data = bytearray(draw(st.sampled_from(sorted(seeds().items())))[1])
    for _ in range(draw(st.integers(1, 6))):
        change = draw(st.sampled_from(CHANGES))
        end = max(min(len(data), 400) if draw(st.booleans()) else len(data), 1)
        at = draw(st.integers(0, end - 1))
        if data:
            change(data, min(at, len(data) - 1), draw(st.integers(1, 64)), draw(st.integers(0, 2**16)))
    return bytes(data)


# ---- what may come of it -------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def watched():
    """A hang ends the test run with the place where it hangs; the test itself cannot interrupt a decoder."""
    yield
    faulthandler.cancel_dump_traceback_later()


def peak_memory() -> int:
    """Bytes that this process ever used."""
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def check(read: Callable[[], object]) -> object:
    """What was read, or None after a clear refusal."""
    faulthandler.dump_traceback_later(HANG_S, exit=True, file=sys.__stderr__)
    before = peak_memory()
    try:
        result = read()
    except UnshutterError as error:
        result, message = None, str(error)
        assert 0 < len(message) < 5000  # it may quote what is wrong
        assert "\n" not in message
        assert "Traceback" not in message
    assert peak_memory() - before < MOST_MEMORY
    return result


def check_photo(data: bytes) -> None:
    def read() -> Photo:
        photo = Photo.from_bytes(data, max_pixels=MAX_PIXELS)
        assert photo.height * photo.width <= MAX_PIXELS
        pixels = photo.to_array()
        assert pixels.shape == ((photo.height, photo.width, photo.bands) if photo.bands > 1 else pixels.shape[:2])
        assert pixels.dtype in (np.uint8, np.uint16)
        photo.focal_px()
        assert photo.grey(32).dtype == np.uint8
        return photo

    photo = check(read)
    if isinstance(photo, Photo):  # what could be read can be written: its metadata, too, is as good as new
        again = check(lambda: Photo.from_bytes(photo.to_bytes(), max_pixels=MAX_PIXELS))
        if isinstance(again, Photo):
            assert (again.height, again.width) == (photo.height, photo.width)


@pytest.mark.parametrize("name", sorted(seeds()))
def test_the_files_are_whole_before_they_are_damaged(name: str) -> None:
    assert Photo.from_bytes(seeds()[name]).to_array().shape[:2] == (48, 80)


@thorough
@given(damaged())
def test_damaged_photos(data: bytes) -> None:
    check_photo(data)


@thorough
@given(st.sampled_from([data[:size] for data in seeds().values() for size in (4, 12, 32, 80)]), st.binary(max_size=300))
def test_beginnings_of_photos_with_anything_after(beginning: bytes, rest: bytes) -> None:
    check_photo(beginning + rest)


@thorough
@given(st.data())
def test_damaged_motion_files(data: st.DataObject) -> None:
    text = RowMotion.from_polynomials([0, 3, 1], [0, 0.01], 12, 16).to_json()
    at = data.draw(st.integers(0, len(text)))
    until = data.draw(st.integers(at, min(at + 40, len(text))))
    odd = st.sampled_from(["", "1e999", "-1", "null", "[]", "{}", '"', "NaN", "9" * 400, "[" * 3000, '"last"'])
    motion = check(lambda: Motion.from_json(text[:at] + data.draw(odd | st.text(max_size=20)) + text[until:]))
    if isinstance(motion, Motion):
        assert np.isfinite(motion.tx_px).all()
        assert len(motion.tx_px) == motion.height


# ---- bombs ---------------------------------------------------------------------------------------------------


def png_of(width: int, height: int, rows: int) -> bytes:
    """A PNG that says it is so large; the rows that there are compress to almost nothing."""
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    row = b"\0" * (1 + 3 * width)
    packer = zlib.compressobj(9)
    data = b"".join(packer.compress(row) for _ in range(rows)) + packer.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    "bomb",
    [
        png_of(30_000, 30_000, 1000),
        png_of(2_000_000_000, 2_000_000_000, 0),
        b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03\x01\x22\0\x02\x11\x01\x03\x11\x01" + b"\0" * 200,
    ],
    ids=["pixels that compress to nothing", "sizes beyond all", "jpeg of 65535 x 65535"],
)
def test_bombs_are_refused_before_they_go_off(bomb: bytes) -> None:
    with pytest.raises(UnshutterError):
        Photo.from_bytes(bomb, max_pixels=MAX_PIXELS)
    before = peak_memory()
    check_photo(bomb)
    assert peak_memory() - before < 50_000_000


def test_the_limit_can_be_raised() -> None:
    large = png_of(2100, 2000, 2000)
    with pytest.raises(UnshutterError, match="more than the limit of 4 megapixels"):
        Photo.from_bytes(large, max_pixels=MAX_PIXELS)
    assert Photo.from_bytes(large, max_pixels=5_000_000).to_array().shape == (2000, 2100, 3)
