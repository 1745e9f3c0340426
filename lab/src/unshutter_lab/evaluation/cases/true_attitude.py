"""Determines the attitude of an undistorted photo's camera, to be given to estimators as if from an accelerometer.

None of the available data sets states it. Without rolling shutter, right angles alone reveal it well: the camera is
fitted to the photo's line segments, with its motion fixed at zero.
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
    """Returns roll and tilt [degrees] of an undistorted photo's camera, or None if there are no right angles."""
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
    # a camera rotated clockwise sees the scene rotated counter-clockwise
    return -math.degrees(best[ROLL]), math.degrees(best[TILT])
