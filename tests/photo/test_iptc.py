"""IPTC in Photoshop's resources."""

import io

import pytest
from PIL import Image, IptcImagePlugin

from support.drawn_photos import drawn, encoded
from support.tagged_files import (
    TITLE,
    image_resources,
    jpeg_with,
)
from unshutter.photo import Photo, chunks


@pytest.mark.parametrize("origin", ["jpeg", "tiff", "tiff, IPTC alone"])
@pytest.mark.parametrize("target", ["jpeg", "tiff"])
def test_iptc_goes_between_jpeg_and_tiff(origin: str, target: str) -> None:
    blocks = image_resources((1028, TITLE), (1060, b"last"))
    tags = {33723: TITLE} | ({} if "alone" in origin else {34377: blocks})
    if origin == "jpeg":
        data = jpeg_with(drawn(), (0xED, b"Photoshop 3.0\0" + blocks))
    else:
        data = encoded(drawn(), "TIFF", tiffinfo=tags)
    photo = Photo.from_bytes(data)
    for written in (photo.to_bytes(target), photo.with_pixels(~photo.pixels).to_bytes(target)):
        with Image.open(io.BytesIO(written)) as picture:
            assert IptcImagePlugin.getiptcinfo(picture) == {(2, 5): b"Street"}
            if target == "tiff":
                assert picture.tag_v2[33723] == TITLE
                assert (b"8BIM\x04\x24" in written) == ("alone" not in origin)


def test_damaged_resources_stay_as_they_are() -> None:
    whole = image_resources((1028, TITLE), (1060, b"last"))
    for cut in range(len(whole)):
        assert chunks.without_thumbnails(whole[:cut]) == whole[:cut]
