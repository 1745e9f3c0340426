"""How the camera of an undistorted photo was held: what estimators can be given, as by an accelerometer.

No set of photos at hand states it. Where there is no rolling shutter, right angles alone show it well: the camera
is fitted to the photo's line segments, its motion held at none.
"""

from __future__ import annotations

import math

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.right_angles.answers import LEAST_GAIN
from unshutter.estimators.right_angles.beliefs import CAMERA, LOG_FOCAL, ROLL, TILT, UNKNOWNS, YAW
from unshutter.estimators.right_angles.search import descend
from unshutter.estimators.right_angles.view import likelihood_of, segments_of

_FEWEST_SEGMENTS = 20
_YAWS = np.arange(6) * (math.pi / 2 / 6)
_TILTS = np.radians([-10, 0, 10, 25])


def true_attitude(view: View) -> tuple[float, float] | None:
    """Roll and tilt [degrees] of the camera of an undistorted photo; None where the scene shows no right angles."""
    segments, size = segments_of(view)
    if len(segments) < _FEWEST_SEGMENTS:
        return None
    likelihood = likelihood_of(view, segments, size)
    yaw, tilt = (a.ravel() for a in np.meshgrid(_YAWS, _TILTS))
    begin = np.zeros((len(yaw), UNKNOWNS))
    begin[:, YAW], begin[:, TILT] = yaw, tilt
    begin[:, LOG_FOCAL] = likelihood.prior.mean[LOG_FOCAL]
    candidates, energy, _ = descend(likelihood, begin, CAMERA)
    best = candidates[np.argmin(energy)]
    if float(likelihood.lines_gain(best[None])[0]) < LEAST_GAIN:
        return None
    # a camera turned clockwise sees the scene turned the other way
    return -math.degrees(best[ROLL]), math.degrees(best[TILT])
