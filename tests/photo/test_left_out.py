"""What a file's format has no place for is named, never dropped without a word."""

import subprocess
import sys
from pathlib import Path

import pytest

from support.drawn_photos import drawn, encoded
from support.tagged_files import TITLE, full_exif, image_resources, jpeg_with
from unshutter import RowMotion, rectify
from unshutter.photo import Photo
from unshutter.photo.formats import WRITTEN
from unshutter.photo.libvips import libvips

WITH_IPTC = jpeg_with(drawn(96, 128), (0xED, b"Photoshop 3.0\0" + image_resources((1028, TITLE))), exif=full_exif())


@pytest.mark.parametrize(
    ("format", "left_out"), [("jpeg", ()), ("tiff", ()), ("png", ()), ("webp", ("IPTC",)), ("avif", ("IPTC",))]
)
def test_iptc_is_named_where_the_format_has_no_place_for_it(tmp_path: Path, format, left_out) -> None:
    photo = Photo.from_bytes(WITH_IPTC)
    file = photo.encode(format)
    assert file.left_out == left_out
    assert photo.to_bytes(format) == file.data
    assert photo.save(tmp_path / f"out.{format}") == left_out


def test_a_result_says_what_it_leaves_out(tmp_path: Path) -> None:
    (tmp_path / "in.jpg").write_bytes(WITH_IPTC)
    motion = RowMotion.from_polynomials([0, 2], [0, 0], 96, 128)
    assert rectify(tmp_path / "in.jpg", motion=motion).save(tmp_path / "out.webp") == ("IPTC",)


def test_the_command_says_it_in_the_photos_line(tmp_path: Path) -> None:
    (tmp_path / "in.jpg").write_bytes(WITH_IPTC)
    RowMotion.from_polynomials([0, 2], [0, 0], 96, 128).save(tmp_path / "motion.json")
    command = [sys.executable, "-m", "unshutter", "rectify", "in.jpg", "-o", "out.webp", "--motion", "motion.json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "in.jpg -> out.webp (points moved by up to 2.0 px; cropped to 98 %; not kept: IPTC)" in done.stderr


@pytest.mark.parametrize("kind", ["JPEG", "WEBP", "TIFF", "PNG"])
def test_a_profile_for_other_colours_is_not_dropped_without_a_word(kind: str) -> None:
    profile = libvips().Image.profile_load("cmyk")
    photo = Photo.from_bytes(encoded(drawn(), kind, icc_profile=profile))
    for format in WRITTEN:
        assert photo.with_pixels(photo.pixels.copy()).encode(format).left_out == ("colour profile",)
