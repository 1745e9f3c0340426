"""The camera's attitude, as recorded by phones' accelerometers, and in XMP by gimbals and level gauges.

All makers' angles are converted to those of :class:`Attitude`: roll clockwise as seen by the photographer, upward tilt,
both for the upright picture. Accelerometers are built into cameras, so the quarter turn of a portrait photo is first
subtracted from their angles. If the result contradicts the photo's orientation, the pixels have been rotated since, or
the angles belong to another photo: then only what is beyond doubt is used.

Sources: Apple: the vector in its maker note, compared with plumb lines in photos. DJI: Zenmuse P1 and Mavic 3M user
manuals, "Photo File". GPano: Google, Photo Sphere XMP metadata. Camera: Pix4D, yaw, pitch and roll, zero when the
camera looks straight down. All others: as exiftool.org describes their tags (facts only).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG
from unshutter.orientation import Orientation, ScanDirection
from unshutter.photo import exif, maker_notes
from unshutter.photo.directories import EXIF
from unshutter.photo.regions import is_panorama

_APPLE_VECTOR = 0x0008
_GRAVITY_IN_G = (0.94, 1.06)  # of a phone at rest; edited files contain arbitrary values


@dataclass(frozen=True)
class Attitude:
    """The attitude in which the camera was held."""

    roll_deg: float | None  # rotation clockwise from upright, as seen by its user [degrees]; None: unknown
    tilt_deg: float | None  # angle above the horizon, -90 is straight down [degrees]; None: unknown
    source: str  # device that measured it
    # direction in which the stored pixels were read out, if gravity shows that they were rotated since
    scan_direction: ScanDirection = ScanDirection.TOP_TO_BOTTOM


def of_photo(
    blob: bytes | None, xmp: bytes | None, orientation: Orientation, height: int, width: int
) -> Attitude | None:
    """Determines how the camera was held, from EXIF and XMP; returns None if they do not show it, or are implausible.

    Orientation, height and width are those of the stored pixels.
    """
    vector = maker_notes.apple(blob).numbers(_APPLE_VECTOR)  # gravity is (-y, -x, -z): right, down, forward
    is_front = "front" in exif.read(blob).text(exif.LENS_MODEL, EXIF).lower()  # for it, the vector has another frame
    if len(vector) == 3 and _GRAVITY_IN_G[0] <= math.hypot(*vector) <= _GRAVITY_IN_G[1] and not is_front:
        gravity = -vector[1], -vector[0], -vector[2]
        return _in_picture(gravity, "accelerometer (Apple)", orientation, height, width)
    return attitude_of_xmp(xmp) if xmp and orientation is Orientation.NORMAL else None


def _in_picture(
    gravity: tuple[float, float, float], source: str, orientation: Orientation, height: int, width: int
) -> Attitude | None:
    """Converts gravity (right, down, forward) in the sensor's frame to the attitude of a picture; None if inconsistent.

    The picture is stored as read out, or was rotated since.
    """
    if orientation.mirrored:  # no camera stores mirrored pictures
        return None
    right, down, forward = gravity
    tilt = -math.degrees(math.atan2(forward, math.hypot(right, down)))
    upright = math.cos(math.radians(tilt))  # share of gravity in the picture's plane
    if upright < 0.35:  # the upward direction is unclear
        return Attitude(None, tilt, source)
    roll = math.degrees(math.atan2(right, down)) - 90 * orientation.quarter_turns
    roll = 180 - (180 - roll) % 360  # in (-180, 180]
    if abs(roll) <= MOST_ROLL_DEG:
        return Attitude(roll, tilt, source)
    off_quarter = roll - math.copysign(90, roll)
    is_clear = upright >= 0.5 and abs(off_quarter) <= 25.0  # of a quarter turn
    if orientation is Orientation.NORMAL and height > width and is_clear:
        # sensors are landscape: software has rotated these pixels upright, without noting it in the tag
        scan_direction = ScanDirection.RIGHT_TO_LEFT if roll > 0 else ScanDirection.LEFT_TO_RIGHT
        return Attitude(off_quarter, tilt, source, scan_direction)
    return None


# ---- XMP -----------------------------------------------------------------------------------------------

_NUMBER = rb"""\s*(?:=\s*["']|>)\s*([+-]?\d+(?:\.\d+)?)"""
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
        found = (re.search(name + _NUMBER, packet) for name in (roll, pitch or rb"\bCamera:Pitch"))
        angles = tuple(float(each[1]) for each in found if each)
        if len(angles) == 2 and not (source == "GPano" and is_panorama(packet)):
            return _from_straight_down(*angles, source) if pitch is None else _of_gimbal(*angles, source)
    return None


def _of_gimbal(roll: float, tilt: float, source: str) -> Attitude | None:
    # looking straight down, a gimbal may express the same attitude by half a turn of roll and another heading
    if abs(abs(roll) - 180) <= MOST_ROLL_DEG and abs(tilt) > MOST_TILT_DEG - 10:
        roll = 0.0
    return Attitude(roll, tilt, source) if abs(roll) <= MOST_ROLL_DEG and abs(tilt) <= MOST_TILT_DEG else None


def _from_straight_down(roll: float, pitch: float, source: str) -> Attitude | None:
    """Converts angles of a camera below an aircraft: roll is about the flight direction, a pitch of 90 looks ahead."""
    if not abs(roll) <= 90 or not -90 <= pitch <= 180:
        return None
    roll = math.radians(roll)
    pitch = math.radians(pitch)
    gravity = math.sin(roll) * math.cos(pitch), math.sin(pitch), math.cos(roll) * math.cos(pitch)
    return _in_picture(gravity, source, Orientation.NORMAL, 1, 1)
