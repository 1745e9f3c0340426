"""Grey copies."""

import numpy as np
import pytest

from support.covering import covering
from support.drawn_photos import drawn, encoded, textured
from unshutter.photo import Photo
from unshutter.photo.decoder import grey_copy


def area_average(luminance, height, width):
    """Mean over each target pixel's area, by exact overlaps."""

    def overlaps(source, target):
        edges = np.arange(target + 1) * source / target
        cells = np.arange(source)
        low = np.maximum(edges[:-1, None], cells)
        high = np.minimum(edges[1:, None], cells + 1)
        return np.maximum(high - low, 0) * target / source

    return overlaps(luminance.shape[0], height) @ luminance @ overlaps(luminance.shape[1], width).T


@pytest.mark.parametrize(
    ("format", "size", "short"),
    covering(["jpeg", "png", "array"], [(480, 640), (641, 483), (1001, 777)], [64, 100, 301]),
)
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


@pytest.mark.parametrize(("size", "short"), covering([(1200, 1600), (1207, 1601)], [140, 150, 160, 300, 599, 700]))
def test_grey_is_nearly_the_same_for_a_jpeg_and_for_its_pixels(size, short):
    """The JPEG is decoded at a part of its size."""
    photo = Photo.from_bytes(Photo.from_array(textured(*size)).to_bytes("jpeg"))
    grey = photo.grey(short).astype(int)
    difference = grey - grey_copy(photo.image, *grey.shape)
    assert np.abs(difference).mean() < 0.8 and np.abs(difference).max() < 9
    np.testing.assert_array_equal(photo.grey(short), grey)  # the pixels are known by now
