"""A drone's flight when it took a photo, from DJI's XMP: its velocity, its height, and its camera's direction.

Source: DJI, Zenmuse P1 and Mavic 3M user manuals, "Photo File": FlightXSpeed, FlightYSpeed and FlightZSpeed are the
velocity to the north, to the east and down [m/s], RelativeAltitude the height above the place of take-off [m], and the
gimbal's angles rotations about down, right and ahead, in this order (ZYX) [degrees].
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_NUMBER = rb"""\s*(?:=\s*["']|>)\s*([+-]?\d+(?:\.\d+)?)"""
_VELOCITY = ("FlightXSpeed", "FlightYSpeed", "FlightZSpeed")
_ALTITUDE = "RelativeAltitude"
_ANGLES = ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree")
_FASTEST = 60.0  # m/s: no such drone flies faster


@dataclass(frozen=True)
class Flight:
    """A drone's flight at the moment of a photo.

    Attributes:
        right, down, ahead: velocity along the axes of the camera's picture [m/s]: columns, rows, viewing direction.
        height_m: height above the take-off point [m].
        tilt_deg: tilt of the camera; -90 is straight down [degrees].
    """

    right: float
    down: float
    ahead: float
    height_m: float
    tilt_deg: float

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return math.hypot(self.right, self.down, self.ahead)


def of_xmp(packet: bytes | None) -> Flight | None:
    """Reads the flight from an XMP packet; returns None if it is missing or implausible."""
    if packet is None or b"drone-dji:FlightXSpeed" not in packet:
        return None
    numbers = [_number(packet, name) for name in (*_VELOCITY, _ALTITUDE, *_ANGLES)]
    if None in numbers:
        return None
    north, east, below, height, yaw, pitch, roll = (float(number or 0) for number in numbers)
    if math.hypot(north, east, below) > _FASTEST:
        return None
    ahead, right, down = _axes(*map(math.radians, (yaw, pitch, roll)))
    velocity = north, east, below
    return Flight(_along(velocity, right), _along(velocity, down), _along(velocity, ahead), height, pitch)


def _number(packet: bytes, name: str) -> float | None:
    match = re.search(rb"drone-dji:" + name.encode() + _NUMBER, packet)
    return float(match[1]) if match else None


def _along(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _axes(yaw: float, pitch: float, roll: float) -> list[tuple[float, float, float]]:
    """Returns the camera's viewing direction and the directions of its rows and columns, as (north, east, down)."""
    cos_yaw, sin_yaw, cos_pitch, sin_pitch = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    ahead = (cos_yaw * cos_pitch, sin_yaw * cos_pitch, -sin_pitch)
    level = (-sin_yaw, cos_yaw, 0.0)  # right and down before the roll
    below = (cos_yaw * sin_pitch, sin_yaw * sin_pitch, cos_pitch)
    cos_roll, sin_roll = math.cos(roll), math.sin(roll)
    right = tuple(cos_roll * a + sin_roll * b for a, b in zip(level, below, strict=True))
    down = tuple(cos_roll * b - sin_roll * a for a, b in zip(level, below, strict=True))
    return [ahead, (right[0], right[1], right[2]), (down[0], down[1], down[2])]
