"""Readout times of photos by the camera's make and model, from the table photo_readout_times.csv."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

from unshutter.errors import shortened, visible
from unshutter.photo import exif
from unshutter.photo.shutter import Shutter, stated_shutter
from unshutter.readout_time import ReadoutSource, ReadoutTime

_TABLE = Path(__file__).with_name("photo_readout_times.csv")
_WITH_A_CHOICE = (ReadoutSource.EITHER, ReadoutSource.FOCAL_PLANE, ReadoutSource.DRONE, ReadoutSource.LEAF)
_OF_SHUTTER = {
    Shutter.IN_LENS: ReadoutTime.of_ms(0, ReadoutSource.LEAF),
    Shutter.MECHANICAL: ReadoutTime.of_ms(4, ReadoutSource.FOCAL_PLANE, plausible_ms=(0, 10)),
    Shutter.ELECTRONIC: ReadoutTime.of_ms(50, ReadoutSource.ELECTRONIC, plausible_ms=(0, 300)),
}
_MAKE = 0x010F
_MODEL = 0x0110


def camera(blob: bytes | None) -> str:
    """Returns make and model of the camera named in an EXIF blob; empty if none is named."""
    tree = exif.read(blob)
    return " ".join(filter(None, (tree.text(_MAKE), tree.text(_MODEL))))


def camera_in_words(blob: bytes | None) -> str:
    """Returns the camera named in an EXIF blob for a sentence: ``a Canon PowerShot A70``."""
    tree = exif.read(blob)
    make = tree.text(_MAKE)
    model = tree.text(_MODEL)
    named = model if model.partition(" ")[0].lower() in make.lower() else f"{make.partition(' ')[0]} {model}"
    return visible(shortened(f"{'an' if named[:1] in 'AEIOaeio' else 'a'} {named}"))


def readout_time(blob: bytes | None, xmp: bytes | None = None) -> ReadoutTime:
    """Returns the readout time of the camera named in an EXIF blob; that of an unknown camera if none is named.

    The shutter that the camera states, in the maker's note or in XMP, counts more than what its kind usually has.
    """
    tree = exif.read(blob)
    make = tree.text(_MAKE)
    time = readout_time_of(make, tree.text(_MODEL))
    if time.source not in _WITH_A_CHOICE:
        return time
    shutter = stated_shutter(tree, make.strip().lower(), xmp)
    if shutter is None or (shutter is Shutter.ELECTRONIC and time.source is ReadoutSource.DRONE):
        return time
    return _OF_SHUTTER[shutter]


def readout_time_of(make: str, model: str) -> ReadoutTime:
    """Returns the readout time of a camera from EXIF's make and model: that of the table's first row that matches."""
    make = make.strip().lower()
    model = model.strip().lower()
    rows = (row for row in _rows() if make.startswith(tuple(row["makes"].split("|"))))
    return _time(next(row for row in rows if re.match(row["model"], model)))


@cache
def _rows() -> list[dict[str, str]]:
    lines = _TABLE.read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def _time(row: dict[str, str]) -> ReadoutTime:
    usual_ms = float(row["usual_ms"])
    longest_ms = float(row["longest_ms"])
    plausible_ms = (0.0, longest_ms) if longest_ms > usual_ms else None
    return ReadoutTime.of_ms(usual_ms, ReadoutSource(row["kind"]), plausible_ms=plausible_ms)
