"""Opening: what is refused, and in which words."""

import io
import os
import struct
import sys
from unittest import mock

import numpy as np
import pytest
import pyvips
from PIL import Image

from support.drawn_photos import drawn, encoded, one_line
from unshutter.errors import UnshutterError
from unshutter.photo import Photo, decoder, photo


def cmyk(format):
    return encoded(drawn(bands=4), format, mode="CMYK")


def pages(format, **options):
    stream = io.BytesIO()
    first, second = (Image.fromarray(a) for a in (drawn(), drawn()[::-1].copy()))
    first.save(stream, format, save_all=True, append_images=[second], **options)
    return stream.getvalue()


def float_tiff():
    stream = io.BytesIO()
    Image.fromarray(drawn(bands=1)[..., 0].astype(np.float32)).save(stream, "TIFF")
    return stream.getvalue()


def lab_tiff():

    return pyvips.Image.new_from_array(drawn()).colourspace("labs").tiffsave_buffer()


def preview_first_tiff(tag, kind, value):
    """A TIFF whose first directory has one tag more."""
    tags = [(256, 3, 8), (257, 3, 8), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1), (279, 4, 64)]
    entries = b"".join(struct.pack("<HHII", t, k, 1, v) for t, k, v in sorted([*tags, (tag, kind, value)]))
    directory = struct.pack("<H", 9) + entries + bytes(4)
    return b"II*\0" + struct.pack("<I", 72) + bytes(64) + directory


REFUSED = {
    "text": (b"This is not a photo, only called one.\n" * 20, "not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw"),
    "empty": (b"", "empty"),
    "gif": (encoded(drawn(), "GIF"), "not a JPEG"),
    "heic": (struct.pack(">I", 24) + b"ftypheic\0\0\0\0mif1heic" + bytes(100), "HEIC"),
    "canon raw": (b"II*\0\x10\0\0\0CR\2\0" + bytes(100), "raw"),
    "dng": (preview_first_tiff(50706, 1, 0x401), "raw"),
    "nikon raw": (preview_first_tiff(254, 4, 1), "raw"),
    "cmyk jpeg": (cmyk("JPEG"), "CMYK"),
    "cmyk tiff": (cmyk("TIFF"), "CMYK"),
    "float tiff": (float_tiff(), "32-bit float"),
    "lab tiff": (lab_tiff(), "LAB"),
    "two pages": (pages("TIFF"), "2 pictures"),
    "animated webp": (pages("WEBP"), "2 pictures"),
    "animated avif": (pages("AVIF"), "animation"),
    "jpeg head only": (encoded(drawn(), "JPEG")[:20], "damaged, incomplete or unusual"),
    "png head only": (encoded(drawn(), "PNG")[:20], "damaged, incomplete or unusual"),
    "webp head only": (encoded(drawn(), "WEBP")[:20], "damaged, incomplete or unusual"),
    "tiff head only": (encoded(drawn(), "TIFF")[:12], "damaged, incomplete or unusual"),
    "avif head only": (encoded(drawn(), "AVIF")[:40], "damaged, incomplete or unusual"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_photo_is_refused_in_one_line(tmp_path, name, capfd):
    data, expected = REFUSED[name]
    path = tmp_path / "photo.jpg"
    path.write_bytes(data)
    with pytest.raises(UnshutterError) as error:
        Photo.open(path)
    message = one_line(error)
    assert expected in message and str(path) in message
    with pytest.raises(UnshutterError) as error:
        Photo.from_bytes(data)
    assert expected in one_line(error)
    assert capfd.readouterr() == ("", "")


def test_places_without_a_file_are_refused_in_one_line(tmp_path):
    for place, expected in (
        (tmp_path, "folder"),
        (tmp_path / "none.jpg", "No such file"),
        ("a\0b.jpg", "no file can have the name"),
    ):
        with pytest.raises(UnshutterError) as error:
            Photo.open(place)
        assert expected in one_line(error)


@pytest.mark.skipif(sys.platform == "win32", reason="needs pipes and devices")
def test_what_could_be_waited_for_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.jpg")  # opening it would wait for somebody to write
    for place in (tmp_path / "pipe.jpg", "/dev/zero"):
        with pytest.raises(UnshutterError, match="a pipe or a device") as error:
            Photo.open(place)
        one_line(error)


def test_the_pictures_of_a_stereo_camera_are_refused(tmp_path):
    (tmp_path / "a.mpo").write_bytes(encoded(drawn(), "JPEG"))  # of several pictures, all but the first would be lost
    with pytest.raises(UnshutterError, match="contains several pictures"):
        Photo.open(tmp_path / "a.mpo")


@pytest.mark.parametrize("format", ["png", "jpeg", "tiff", "webp"])
def test_too_many_pixels_are_refused_before_they_are_decoded(monkeypatch, format):
    data = Photo.from_array(drawn(60, 80)).to_bytes(format)
    decoder = mock.Mock(wraps=photo.Decoder)
    monkeypatch.setattr(photo, "Decoder", decoder)
    with pytest.raises(UnshutterError) as error:
        Photo.from_bytes(data, max_pixels=4799)
    assert one_line(error).endswith("has 80x60 px (0 megapixels), more than the limit of 0.004799 megapixels")
    decoder.assert_not_called()
    assert Photo.from_bytes(data, max_pixels=4800).width == 80
    decoder.assert_called_once()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' names are text")
def test_names_that_are_not_text(tmp_path):
    path = tmp_path / os.fsdecode(b"b\xfcro.jpg")
    path.write_bytes(encoded(drawn(), "JPEG"))
    Photo.open(path).save(path.with_suffix(".png"))
    assert Photo.open(path.with_suffix(".png")).width == 80


def test_a_picture_too_large_for_its_bytes_is_refused(monkeypatch):
    plain = pyvips.Image.black(500, 400).pngsave_buffer(bitdepth=1)
    assert Photo.from_bytes(plain).width == 500
    monkeypatch.setattr(decoder, "_LARGE", 200_000)
    with pytest.raises(UnshutterError, match=rf"500x400 px \(0 megapixels\) cannot come from {len(plain)} bytes"):
        Photo.from_bytes(plain)
