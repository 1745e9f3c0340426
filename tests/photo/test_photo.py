"""Photo: pixels in and out, and grey copies. Files and metadata have tests of their own (test_photo_*.py)."""

import io
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.drawn_photos import drawn, encoded, textured
from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.photo.codecs import WRITTEN
from unshutter.photo.decoding import grey_copy
from unshutter.storage import large_arrays

LOSSLESS = ("png", "tiff")


# ---- round trips ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("format", WRITTEN)
def test_round_trip_keeps_depth_bands_and_values(format, dtype, bands):
    codec, pixels = WRITTEN[format], drawn(bands=bands, dtype=dtype)
    photo = Photo.from_bytes(Photo.from_array(pixels).to_bytes(format, quality=95))
    back = photo.to_array().reshape(48, 80, -1)

    expected = pixels if codec.deep or dtype == np.uint8 else np.round(pixels / 257).astype(np.uint8)
    if bands in (2, 4) and not codec.alpha:  # over black
        opacity = expected[..., -1:] / np.iinfo(expected.dtype).max
        expected = np.round(expected[..., :-1] * opacity).astype(expected.dtype)
    if expected.shape[2] < 3 and not codec.grey:
        expected = np.concatenate([expected[..., :1]] * 3 + [expected[..., 1:]], axis=2)
    assert (photo.format, back.dtype, back.shape) == (format, expected.dtype, expected.shape)
    assert photo.has_alpha == (bands in (2, 4) and codec.alpha)
    if format in LOSSLESS:
        np.testing.assert_array_equal(back, expected)
    else:
        error = np.abs(back.astype(float) - expected) / np.iinfo(back.dtype).max
        assert error.mean() < 0.008 and error.max() < 0.06


@pytest.mark.parametrize("format", LOSSLESS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("bands", [1, 3, 4])
def test_other_programs_read_the_same_pixels(tmp_path, format, dtype, bands):
    pixels, path = drawn(bands=bands, dtype=dtype), tmp_path / f"a{WRITTEN[format].suffixes[0]}"
    Photo.from_array(pixels).save(path)
    if dtype == np.uint8:
        with Image.open(path) as picture:
            read = np.asarray(picture)
    else:
        order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[bands]
        read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).reshape(48, 80, -1)[..., order]
    np.testing.assert_array_equal(read.reshape(48, 80, -1), pixels)


@settings(deadline=None, max_examples=25)
@given(
    st.integers(1, 40), st.integers(1, 40), st.integers(1, 4), st.sampled_from([np.uint8, np.uint16]), st.integers(0)
)
def test_any_size_survives_png_and_tiff(height, width, bands, dtype, seed):
    top = np.iinfo(dtype).max + 1
    pixels = np.random.default_rng(seed).integers(0, top, (height, width, bands)).astype(dtype)
    for format in LOSSLESS:
        back = Photo.from_bytes(Photo.from_array(pixels).to_bytes(format)).to_array()
        np.testing.assert_array_equal(back.reshape(pixels.shape), pixels)


def test_16_bits_become_8_by_rounding(tmp_path):
    ramp = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    path = tmp_path / "ramp.webp"
    lossless = Photo.from_bytes(encoded(np.zeros((8, 8, 3), np.uint8), "WEBP", lossless=True))
    lossless.with_pixels(ramp[..., None]).save(path)
    back = Photo.open(path).to_array()
    np.testing.assert_array_equal(back[..., 0], np.round(ramp / 257))


@pytest.mark.parametrize(("bits", "step"), [(10, 64), (12, 16)])
def test_avif_keeps_its_bit_depth(bits, step):
    import pyvips

    pixels = drawn(bands=3, dtype=np.uint16)
    made = pyvips.Image.new_from_array(pixels).copy(interpretation="rgb16")
    photo = Photo.from_bytes(made.heifsave_buffer(compression="av1", bitdepth=bits, Q=95))
    again = Photo.from_bytes(photo.to_bytes(quality=95)).to_array()
    assert again.dtype == np.uint16
    assert np.all(again % step == 0) and np.any(again % (2 * step))  # as many bits as before, and no more
    assert Photo.from_bytes(Photo.from_array(pixels).to_bytes("avif")).to_array().max() % 16 == 0  # 12 by default


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


def test_arrays_are_copied_and_shapes_kept():
    pixels = drawn(bands=1)[..., 0].copy()
    photo = Photo.from_array(pixels)
    pixels[:] = 0
    assert photo.to_array().max() > 0 and photo.to_array().shape == (48, 80)
    assert (photo.format, photo.orientation, photo.path, photo.focal_px()) == ("array", 1, None, None)
    assert Photo.from_array(drawn()[::2, ::-3]).to_array().shape == (24, 27, 3)  # not contiguous


@pytest.mark.parametrize("format", ["JPEG", "PNG", "TIFF"])
def test_pictures_too_large_for_memory_are_decoded_all_the_same(format, monkeypatch):
    monkeypatch.setattr(large_arrays, "SPILL_BYTES", 1000)
    pixels = textured(300, 200)
    photo = Photo.from_bytes(encoded(pixels, format, **({"quality": 95} if format == "JPEG" else {})))
    assert np.abs(photo.to_array().astype(int) - pixels).mean() <= (5 if format == "JPEG" else 0)
    assert isinstance(photo.pixels, np.memmap)
    assert photo.image(199, 299) == photo.to_array()[299, 199].tolist() and photo.image(0, 0)


def test_pixels_are_decoded_once_and_kept_as_they_are():
    photo = Photo.from_bytes(encoded(drawn(), "JPEG"))
    assert photo.pixels is photo.pixels
    with pytest.raises(ValueError, match="read-only"):
        photo.pixels[0, 0] = 0
    assert photo.image(79, 47) == photo.to_array()[47, 79].tolist() and photo.image(0, 0)
    for short in (12, None, 20):
        photo.grey(short)
    np.testing.assert_array_equal(photo.to_array(), np.asarray(Image.open(io.BytesIO(photo.to_bytes("png")))))


# ---- grey copies ---------------------------------------------------------------------------------------


def area_average(luminance, height, width):
    """Mean over each target pixel's area, by exact overlaps."""

    def overlaps(source, target):
        edges = np.arange(target + 1) * source / target
        cells = np.arange(source)
        low = np.maximum(edges[:-1, None], cells)
        high = np.minimum(edges[1:, None], cells + 1)
        return np.maximum(high - low, 0) * target / source

    return overlaps(luminance.shape[0], height) @ luminance @ overlaps(luminance.shape[1], width).T


@pytest.mark.parametrize("format", ["jpeg", "png", "array"])
@pytest.mark.parametrize("size", [(480, 640), (641, 483), (1001, 777)])
@pytest.mark.parametrize("short", [64, 100, 301])
def test_grey_agrees_with_an_area_average(format, size, short):
    photo = Photo.from_array(textured(*size))
    photo = photo if format == "array" else Photo.from_bytes(photo.to_bytes(format, quality=98))
    luminance = photo.to_array().astype(float) @ [0.299, 0.587, 0.114]
    grey = photo.grey(short)
    assert grey.dtype == np.uint8 and grey.flags.c_contiguous
    assert min(grey.shape) == short or (format == "jpeg" and 0.9 * short < min(grey.shape) < short)
    assert abs(max(grey.shape) - max(size) * min(grey.shape) / min(size)) <= 1
    difference = grey - area_average(luminance, *grey.shape)
    most = 11 if min(grey.shape) == short else 14  # half a pixel off at the end
    assert abs(difference.mean()) < 0.8 and np.abs(difference).mean() < 2 and np.abs(difference).max() < most


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("size", [(1000, 1501), (1007, 1333), (803, 1201)])
@pytest.mark.parametrize("axis", [0, 1])
def test_grey_puts_positions_where_its_docstring_says(size, kind, axis):
    """Slopes up and down move apart where positions are off; also where JPEG's blocks do not divide the size."""
    length = size[axis]
    slope = np.broadcast_to(np.expand_dims(np.linspace(20, 235, length), 1 - axis), size)
    up, down = (Photo.from_bytes(encoded(np.round(a).astype(np.uint8), kind)) for a in (slope, 255 - slope))
    for short in (100, 160, 333):
        ends = []
        for photo in (up, down):
            profile = photo.grey(short).mean(axis=1 - axis)
            at = (np.arange(profile.size) + 0.5) * length / profile.size - 0.5
            expected = 20 + at * 215 / (length - 1)
            error = profile - (expected if photo is up else 255 - expected)
            line = np.polynomial.Polynomial.fit(at[3:-3], error[3:-3], 1)  # rounding averages out
            ends.append(np.array([line(0), line(length)]))
        off = (ends[0] - ends[1]) / 2 / (215 / profile.size)
        assert np.abs(off).max() < 0.5


def test_grey_is_never_enlarged_and_full_size_without_a_size():
    photo = Photo.from_bytes(encoded(drawn(), "JPEG"))
    expected = photo.to_array().astype(float) @ [0.299, 0.587, 0.114]
    for asked in (None, 48, 5000):
        np.testing.assert_allclose(photo.grey(asked), expected, atol=0.51)


def test_grey_of_16_bits_and_of_grey_pictures():
    deep = textured(300, 400, 1, np.uint16)
    shallow = np.round(deep / 257).astype(np.uint8)
    for short in (None, 90):
        a, b = Photo.from_array(deep).grey(short), Photo.from_array(shallow).grey(short)
        assert np.abs(a.astype(int) - b).max() <= 1


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_of_transparent_places_is_mid_grey(dtype):
    pixels = np.full((64, 64, 4), np.iinfo(dtype).max, dtype)
    pixels[:, 32:, 3] = 0
    grey = Photo.from_array(pixels).grey(32)
    assert np.all(grey[:, :14] == 255) and np.all(np.abs(grey[:, 18:].astype(int) - 128) <= 1)


@pytest.mark.parametrize("size", [(1200, 1600), (1207, 1601)])
@pytest.mark.parametrize("short", [140, 150, 160, 300, 599, 700])
def test_grey_is_nearly_the_same_for_a_jpeg_and_for_its_pixels(size, short):
    """The JPEG is decoded at a part of its size."""
    photo = Photo.from_bytes(Photo.from_array(textured(*size)).to_bytes("jpeg"))
    grey = photo.grey(short).astype(int)
    difference = grey - grey_copy(photo.image, *grey.shape)
    assert np.abs(difference).mean() < 0.8 and np.abs(difference).max() < 9
    np.testing.assert_array_equal(photo.grey(short), grey)  # the pixels are known by now


def test_decoding_ahead_gives_the_same_pixels():
    data = encoded(textured(300, 200), "JPEG")
    with ThreadPoolExecutor(1) as executor:
        for given in (None, executor):
            photo = Photo.from_bytes(data)
            photo.start_decoding(given)
            photo.start_decoding(given)
            np.testing.assert_array_equal(photo.pixels, Photo.from_bytes(data).pixels)


def test_damage_found_ahead_is_told_where_pixels_are_asked_for():
    data = encoded(textured(300, 200), "JPEG")
    for _ in range(20):
        photo = Photo.from_bytes(data[: len(data) // 2])
        photo.start_decoding()
        for use in (lambda: photo.grey(40), lambda: photo.pixels, photo.to_array):  # noqa: B023
            with pytest.raises(UnshutterError, match=r"damaged or incomplete: .*premature end"):
                use()
