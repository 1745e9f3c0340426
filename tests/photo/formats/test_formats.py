"""The list of formats: each says all that a format must, and no two say the same."""

from typing import get_args

import pytest

from support.drawn_photos import drawn
from unshutter.errors import UnshutterError
from unshutter.options import PictureFormat
from unshutter.photo import Photo
from unshutter.photo.formats import FORMATS, WRITTEN
from unshutter.photo.formats.picture_format import Format, WrittenFormat


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_says_all_that_the_abstract_one_asks_for(name: str) -> None:
    format = FORMATS[name]
    asked = set(Format.__annotations__) | (set(WrittenFormat.__annotations__) if name in WRITTEN else set())
    assert all(getattr(format, attribute, None) is not None for attribute in asked)
    assert format.name == name and format.written_as in WRITTEN
    assert (format.written_as == name) == (name in WRITTEN)


def test_formats_share_no_ending() -> None:
    endings = [suffix for format in FORMATS.values() for suffix in format.suffixes]
    assert len(endings) == len(set(endings)) and all(ending.islower() and ending[0] == "." for ending in endings)


def test_the_formats_that_are_written_are_those_that_can_be_asked_for() -> None:
    assert tuple(WRITTEN) == get_args(PictureFormat)


@pytest.mark.parametrize("name", WRITTEN)
def test_an_ending_that_lies_does_no_harm(name: str, tmp_path) -> None:
    for suffix in (".jpg", ".avif", ".heic"):
        path = tmp_path / f"photo{suffix}"
        path.write_bytes(Photo.from_array(drawn()).to_bytes(WRITTEN[name].name))
        assert Photo.open(path).format == name
    if name == "tiff":  # but for raw files, most of which begin like a TIFF
        with pytest.raises(UnshutterError, match="as a camera's raw file"):
            Photo.open(path.rename(path.with_suffix(".nef")))
