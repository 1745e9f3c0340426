"""How long a photo was exposed, and how long its camera takes to read it out."""

import re
import struct

import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from support.drawn_photos import drawn, encoded
from support.tagged_files import EXIF
from unshutter.errors import UsageError
from unshutter.options import Camera
from unshutter.photo import Photo, readout_times
from unshutter.photo.readout_times import readout_time_of
from unshutter.readout_time import ReadoutSource
from unshutter.single.estimator import View


def _photo(make: str = "Acme", model: str = "One", **details: object) -> Photo:
    """A photo whose EXIF has tags by number (``t829a``)."""
    tags = Image.Exif()
    tags.update({0x010F: make, 0x0110: model})
    tags.get_ifd(EXIF).update({int(tag[1:], 16): value for tag, value in details.items()})
    return Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes()))


@pytest.mark.parametrize(
    ("tags", "seconds"),
    [
        ({"t829a": IFDRational(1, 125)}, 1 / 125),
        ({"t9201": IFDRational(5, 1)}, 1 / 32),
        ({"t829a": IFDRational(1, 60), "t9201": IFDRational(5, 1)}, 1 / 60),
        ({"t829a": IFDRational(0, 1)}, None),
        ({"t829a": IFDRational(1, 0)}, None),
        ({"t829a": IFDRational(90_000, 1)}, None),
        ({"t9201": IFDRational(300, 1)}, None),
        ({}, None),
    ],
)
def test_the_exposure_time_is_read_or_refused(tags: dict, seconds: float | None) -> None:
    photo = _photo(**tags)
    assert photo.exposure_s() == (None if seconds is None else pytest.approx(seconds))
    assert View(photo).exposure_s() == photo.exposure_s()
    assert View(photo, Camera(exposure_s=0.5)).exposure_s() == 0.5


def test_a_photo_without_exif_tells_no_exposure() -> None:
    photo = Photo.from_array(drawn())
    assert photo.exposure_s() is None and not photo.is_merged() and photo.readout_time().source is ReadoutSource.UNKNOWN


@pytest.mark.parametrize(
    ("tags", "merged"),
    [
        ({"ta401": 0}, False),
        ({"ta401": 3}, True),
        ({"ta401": 4}, False),
        ({"ta460": 1}, False),
        ({"ta460": 2}, True),
        ({"ta460": 3}, True),
        ({"t927c": b"Apple iOS\0\0\1MM" + struct.pack(">HHHIiI", 1, 0x000A, 9, 1, 3, 0)}, True),
        ({"t927c": b"Apple iOS\0\0\1MM" + struct.pack(">HHHIiI", 1, 0x000A, 9, 1, 4, 0)}, False),
        ({}, False),
    ],
)
def test_photos_of_several_exposures_are_told_apart(tags: dict, merged: bool) -> None:
    assert _photo(t829a=IFDRational(1, 100), **tags).is_merged() is merged


@pytest.mark.parametrize(
    ("make", "model", "kind"),
    [
        ("Canon", "Canon EOS 5D Mark IV", "FOCAL_PLANE"),
        ("Canon", "Canon EOS REBEL T3i", "FOCAL_PLANE"),
        ("Canon", "Canon EOS-1D X Mark III", "EITHER"),
        ("Canon", "Canon EOS RP", "EITHER"),
        ("Canon", "Canon EOS M50", "EITHER"),
        ("Canon", "Canon EOS Kiss M", "EITHER"),
        ("Canon", "Canon PowerShot G11", "LEAF"),
        ("Canon", "Canon PowerShot G1 X", "EITHER"),
        ("Canon", "Canon PowerShot SD4500 IS", "EITHER"),
        ("Canon", "Canon DIGITAL IXUS 70", "LEAF"),
        ("NIKON CORPORATION", "NIKON D90", "FOCAL_PLANE"),
        ("NIKON CORPORATION", "NIKON D850", "EITHER"),
        ("NIKON CORPORATION", "NIKON Z 6", "EITHER"),
        ("NIKON", "E990", "LEAF"),
        ("SONY", "DSLR-A700", "FOCAL_PLANE"),
        ("SONY", "ILCE-7M3", "EITHER"),
        ("SONY", "DSC-RX100M3", "EITHER"),
        ("SONY", "DSC-P52", "LEAF"),
        ("Sony", "G8341", "PHONE"),
        ("SAMSUNG", "NX300", "EITHER"),
        ("samsung", "SM-G991B", "PHONE"),
        ("Apple", "iPhone 5s", "PHONE"),
        ("DJI", "FC220", "DRONE"),
        ("Hasselblad", "L1D-20c", "DRONE"),
        ("FUJIFILM", "FinePix F1000EXR", "EITHER"),
        ("SIGMA", "SIGMA fp", "ELECTRONIC"),
        ("Acme", "One", "UNKNOWN"),
        ("", "", "UNKNOWN"),
    ],
)
def test_the_readout_time_follows_from_the_kind_of_camera(make: str, model: str, kind: str) -> None:
    time = readout_time_of(make, model)
    assert time.source is ReadoutSource[kind]
    assert View(_photo(make, model)).readout_s() == time


def test_each_row_of_the_table_has_a_time_and_a_pattern() -> None:
    for row in readout_times._rows():
        assert re.compile(row["model"]).groups >= 0 and row["makes"] == row["makes"].lower()
        assert 0 <= float(row["usual_ms"]) <= float(row["longest_ms"]) and ReadoutSource(row["kind"])


def test_a_given_readout_time_counts() -> None:
    given = View(_photo("Apple", "iPhone 5s"), Camera(readout_ms=12)).readout_s()
    assert given.seconds == given.longest_s == pytest.approx(0.012)


@pytest.mark.parametrize("wrong", [{"exposure_s": 0}, {"exposure_s": float("nan")}, {"readout_ms": -1}])
def test_times_that_cannot_be_are_refused(wrong: dict) -> None:
    with pytest.raises(UsageError, match="must be above 0 and at most"):
        Camera(**wrong)


@pytest.mark.parametrize(
    ("make", "model", "tags", "bends"),
    [
        ("GoPro", "HERO8 Black", {"ta405": 15}, True),
        ("GoPro", "HERO8 Black", {"ta405": 24}, False),
        ("Canon", "EOS R5", {"ta434": "EF8-15mm f/4L FISHEYE USM", "ta405": 15}, True),
        ("Canon", "EOS R5", {"ta434": "EF11-24mm f/4L USM", "ta405": 11}, False),
        ("Acme", "One", {"ta405": 8}, True),
        ("Apple", "iPhone 12", {"ta405": 13}, False),
        ("Acme", "One", {}, False),
    ],
)
def test_lenses_that_bend_lines_are_known_by_name_or_focal_length(make, model, tags, bends) -> None:
    assert _photo(make, model, **tags).bends_lines() is bends
