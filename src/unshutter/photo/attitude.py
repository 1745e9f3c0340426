"""The camera's attitude, from phones' accelerometers, level gauges and gimbals.

All makers' angles are converted to those of :class:`Attitude`: roll clockwise as seen by the photographer, upward tilt,
both for the upright picture. Gauges are built into cameras, so the quarter turn of a portrait photo is first subtracted
from their angles. If the result contradicts the photo's orientation, the pixels have been rotated since, or the angles
belong to another photo: then only what is beyond doubt is used.

Sources: Apple: the vector in its maker note, compared with plumb lines in photos. DJI: Zenmuse P1 and Mavic 3M user
manuals, "Photo File". GPano: Google, Photo Sphere XMP metadata. Camera: Pix4D, yaw, pitch and roll, zero when the
camera looks straight down. All others: as exiftool.org describes their tags (facts only).
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG
from unshutter.orientation import Orientation, Readout
from unshutter.photo import exif, maker_notes
from unshutter.photo.directories import EXIF
from unshutter.photo.maker_notes import MakerNote

_LENS_MODEL = 0xA434
_APPLE_VECTOR, _GRAVITY_IN_G = 0x0008, (0.94, 1.06)  # a phone at rest; edited files contain arbitrary values
_LEAST_UPRIGHT = 0.35  # share of gravity in the picture's plane; below it, the upward direction is unclear
_CLEAR_SHARE, _CLEAR_DEG = 0.5, 25.0  # to recognise a quarter turn: gravity in the plane, deviation from it


@dataclass(frozen=True)
class Attitude:
    """The attitude in which the camera was held."""

    roll_deg: float | None  # rotation clockwise from upright, as seen by its user [degrees]; None: unknown
    tilt_deg: float | None  # angle above the horizon, -90 is straight down [degrees]; None: unknown
    source: str  # device that measured it
    # direction in which the stored pixels were read out, if gravity shows that they were rotated since
    readout: Readout = Readout.TOP_TO_BOTTOM


class _Held(NamedTuple):
    """Angles of the camera's body [degrees]: roll from landscape, in (-180, 180]; tilt, None if unknown."""

    roll: float
    tilt: float | None


def of_photo(
    blob: bytes | None, xmp: bytes | None, orientation: Orientation, height: int, width: int
) -> Attitude | None:
    """Determines how the camera was held, from EXIF and XMP; returns None if they do not show it, or are implausible.

    Orientation, height and width are those of the stored pixels.
    """
    note = maker_notes.read(blob)
    if note is not None and note.maker in _GAUGES:
        source, read = _GAUGES[note.maker]
        held = read(note)
        if held is not None and not (note.maker == "Apple" and _is_front(blob)):
            return _in_picture(held, source, orientation, height, width)
    return attitude_of_xmp(xmp) if xmp and orientation is Orientation.NORMAL else None


def _in_picture(held: _Held, source: str, orientation: Orientation, height: int, width: int) -> Attitude | None:
    """Converts the body's angles to those of a picture stored as read out, or rotated since; None if inconsistent."""
    if orientation.mirrored:  # no camera stores mirrored pictures
        return None
    tilt = held.tilt or 0.0
    upright = math.cos(math.radians(tilt))  # share of gravity in the picture's plane
    if upright < _LEAST_UPRIGHT:
        return Attitude(None, held.tilt, source)
    roll = _wrapped(held.roll - 90 * orientation.quarter_turns)
    if abs(roll) <= MOST_ROLL_DEG:
        return Attitude(roll, held.tilt, source)
    off_quarter = roll - math.copysign(90, roll)
    is_clear = upright >= _CLEAR_SHARE and abs(off_quarter) <= _CLEAR_DEG
    if orientation is Orientation.NORMAL and height > width and is_clear:
        # sensors are landscape: software has rotated these pixels upright, without noting it in the tag
        readout = Readout.RIGHT_TO_LEFT if roll > 0 else Readout.LEFT_TO_RIGHT
        return Attitude(off_quarter, held.tilt, source, readout)
    return None


def _wrapped(angle: float) -> float:
    """Wraps an angle to (-180, 180]."""
    return 180 - (180 - angle) % 360


# ---- maker notes ---------------------------------------------------------------------------------------


def _apple(note: MakerNote) -> _Held | None:
    """Reads Apple's vector: gravity is (-y, -x, -z) in the sensor's frame: right, down, forward."""
    vector = note.numbers(_APPLE_VECTOR)
    if len(vector) != 3 or not _GRAVITY_IN_G[0] <= math.hypot(*vector) <= _GRAVITY_IN_G[1]:
        return None
    right, down, forward = -vector[1], -vector[0], -vector[2]
    return _Held(math.degrees(math.atan2(right, down)), -math.degrees(math.atan2(forward, math.hypot(right, down))))


def _is_front(blob: bytes | None) -> bool:
    """Whether the front camera was used, for which the vector has another frame."""
    return "front" in exif.read(blob).text(_LENS_MODEL, EXIF).lower()


def _canon(note: MakerNote) -> _Held | None:
    data = note.bytes(0x4059)
    if len(data) < 24:
        return None
    roll, pitch = (_wrapped(value / 10) for value in struct.unpack_from(note.order + "2i", data, 16))
    return _level(-roll, pitch)


def _olympus(note: MakerNote) -> _Held | None:
    settings = note.below(0x2020)
    if settings is None:
        return None
    roll, pitch = settings.numbers(0x0903), settings.numbers(0x0904)
    if len(roll) != 2 or roll[1] != 1:  # otherwise the gauge was off
        return None
    return _level(-roll[0] / 10, pitch[0] / 10 if len(pitch) == 2 and pitch[1] == 1 else None)


def _panasonic(note: MakerNote) -> _Held | None:
    values = note.numbers(0x0090), note.numbers(0x0091)
    if any(len(value) != 1 for value in values):
        return None
    roll, pitch = ((value + 0x8000) % 0x10000 - 0x8000 for (value,) in values)  # signed, despite their type
    return _level(roll / 10, -pitch / 10)


_PENTAX_TURNED = {1: 0, 2: 180, 3: 90, 4: -90}  # how the body was held, in quarter turns; 8 is added if off level


def _pentax(note: MakerNote) -> _Held | None:
    data = note.bytes(0x022B)
    turned = _PENTAX_TURNED.get(data[0] & 7) if len(data) >= 3 else None
    if turned is None:
        return None
    roll, pitch = (-value / 2 for value in struct.unpack_from("2b", data, 1))
    held = _level(roll, pitch)
    return held and _Held(_wrapped(held.roll + turned), held.tilt)


def _fujifilm(note: MakerNote) -> _Held | None:
    roll = note.numbers(0x144D)
    return _level(roll[0], None) if len(roll) == 1 else None


def _level(roll: float, tilt: float | None) -> _Held | None:
    """Returns the angles of a level gauge [degrees]; None if implausible, or exactly level, as if switched off."""
    if not roll and not tilt:
        return None
    if not abs(roll) <= 360 or (tilt is not None and not abs(_wrapped(tilt)) <= MOST_TILT_DEG):
        return None
    return _Held(_wrapped(roll), None if tilt is None else _wrapped(tilt))


# Nikon's gauge (OrientationInfo) is in an encrypted part of its note and is not read.
_GAUGES: dict[str, tuple[str, Callable[[MakerNote], _Held | None]]] = {
    "Apple": ("accelerometer (Apple)", _apple),
    "Canon": ("level gauge (Canon)", _canon),
    "Fujifilm": ("level gauge (Fujifilm)", _fujifilm),
    "Olympus": ("level gauge (Olympus)", _olympus),
    "Panasonic": ("level gauge (Panasonic)", _panasonic),
    "Pentax": ("level gauge (Pentax)", _pentax),
}

# ---- XMP -----------------------------------------------------------------------------------------------

_NUMBER = rb"""\s*(?:=\s*["']|>)\s*([+-]?\d+(?:\.\d+)?)"""
_PANORAMA = rb"""GPano:ProjectionType\s*(?:=\s*["']|>)\s*(?:equirectangular|cylindrical)"""
# Properties for roll and pitch of the stored picture; None: Pix4D's pitch, which is zero straight down
_XMP: tuple[tuple[str, bytes, bytes | None], ...] = (
    ("gimbal (DJI)", rb"drone-dji:GimbalRollDegree", rb"drone-dji:GimbalPitchDegree"),
    ("gimbal (Parrot)", rb"[\w-]+:CameraRollDegree", rb"[\w-]+:CameraPitchDegree"),
    ("level gauge (Leica)", rb"xmpDSA:RollAngle", rb"xmpDSA:PitchAngle"),
    ("GPano", rb"GPano:PoseRollDegrees", rb"GPano:PosePitchDegrees"),
    ("Pix4D", rb"\bCamera:Roll", None),
)


def attitude_of_xmp(packet: bytes) -> Attitude | None:
    """Reads how the camera of an upright stored picture was held, from the first known property in the packet."""
    for source, roll, pitch in _XMP:
        angles = tuple(_numbers(packet, roll, pitch or rb"\bCamera:Pitch"))
        if len(angles) == 2 and not (source == "GPano" and re.search(_PANORAMA, packet)):
            return _from_straight_down(*angles, source) if pitch is None else _of_gimbal(*angles, source)
    return None


def _numbers(packet: bytes, *names: bytes) -> list[float]:
    """Returns the values of the properties that the packet has."""
    matches = (re.search(name + _NUMBER, packet) for name in names)
    return [float(match[1]) for match in matches if match]


def _of_gimbal(roll: float, tilt: float, source: str) -> Attitude | None:
    # looking straight down, a gimbal may express the same attitude by half a turn of roll and another heading
    if abs(abs(roll) - 180) <= MOST_ROLL_DEG and abs(tilt) > MOST_TILT_DEG - 10:
        roll = 0.0
    return Attitude(roll, tilt, source) if abs(roll) <= MOST_ROLL_DEG and abs(tilt) <= MOST_TILT_DEG else None


def _from_straight_down(roll: float, pitch: float, source: str) -> Attitude | None:
    """Converts angles of a camera below an aircraft: roll is about the flight direction, a pitch of 90 looks ahead."""
    if not abs(roll) <= 90 or not -90 <= pitch <= 180:
        return None
    roll, pitch = math.radians(roll), math.radians(pitch)
    gravity = math.sin(roll) * math.cos(pitch), math.sin(pitch), math.cos(roll) * math.cos(pitch)
    tilt = -math.degrees(math.asin(gravity[2]))
    return _in_picture(_Held(math.degrees(math.atan2(gravity[0], gravity[1])), tilt), source, Orientation.NORMAL, 1, 1)
