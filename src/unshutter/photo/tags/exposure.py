"""The time and duration of a photo's exposure, and whether it was merged from several exposures.

Source: CIPA DC-008 (EXIF 2.32): DateTimeOriginal, SubSecTimeOriginal, ExposureTime, ShutterSpeedValue, CustomRendered,
CompositeImage; the values that Apple adds to CustomRendered and its maker note's tag 0x000A are those that exiftool.org
lists (facts only).
"""

from __future__ import annotations

import struct
from datetime import datetime
from fractions import Fraction

from unshutter.photo.tags import exif, maker_notes
from unshutter.photo.tags.directories import EXIF, Entry, Tree

_ORIGINAL, _SUBSECONDS = 0x9003, 0x9291
_EXPOSURE_TIME, _SHUTTER_SPEED = 0x829A, 0x9201
_CUSTOM_RENDERED, _COMPOSITE = 0xA401, 0xA460
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0  # values beyond these are invalid
# HDR, HDR with the original kept, panorama, portrait HDR (Apple); 1, a maker-specific process, is Google's HDR
_MERGED_BY_CUSTOM_RENDERED = (1, 2, 3, 6, 7)
_MERGED_BY_COMPOSITE = (2, 3)  # a composite; one made while shooting
_APPLE_HDR, _IS_HDR = 0x000A, 3


def taken(blob: bytes | None) -> datetime | None:
    """Returns the time at which a photo was taken, from EXIF, in the camera's time zone; None if unknown."""
    tree = exif.read(blob)
    if tree is None:
        return None
    date, fraction = tree.text(_ORIGINAL, EXIF), tree.text(_SUBSECONDS, EXIF)
    try:
        time = datetime.strptime(date, "%Y:%m:%d %H:%M:%S")
    except ValueError:  # zeros or blanks, if the camera's clock was never set
        return None
    return time.replace(microsecond=int(fraction[:6].ljust(6, "0"))) if fraction.isdecimal() else time


def time_s(blob: bytes | None) -> float | None:
    """Returns the exposure time [s] in an EXIF blob; None if it is missing or implausible."""
    tree = exif.read(blob)
    if tree is None:
        return None
    time = _first(tree, _EXPOSURE_TIME)
    if time is None and (speed := _first(tree, _SHUTTER_SPEED)) is not None and abs(speed) < 40:
        time = 2.0**-speed  # APEX
    return time if time is not None and _SHORTEST_S <= time <= _LONGEST_S else None


def blob_of(time_s: float) -> bytes | None:
    """Creates EXIF with only an exposure time [s]; returns None for a time that :func:`time_s` would reject."""
    if not _SHORTEST_S <= time_s <= _LONGEST_S:
        return None
    time = Fraction(time_s).limit_denominator(1_000_000)
    entry = Entry(5, 1, struct.pack("<II", time.numerator, time.denominator))
    return exif.of_tiff(Tree("<", [{EXIF: {_EXPOSURE_TIME: entry}}]))


def is_merged(blob: bytes | None) -> bool:
    """Whether a photo was merged from several exposures, of which its exposure time describes only one.

    Blur then says less about motion: each exposure may have been sharper, or moved more, than the whole.
    """
    tree = exif.read(blob)
    if tree is None:
        return False
    if tree.number(_CUSTOM_RENDERED, EXIF) in _MERGED_BY_CUSTOM_RENDERED:
        return True
    if tree.number(_COMPOSITE, EXIF) in _MERGED_BY_COMPOSITE:
        return True
    note = maker_notes.read(blob)
    return note is not None and note.maker == "Apple" and note.numbers(_APPLE_HDR) == (_IS_HDR,)


def _first(tree: Tree, tag: int) -> float | None:
    numbers = tree.numbers(tag, EXIF)
    return numbers[0] if numbers else None
