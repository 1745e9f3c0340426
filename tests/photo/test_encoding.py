"""Encoding: what each format keeps of the pixels, and what it makes of them where it cannot."""

import io
import struct
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.JpegImagePlugin import get_sampling

from support.drawn_photos import drawn, encoded, textured
from support.fuzzing import memory
from support.tagged_files import (
    SRGB,
)
from unshutter.photo import Photo, boxes
from unshutter.photo.formats import WRITTEN

LOSSLESS = ("png", "tiff")


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("format", WRITTEN)
def test_round_trip_keeps_depth_bands_and_values(format, dtype, bands):
    kind, pixels = WRITTEN[format], drawn(bands=bands, dtype=dtype)
    photo = Photo.from_bytes(Photo.from_array(pixels).to_bytes(format, quality=95))
    back = photo.to_array().reshape(48, 80, -1)

    expected = pixels if kind.deep or dtype == np.uint8 else np.round(pixels / 257).astype(np.uint8)
    if bands in (2, 4) and not kind.alpha:  # over black
        opacity = expected[..., -1:] / np.iinfo(expected.dtype).max
        expected = np.round(expected[..., :-1] * opacity).astype(expected.dtype)
    if expected.shape[2] < 3 and not kind.grey:
        expected = np.concatenate([expected[..., :1]] * 3 + [expected[..., 1:]], axis=2)
    assert (photo.format, back.dtype, back.shape) == (format, expected.dtype, expected.shape)
    assert photo.has_alpha == (bands in (2, 4) and kind.alpha)
    if format in LOSSLESS:
        np.testing.assert_array_equal(back, expected)
    else:
        error = np.abs(back.astype(float) - expected) / np.iinfo(back.dtype).max
        assert error.mean() < 0.008 and error.max() < 0.06


@pytest.mark.parametrize("format", LOSSLESS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("bands", [1, 3, 4])
def test_other_programs_read_the_same_pixels(tmp_path, format, dtype, bands):
    pixels, path = drawn(bands=bands, dtype=dtype), tmp_path / f"a{WRITTEN[format].row.suffixes[0]}"
    Photo.from_array(pixels).save(path)
    if dtype == np.uint8:
        with Image.open(path) as picture:
            read = np.asarray(picture)
    else:
        order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[bands]
        read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).reshape(48, 80, -1)[..., order]
    np.testing.assert_array_equal(read.reshape(48, 80, -1), pixels)


def test_16_bits_become_8_by_rounding(tmp_path):
    ramp = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    path = tmp_path / "ramp.webp"
    lossless = Photo.from_bytes(encoded(np.zeros((8, 8, 3), np.uint8), "WEBP", lossless=True))
    lossless.with_pixels(ramp[..., None]).save(path)
    back = Photo.open(path).to_array()
    np.testing.assert_array_equal(back[..., 0], np.round(ramp / 257))


def test_palette_and_one_bit_pictures_become_plain_ones():
    colours = Image.fromarray(drawn()).quantize(16)
    stream = io.BytesIO()
    colours.save(stream, "PNG")
    photo = Photo.from_bytes(stream.getvalue())
    np.testing.assert_array_equal(photo.to_array(), np.asarray(colours.convert("RGB")))
    smooth = drawn()
    changed = Photo.from_bytes(photo.with_pixels(smooth).to_bytes())
    np.testing.assert_array_equal(changed.to_array(), smooth)  # not forced into a palette again

    for format in ("PNG", "TIFF"):
        stream, bits = io.BytesIO(), drawn(bands=1)[..., 0] > 128
        Image.fromarray(bits).save(stream, format)
        photo = Photo.from_bytes(stream.getvalue())
        np.testing.assert_array_equal(photo.to_array(), bits * np.uint8(255))
        changed = photo.with_pixels(drawn(bands=1))
        np.testing.assert_array_equal(Photo.from_bytes(changed.to_bytes()).to_array(), drawn(bands=1)[..., 0])


def linear_grey_profile():
    """An ICC profile of one channel whose tones are linear in light."""
    white = b"XYZ \0\0\0\0" + struct.pack(">iii", 0xF6D6, 0x10000, 0xD32D)
    curve = b"curv\0\0\0\0" + struct.pack(">I", 0)
    tags = [(b"wtpt", white), (b"kTRC", curve)]
    table, data = struct.pack(">I", len(tags)), b""
    for name, content in tags:
        table += struct.pack(">4sII", name, 128 + 4 + 12 * len(tags) + len(data), len(content))
        data += content
    head = struct.pack(">I4sI4s4s4s", 132 + len(tags) * 12 + len(data), bytes(4), 0x02100000, b"mntr", b"GRAY", b"XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + struct.pack(">iii", 0xF6D6, 0x10000, 0xD32D)
    return head.ljust(128, b"\0") + table + data


@pytest.mark.parametrize("alpha", [False, True])
def test_grey_with_a_profile_keeps_its_tones_where_only_colour_fits(alpha):
    levels = np.linspace(0, 1, 256)[None].repeat(16, 0)
    pixels = np.round(levels * 255).astype(np.uint8)
    pixels = np.dstack([pixels, 255 - pixels]) if alpha else pixels
    picture = Image.fromarray(pixels, "LA") if alpha else Image.fromarray(pixels)
    stream = io.BytesIO()
    picture.save(stream, "PNG", icc_profile=linear_grey_profile())
    photo = Photo.from_bytes(stream.getvalue())
    with Image.open(io.BytesIO(photo.to_bytes("png"))) as kept:
        assert kept.info["icc_profile"] == linear_grey_profile() and kept.mode == ("LA" if alpha else "L")
    coloured = Photo.from_bytes(photo.to_bytes("webp", quality=100))
    srgb = np.where(levels <= 0.0031308, 12.92 * levels, 1.055 * levels ** (1 / 2.4) - 0.055) * 255
    seen = (levels > 0.05) & (levels < 0.98)
    assert np.abs(coloured.to_array()[..., 1] - srgb)[seen].max() < 5 and coloured.has_alpha == alpha
    with Image.open(io.BytesIO(photo.to_bytes("webp"))) as picture:
        assert picture.info["icc_profile"][16:20] == b"RGB "


@pytest.mark.parametrize("target", WRITTEN)
def test_a_profile_of_other_channels_is_dropped(target):
    photo = Photo.from_bytes(encoded(drawn(bands=1)[..., 0], "JPEG", icc_profile=SRGB))
    data = photo.to_bytes(target)
    with Image.open(io.BytesIO(data)) as picture:
        profile = picture.info.get("icc_profile")
    assert profile is None or profile[16:20] == (b"GRAY" if Photo.from_bytes(data).bands < 3 else b"RGB ")


@pytest.mark.parametrize("given", ["4:4:4", "4:2:0"])
@pytest.mark.parametrize("told", ["4:4:4", "4:2:0", None])
def test_subsampling_is_the_inputs_unless_told(given: str, told) -> None:
    photo = Photo.from_bytes(encoded(textured(48, 80), "JPEG", subsampling=given))
    with Image.open(io.BytesIO(photo.to_bytes(subsampling=told))) as picture:
        assert get_sampling(picture) == {"4:4:4": 0, "4:2:0": 2}[told or given]
    avif = io.BytesIO(photo.to_bytes("avif", subsampling=told))
    assert boxes.read_coding(avif).subsampled == ((told or given) == "4:2:0")


@pytest.mark.skipif(sys.platform != "linux", reason="the peak can only be lowered on Linux")
def test_what_the_avif_encoder_used_goes_back_to_the_system() -> None:
    photo = Photo.from_array(textured(1200, 1600))
    before = memory()
    for _ in range(5):
        photo.to_bytes("avif")
    assert memory() - before < 60_000_000
