"""Photo: the value, from arrays and back; what it refuses to be made of, and to become."""

import io
import os

import numpy as np
import pytest
from PIL import Image

from support.drawn_photos import drawn, encoded, one_line
from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo


def test_arrays_are_copied_and_shapes_kept():
    pixels = drawn(bands=1)[..., 0].copy()
    photo = Photo.from_array(pixels)
    pixels[:] = 0
    assert photo.to_array().max() > 0 and photo.to_array().shape == (48, 80)
    assert (photo.format, photo.orientation, photo.path, photo.focal_px()) == ("array", 1, None, None)
    assert Photo.from_array(drawn()[::2, ::-3]).to_array().shape == (24, 27, 3)  # not contiguous


@pytest.mark.parametrize(
    "array",
    [np.zeros((4, 4), np.float32), np.zeros((4, 4, 3), np.int16), np.zeros((4, 4), bool), np.zeros(9, np.uint8)]
    + [np.zeros(shape, np.uint8) for shape in ((4, 4, 5), (0, 4), (4, 4, 0), (1, 4, 4, 3))],
)
def test_arrays_of_other_kinds_are_refused(array):
    with pytest.raises(UnshutterError) as error:
        Photo.from_array(array)
    one_line(error)


def test_impossible_requests_are_usage_errors(tmp_path):
    photo = Photo.from_array(drawn())
    for use in (
        lambda: photo.save(tmp_path / "a.gif"),
        lambda: photo.save(tmp_path / "noending"),
        lambda: photo.save(tmp_path / "a.jpg", quality=0),
        lambda: photo.to_bytes("jpeg", quality=101),
        lambda: photo.to_bytes("bmp"),
        lambda: photo.to_bytes("jpeg", subsampling="4:1:0"),  # pyright: ignore[reportArgumentType]
        lambda: photo.grey(0),
    ):
        with pytest.raises(UsageError) as error:
            use()
        one_line(error)
    with pytest.raises(UnshutterError, match="WebP, whose limit is 16383 px"):
        Photo.from_array(np.zeros((1, 16384), np.uint8)).to_bytes("webp")
    with pytest.raises(UnshutterError, match="uint8 or uint16"):
        photo.with_pixels(photo.pixels.astype(float))
    assert os.listdir(tmp_path) == []


def test_pixels_are_decoded_once_and_kept_as_they_are():
    photo = Photo.from_bytes(encoded(drawn(), "JPEG"))
    assert photo.pixels is photo.pixels
    with pytest.raises(ValueError, match="read-only"):
        photo.pixels[0, 0] = 0
    assert photo.image(79, 47) == photo.to_array()[47, 79].tolist() and photo.image(0, 0)
    for short in (12, None, 20):
        photo.grey(short)
    np.testing.assert_array_equal(photo.to_array(), np.asarray(Image.open(io.BytesIO(photo.to_bytes("png")))))
