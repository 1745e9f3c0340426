"""flight: the motion of a photo that a drone took while it flew, from what its metadata say, without a look at a pixel.

A camera that looks straight down from the height Z and flies at the velocity v sees flat ground pass by at f v / Z
pixels per second, against the flight. What that makes of a readout is known as well as the readout time and the height
are: the height is counted from where the drone took off, and the ground may lie higher or lower.

A drone that hovered is evidence that nothing has to be undone, wherever it looked.
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
_STRAIGHT_DOWN = 10.0  # degrees off it, within which the ground is taken to be parallel to the picture
_LOWEST = 5.0  # m: below, what is seen of the ground is not flat
_HEIGHT_ERROR = 0.1  # share of the height by which the ground may lie higher or lower, as a standard deviation
_SPEED_ERROR = 0.1  # m/s: as coarse as they are written
_STILL = 0.15  # m/s: slower than this, the drone hovered
_FAR = 100.0  # picture heights: a focal length for which turns are shifts
_RIGHT_PX, _RIGHT_SHARE = 1.0, 0.1  # a motion is right to so many px of ROWS rows, or that share of it
_ROWS = 256


def flight_motion(view: View) -> Motion | None:
    """The motion of a photo by its drone's flight; None where it does not say.

    Its confidence is the probability that it is right, by how well time, height and speed are known.
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
    size = float(np.hypot(*shift)) / 2 * _ROWS / view.height  # on average over the rows
    error = math.hypot(size * math.hypot(_HEIGHT_ERROR, _spread(time)), size * _SPEED_ERROR / flight.speed)
    allowed = max(_RIGHT_PX, _RIGHT_SHARE * size)
    return replace(motion, confidence=math.erf(allowed / (math.sqrt(2) * max(error, 1e-9))))


def _in_frame(view: View, right: float, down: float) -> np.ndarray:
    """[2] a direction of the stored picture in the readout frame."""
    ends = [view.readout.points_to_frame(*point, 1, 1) for point in ((0.0, 0.0), (right, down))]
    return np.subtract(ends[1], ends[0])


def _spread(time: ReadoutTime) -> float:
    """The standard deviation of a readout time, as a share of it: the longest is two of them away."""
    return math.log(time.longest_s / time.typical_s) / 2
