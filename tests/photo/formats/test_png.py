"""PNG: texts and resolution."""

import io

import pytest
from PIL import Image, PngImagePlugin

from support.drawn_photos import drawn, encoded
from unshutter.photo import Photo


def test_resolution_and_png_texts_are_kept():
    texts = PngImagePlugin.PngInfo()
    texts.add_text("Title", "Street")
    photo = Photo.from_bytes(encoded(drawn(), "PNG", pnginfo=texts, dpi=(300, 300)))
    changed = photo.with_pixels(drawn())
    with Image.open(io.BytesIO(changed.to_bytes())) as picture:
        assert picture.info["Title"] == "Street" and picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    with Image.open(io.BytesIO(photo.to_bytes("tiff"))) as picture:
        assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
