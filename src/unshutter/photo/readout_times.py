"""Readout times of photos by the camera's make and model, from the table photo_readout_times.csv."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

from unshutter.errors import shortened, visible
from unshutter.photo import exif
from unshutter.readout_time import ReadoutSource, ReadoutTime

_TABLE = Path(__file__).with_name("photo_readout_times.csv")
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


def readout_time(blob: bytes | None) -> ReadoutTime:
    """Returns the readout time of the camera named in an EXIF blob; that of an unknown camera if none is named."""
    tree = exif.read(blob)
    return readout_time_of(tree.text(_MAKE), tree.text(_MODEL))


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
