"""Damaged photos: a clear error or a picture of the size the file says, never a traceback, a hang or much memory.

UNSHUTTER_FUZZ_CASES=20000 python -m pytest tests/photo/test_fuzz.py
"""

import functools
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.drawn_photos import drawn, encoded
from support.fuzzing import check, damaged, thorough
from support.rich_files import COLUMNS, RAW, rich_file
from support.tagged_files import exif_blob
from unshutter.photo import Photo

MAX_PIXELS = 4_000_000


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


@functools.cache
def rich_files() -> dict[str, bytes]:
    """Files with all the metadata that their formats can have, by other programs; of both kinds of TIFF."""
    readable = {**COLUMNS}
    if not (find_spec("pi_heif") and find_spec("pillow_heif")):
        del readable["HEIC"]
    if not (find_spec("rawpy") and find_spec("tifffile")):
        del readable[RAW]
    files = {f"{column.partition(' ')[0].lower()}, rich": rich_file(column) for column in readable}
    files["tiff, big"] = encoded(drawn(), "TIFF", big_tiff=True, exif=exif_blob(6)[6:])
    return files


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


def check_photo(data: bytes, target: str | None = None) -> None:
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
        again = check(lambda: Photo.from_bytes(photo.to_bytes(target), max_pixels=MAX_PIXELS))
        if isinstance(again, Photo):
            assert (again.height, again.width) == (photo.height, photo.width)


@pytest.mark.parametrize("reader", ["jpeg", "png", "webp", "tiff", "avif", "heic", "raw"])
@thorough
@given(data=st.data())
def test_damaged_photos(reader: str, data: st.DataObject) -> None:
    files = [file for name, file in sorted((seeds() | rich_files()).items()) if name.partition(",")[0] == reader]
    if not files:
        pytest.skip(f"{reader} needs its extra, and what writes it")
    target = data.draw(st.sampled_from([None, "jpeg", "png", "webp", "tiff", "avif"]))
    check_photo(damaged(data.draw, data.draw(st.sampled_from(files))), target)


@thorough
@given(st.sampled_from([data[:size] for data in seeds().values() for size in (4, 12, 32, 80)]), st.binary(max_size=300))
def test_beginnings_of_photos_with_anything_after(beginning: bytes, rest: bytes) -> None:
    check_photo(beginning + rest)
