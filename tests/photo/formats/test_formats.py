"""The table of formats: each row is complete, no two rows claim the same files, and what lists formats lists these."""

import re
from pathlib import Path
from typing import get_args

import pytest

from support.drawn_photos import drawn
from unshutter.errors import UnshutterError, UsageError
from unshutter.options.picture_formats import BY_NAME, TABLE, PictureFormat, in_words
from unshutter.photo import Photo
from unshutter.photo.formats import FORMATS, WRITTEN, of_target
from unshutter.photo.formats.picture_format import Format, WrittenFormat

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_says_all_that_the_abstract_one_asks_for(name: str) -> None:
    format = FORMATS[name]
    asked = set(Format.__annotations__) | (set(WrittenFormat.__annotations__) if name in WRITTEN else set())
    assert all(getattr(format, attribute, None) is not None for attribute in asked)
    assert format.row is BY_NAME[name] and format.row.is_written == (name in WRITTEN)
    assert format.row.written_as in WRITTEN


def test_formats_share_no_ending_and_no_mime_type() -> None:
    for listed in ([row.suffixes for row in TABLE], [row.mime_types for row in TABLE]):
        each = [one for row in listed for one in row]
        assert len(each) == len(set(each)) and all(one == one.lower() for one in each)


def test_the_formats_that_are_written_are_those_that_can_be_asked_for() -> None:
    assert sorted(WRITTEN) == sorted(get_args(PictureFormat))
    assert in_words() == "JPEG, PNG, WebP, TIFF, AVIF, HEIC and raw"
    assert in_words([BY_NAME["tiff"]]) == "TIFF"


def test_only_names_of_written_formats_can_be_those_of_results() -> None:
    for row in TABLE:
        for suffix in row.suffixes:
            if row.is_written:
                assert of_target(Path(f"a{suffix.upper()}")) is WRITTEN[row.name]
            else:
                with pytest.raises(UsageError, match=r"only reads such files; use one of these extensions: \.jpg"):
                    of_target(Path(f"a{suffix}"))


@pytest.mark.parametrize(
    ("entry", "left_out"), [("desktop/unshutter.desktop", ("raw",)), ("application/add-to-menu", ())]
)
def test_file_managers_offer_to_open_these_formats(entry: str, left_out: tuple[str, ...]) -> None:
    listed = re.search(r"^MimeType=(.*);$", (ROOT / entry).read_text(), re.MULTILINE)
    assert listed is not None
    pictures = [kind for kind in listed[1].split(";") if kind.startswith("image/")]
    assert sorted(pictures) == sorted(kind for row in TABLE if row.name not in left_out for kind in row.mime_types)


@pytest.mark.parametrize("name", WRITTEN)
def test_an_ending_that_lies_does_no_harm(name: str, tmp_path) -> None:
    for suffix in (".jpg", ".avif", ".heic"):
        path = tmp_path / f"photo{suffix}"
        path.write_bytes(Photo.from_array(drawn()).to_bytes(WRITTEN[name].row.written_as))
        assert Photo.open(path).format == name
    if name == "tiff":  # but for raw files, most of which begin like a TIFF
        with pytest.raises(UnshutterError, match="as a camera's raw file"):
            Photo.open(path.rename(path.with_suffix(".nef")))
