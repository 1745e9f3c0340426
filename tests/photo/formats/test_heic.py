"""HEIC: what is read from it, and where that goes."""

import io
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.camera_files import heic
from support.drawn_photos import drawn, one_line
from support.tagged_files import (
    EXIF,
    RATED_XMP,
    SRGB,
    check_rich_exif,
    exif_blob,
    rich_exif,
)
from unshutter.errors import UnshutterError
from unshutter.photo import Photo


@pytest.mark.parametrize("bands", [1, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_heic_of_all_kinds_of_pixels(bands: int, dtype: type) -> None:
    pixels = drawn(64, 96, bands=bands, dtype=dtype)
    photo = Photo.from_bytes(heic(pixels[..., 0] if bands == 1 else pixels))
    assert (photo.format, photo.height, photo.width, photo.bands) == ("heic", 64, 96, bands)
    read = photo.pixels
    assert read.dtype == dtype and read.shape == pixels.shape
    assert np.abs(read.astype(float) - pixels).mean() / np.iinfo(dtype).max < 0.01
    again = Photo.from_bytes(photo.to_bytes(quality=95))  # as AVIF
    assert again.format == "avif" and again.pixels.dtype == dtype and again.has_alpha == (bands == 4)
    if dtype == np.uint16:
        assert np.all(read % 64 == 0) and np.all(again.pixels % 64 == 0)  # 10 bits, and no more


def test_heic_gives_its_metadata_to_every_format() -> None:
    photo = Photo.from_bytes(
        heic(drawn(64, 96), exif=rich_exif(6), icc_profile=SRGB, icc_profile_type="prof", xmp=RATED_XMP)
    )
    assert photo.orientation == 6 and photo.focal_px() == pytest.approx(26 / 43.2666 * np.hypot(64, 96), rel=1e-4)
    for target in ("jpeg", "png", "webp", "tiff", "avif"):
        data = photo.with_pixels(~photo.pixels).to_bytes(target)
        check_rich_exif(data)
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.info["icc_profile"] == SRGB
            assert b'xmp:Rating="4"' in (picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode())
        assert Photo.from_bytes(data).orientation == 6


def test_exif_without_the_number_before_it() -> None:
    """Decoders skip four bytes nevertheless: of the header, which is known."""
    blob = exif_blob(6)
    data = heic(drawn(), exif=blob)
    assert data.count(b"\0\0\0\6" + blob) == 1
    bare = Photo.from_bytes(data.replace(b"\0\0\0\6" + blob, blob[6:] + bytes(10)))
    pictures = (Image.open(io.BytesIO(photo.to_bytes("jpeg"))) for photo in (bare, Photo.from_bytes(data)))
    restored, usual = (dict(picture.getexif()) for picture in pictures)
    assert restored == usual and usual
    assert bare.encode("jpeg").left_out == ()
    odd = Photo.from_bytes(data.replace(b"\0\0\0\6" + blob, bytes(len(blob) + 4)))
    assert odd.encode("jpeg").left_out == ("EXIF (damaged)",)


def test_exif_that_goes_round_in_circles_goes_no_further() -> None:
    loop = struct.pack("<HHHI4sHHII", 2, 0x010F, 2, 4, b"Own\0", EXIF, 4, 1, 8) + struct.pack("<I", 8)
    photo = Photo.from_bytes(heic(drawn(64, 96), exif=b"Exif\0\0II*\0\x08\0\0\0" + loop))
    result = photo.encode()
    assert result.left_out == ("EXIF (damaged)",) and loop not in result.data
    with Image.open(io.BytesIO(result.data)) as picture:
        assert picture.getexif()[0x010F] == "Own"


@pytest.mark.parametrize("kind", [b"iden", b"grid", b"iovl"])
def test_a_picture_that_is_made_of_itself_is_refused(kind: bytes) -> None:
    data = bytearray(heic(drawn(64, 96)))
    at = data.index(b"hvc1", data.index(b"infe"))
    data[at : at + 4] = kind
    at = data.index(b"cdsc")  # EXIF is about the picture
    (picture,) = struct.unpack_from(">H", data, at + 8)
    struct.pack_into(">4sHHH", data, at, b"dimg", picture, 1, picture)
    start = time.process_time()
    with pytest.raises(UnshutterError, match="damaged, incomplete or unusual"):
        Photo.from_bytes(bytes(data))
    assert time.process_time() - start < 5


@pytest.mark.parametrize("kept", [0.2, 0.6, 0.97])
def test_truncated_heic_is_refused(tmp_path: Path, kept: float) -> None:
    data = heic(drawn(200, 300))
    path = tmp_path / "a.heic"
    path.write_bytes(data[: int(len(data) * kept)])
    with pytest.raises(UnshutterError) as error:
        Photo.open(path).save(tmp_path / "a.png")
    assert "damaged" in one_line(error) and str(path) in str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.heic"]


def test_headers_that_contradict_each_other_are_refused() -> None:
    data = bytearray(heic(drawn(96, 160)))
    data[data.index(b"hvcC") + 4 + 17] += 2  # 10 bits per sample, and 8 in another header
    with pytest.raises(UnshutterError, match="its headers contradict each other") as error:
        Photo.from_bytes(bytes(data))
    one_line(error)
