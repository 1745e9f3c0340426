"""The time and duration of a photo's exposure, whether it was merged from several, and its camera's setting.

Source: CIPA DC-008 (EXIF 2.32): DateTimeOriginal, SubSecTimeOriginal, ExposureTime, ShutterSpeedValue, CustomRendered,
CompositeImage; the values that Apple adds to CustomRendered and its maker note's tag 0x000A are those that exiftool.org
lists (facts only).
"""

from __future__ import annotations

import re
import struct
from datetime import datetime
from fractions import Fraction

from unshutter.photo import exif, maker_notes
from unshutter.photo.directories import EXIF, Entry, Tree
from unshutter.photo.readout_times import camera

_ORIGINAL = 0x9003
_SUBSECONDS = 0x9291
_EXPOSURE_TIME = 0x829A
_SHUTTER_SPEED = 0x9201
_CUSTOM_RENDERED = 0xA401
_COMPOSITE = 0xA460
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0  # values beyond these are invalid
_PANORAMA = 6
_APPLE_HDR = 0x000A
_EXPOSURE_MODE = 0xA402
_FISHEYE = re.compile(r"fish-?\s?eye", re.IGNORECASE)
_ACTION_CAMERA = re.compile(r"gopro|insta360|arashi vision|osmo ?action|sjcam|akaso", re.IGNORECASE)
_SETTINGS = 0x829D, 0x8827, 0x920A, 0x9206  # aperture, ISO, focal length, distance of the subject


def taken(blob: bytes | None) -> datetime | None:
    """Returns the time at which a photo was taken, from EXIF, in the camera's time zone; None if unknown."""
    tree = exif.read(blob)
    date = tree.text(_ORIGINAL, EXIF)
    fraction = tree.text(_SUBSECONDS, EXIF)
    try:
        time = datetime.strptime(date, "%Y:%m:%d %H:%M:%S")
    except ValueError:  # zeros or blanks, if the camera's clock was never set
        return None
    return time.replace(microsecond=int(fraction[:6].ljust(6, "0"))) if fraction.isdecimal() else time


def time_s(blob: bytes | None) -> float | None:
    """Returns the exposure time [s] in an EXIF blob; None if it is missing or implausible."""
    tree = exif.read(blob)
    time, speed = (next(iter(tree.numbers(tag, EXIF)), None) for tag in (_EXPOSURE_TIME, _SHUTTER_SPEED))
    if time is None and speed is not None and abs(speed) < 40:
        time = 2.0**-speed  # APEX
    return time if time is not None and _SHORTEST_S <= time <= _LONGEST_S else None


def blob_of(time_s: float) -> bytes | None:
    """Creates EXIF with only an exposure time [s]; returns None for a time that :func:`time_s` would reject."""
    if not _SHORTEST_S <= time_s <= _LONGEST_S:
        return None
    time = Fraction(time_s).limit_denominator(1_000_000)
    entry = Entry(5, 1, struct.pack("<II", time.numerator, time.denominator))
    return exif.of_tiff(Tree("<", [{EXIF: {_EXPOSURE_TIME: entry}}]))


def bends_lines(blob: bytes | None) -> bool:
    """Whether a photo was taken by an action camera or a fisheye, by their names, or wider than straight lenses are."""
    tree = exif.read(blob)
    name = f"{camera(blob)} {tree.text(exif.LENS_MODEL, EXIF)}"
    mm = tree.number(exif.FOCAL_35MM, EXIF) or 0
    by_action_camera = _ACTION_CAMERA.search(name) is not None and mm < 20  # with more, lines were straightened
    return by_action_camera or _FISHEYE.search(name) is not None or 0 < mm < 10


def is_panorama(blob: bytes | None) -> bool:
    """Whether EXIF calls the photo a panorama, as phones by Apple do."""
    return exif.read(blob).number(_CUSTOM_RENDERED, EXIF) == _PANORAMA


def is_merged(blob: bytes | None) -> bool:
    """Whether a photo was merged from several exposures, of which its exposure time describes only one.

    Blur then says less about motion: each exposure may have been sharper, or moved more, than the whole.
    """
    tree = exif.read(blob)
    # HDR, HDR with the original kept, panorama, portrait HDR (Apple); 1, a maker-specific process, is Google's HDR
    if tree.number(_CUSTOM_RENDERED, EXIF) in (1, 2, 3, 6, 7):
        return True
    if tree.number(_COMPOSITE, EXIF) in (2, 3):  # a composite; one made while shooting
        return True
    return maker_notes.apple(blob).numbers(_APPLE_HDR) == (3,)


def setting(blob: bytes | None) -> tuple[object, ...] | None:
    """Returns the camera and its setting, except for the exposure time; None for a photo of a bracket or a merged one.

    Settings that are not recorded are empty.
    """
    tree = exif.read(blob)
    if not tree or tree.number(_EXPOSURE_MODE, EXIF) == 2 or is_merged(blob):
        return None
    return camera(blob), *(tree.numbers(tag, EXIF) for tag in _SETTINGS)
