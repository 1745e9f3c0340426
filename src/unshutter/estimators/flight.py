"""flight: the motion of a photo that a drone took in flight, from its metadata alone.

A camera that looks straight down from the height Z and flies at the velocity v sees flat ground pass by at f v / Z
pixels per second, against the direction of flight. The resulting motion during readout is known as well as the readout
time and the height are: the height is relative to the take-off point, and the ground may lie higher or lower.

A hovering drone is evidence that there is nothing to undo, whatever its viewing direction.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from unshutter.estimators.base import View
from unshutter.geometry.readout import Orientation
from unshutter.motion import Motion
from unshutter.photo.tags.readout_time import ReadoutTime
from unshutter.reasons import Code, MotionSource, Reason

NAME = MotionSource.FLIGHT.value
_STRAIGHT_DOWN = 10.0  # degrees off vertical within which the ground is taken as parallel to the picture
_LOWEST = 5.0  # m: below this, the visible ground is not flat
_HEIGHT_ERROR = 0.1  # standard deviation of the ground's height, as a share of the flight height
_SPEED_ERROR = 0.1  # m/s: precision at which speeds are stored
_STILL = 0.15  # m/s: slower drones are considered hovering
_FAR = 100.0  # picture heights: a focal length at which rotations act as translations
_RIGHT_PX, _RIGHT_SHARE = 1.0, 0.1  # tolerance of a correct motion: px of ROWS rows, or share of it
_ROWS = 256


def flight_motion(view: View) -> Motion | None:
    """Returns the motion of a photo from its drone's flight data, or None if they are inconclusive.

    Its confidence is the probability that it is right, given the uncertainty of time, height and speed.
    """
    flight = view.photo.flight
    focal = view.known_focal_px()
    if flight is None or Orientation(view.photo.orientation) is not Orientation.NORMAL:
        return None
    if flight.speed < _STILL:
        return view.no_motion(NAME, Reason(Code.HOVERED))
    if focal is None or flight.height_m < _LOWEST or abs(flight.tilt_deg + 90) > _STRAIGHT_DOWN:
        return None
    time, per_metre = view.readout_s(), focal / flight.height_m
    if time.typical_s == 0:
        return view.no_motion(NAME, Reason(Code.NO_ROLLING_SHUTTER))
    shift = _in_frame(view, -flight.right, -flight.down) * per_metre * time.typical_s
    far = _FAR * view.height
    share = np.linspace(0, 1, view.height)[:, None] * np.arctan(shift / far)
    rotations = np.stack([-share[:, 1], share[:, 0], np.zeros(view.height)], axis=-1)
    motion = replace(view, camera=replace(view.camera, focal_px=far)).rotation_motion(rotations, NAME)
    size = float(np.hypot(*shift)) / 2 * _ROWS / view.height  # mean over the rows
    error = math.hypot(size * math.hypot(_HEIGHT_ERROR, _spread(time)), size * _SPEED_ERROR / flight.speed)
    allowed = max(_RIGHT_PX, _RIGHT_SHARE * size)
    return replace(motion, confidence=math.erf(allowed / (math.sqrt(2) * max(error, 1e-9))))


def _in_frame(view: View, right: float, down: float) -> np.ndarray:
    """[2] converts a direction in the stored picture to the readout frame."""
    ends = [view.readout.points_to_frame(*point, 1, 1) for point in ((0.0, 0.0), (right, down))]
    return np.subtract(ends[1], ends[0])


def _spread(time: ReadoutTime) -> float:
    """Returns the relative standard deviation of a readout time, taking the longest as two of them away."""
    return math.log(time.longest_s / time.typical_s) / 2
