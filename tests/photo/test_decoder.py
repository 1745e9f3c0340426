"""Decoding: ahead of being asked, of damaged files, of pictures too large for memory."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from support.drawn_photos import encoded, one_line, textured
from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.storage import files


@pytest.mark.parametrize("format", ["JPEG", "PNG", "TIFF"])
def test_pictures_too_large_for_memory_are_decoded_all_the_same(format, monkeypatch):
    monkeypatch.setattr(files, "SPILL_BYTES", 1000)
    pixels = textured(300, 200)
    photo = Photo.from_bytes(encoded(pixels, format, **({"quality": 95} if format == "JPEG" else {})))
    assert np.abs(photo.to_array().astype(int) - pixels).mean() <= (5 if format == "JPEG" else 0)
    assert isinstance(photo.pixels, np.memmap)
    assert photo.image(199, 299) == photo.to_array()[299, 199].tolist() and photo.image(0, 0)


def test_decoding_ahead_gives_the_same_pixels():
    data = encoded(textured(300, 200), "JPEG")
    with ThreadPoolExecutor(1) as executor:
        for given in (None, executor):
            photo = Photo.from_bytes(data)
            photo.start_decoding(given, grey_px=40)
            photo.start_decoding(given, grey_px=40)
            np.testing.assert_array_equal(photo.grey(40), Photo.from_bytes(data).grey(40))
            np.testing.assert_array_equal(photo.pixels, Photo.from_bytes(data).pixels)


@pytest.mark.parametrize("format", ["JPEG", "PNG"])
@pytest.mark.parametrize("grey_px", [40, 190])  # a JPEG is decoded at a part of its size for the first one alone
def test_a_grey_copy_made_ahead_is_for_its_size_alone(format, grey_px):
    data = encoded(textured(300, 200), format)
    photo, other = Photo.from_bytes(data), Photo.from_bytes(data)
    photo.start_decoding(grey_px=grey_px, whole=False)
    for short in (grey_px - 1, grey_px, grey_px, None):
        grey = photo.grey(short)
        np.testing.assert_array_equal(grey, other.grey(short))
        grey[:] = 0  # given away: nobody else gets it


def test_damage_found_ahead_is_told_where_pixels_are_asked_for():
    data = encoded(textured(300, 200), "JPEG")
    for _ in range(20):
        photo = Photo.from_bytes(data[: len(data) // 2])
        photo.start_decoding(grey_px=40)
        for use in (lambda: photo.grey(40), lambda: photo.pixels, photo.to_array):  # noqa: B023
            with pytest.raises(UnshutterError, match="damaged or incomplete: it ends too early"):
                use()


@pytest.mark.parametrize("format", ["JPEG", "PNG", "WEBP", "TIFF", "AVIF"])
def test_damage_is_named_in_plain_words(format):
    data = bytearray(encoded(textured(300, 200), format))
    for damaged in (data[: len(data) // 2], data[: len(data) // 2] + bytes(200) + data[len(data) // 2 + 200 :]):
        try:
            _ = Photo.from_bytes(bytes(damaged)).pixels
        except UnshutterError as error:
            cause = str(error).rpartition(": ")[2]
            assert cause in ("it ends too early", "part of its data cannot be decoded"), error


@pytest.mark.parametrize("format", ["JPEG", "PNG", "WEBP", "TIFF", "AVIF"])
@pytest.mark.parametrize("kept", [0.6, 0.95])
def test_truncated_files_are_found_before_anything_is_written(tmp_path, format, kept, capfd):
    noise = np.random.default_rng(1).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    data = encoded(noise, format)
    path, target = tmp_path / f"photo.{format.lower()}", tmp_path / "out.png"
    path.write_bytes(data[: int(len(data) * kept)])
    for use in (lambda photo: photo.save(target), lambda photo: photo.grey(16), lambda photo: photo.to_array()):
        with pytest.raises(UnshutterError) as error:
            use(Photo.open(path))
        assert "damaged" in one_line(error) and str(path) in str(error.value)
    assert os.listdir(tmp_path) == [path.name]
    assert capfd.readouterr() == ("", "")
