"""Colours that box files tell by numbers."""

import io

import pytest
from PIL import Image, ImageCms

from support.camera_files import heic
from support.drawn_photos import drawn, encoded, one_line
from support.tagged_files import (
    with_code_points,
)
from unshutter.errors import UnshutterError
from unshutter.photo import Photo


@pytest.mark.parametrize("format", ["heic", "avif"])
def test_colours_told_by_numbers_become_a_profile_or_are_refused(format: str) -> None:
    data = heic(drawn(64, 96)) if format == "heic" else encoded(drawn(64, 96), "AVIF")
    plain = Photo.from_bytes(with_code_points(data, 1, 13)).to_bytes("jpeg")
    wide = Photo.from_bytes(with_code_points(data, 12, 13)).to_bytes("jpeg")
    with Image.open(io.BytesIO(plain)) as first, Image.open(io.BytesIO(wide)) as second:
        assert "icc_profile" not in first.info
        profile = ImageCms.ImageCmsProfile(io.BytesIO(second.info["icc_profile"]))
        red = profile.profile.red_primary[1]
        assert red[:2] == pytest.approx((0.680, 0.320), abs=0.01)  # that of Display P3
    for primaries, transfer in ((9, 8), (1, 8), (11, 16)):  # linear light, primaries of cinemas
        with pytest.raises(UnshutterError, match=rf"unusual colours \(code points {primaries}/{transfer}\)") as error:
            Photo.from_bytes(with_code_points(data, primaries, transfer))
        one_line(error)
