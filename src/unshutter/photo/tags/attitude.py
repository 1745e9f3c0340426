"""How the camera was held, where the photo says so: the gimbal's angles in the XMP of DJI's drones.

Source: DJI, Mavic 3M user manual, "Photo File": GimbalRollDegree and GimbalPitchDegree are angles of the gimbal in the
NED coordinate system, rotations in the order ZYX; so a positive roll has the right side down, a positive pitch looks
up, and roll turns about the optical axis.
"""

from __future__ import annotations

import re

from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG

_ANGLE = rb"""drone-dji:Gimbal%sDegree\s*(?:=\s*["']|>)\s*([+-]?\d+(?:\.\d+)?)"""


def of_xmp(packet: bytes) -> tuple[float, float] | None:
    """Roll and tilt of the camera [degrees], or None where the XMP does not say, or says what cannot be."""
    found = [re.search(_ANGLE % name, packet) for name in (b"Roll", b"Pitch")]
    if not all(found):
        return None
    roll, tilt = (float(match[1]) for match in found if match)
    # looking straight down, a gimbal may call the same attitude a roll of half a turn and a heading of another
    if abs(abs(roll) - 180) <= MOST_ROLL_DEG and abs(tilt) > MOST_TILT_DEG - 10:
        return 0.0, tilt
    return (roll, tilt) if abs(roll) <= MOST_ROLL_DEG and abs(tilt) <= MOST_TILT_DEG else None
