"""Builds the likelihood of a photo's segments."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.right_angles.beliefs import KnownCamera, KnownSpeed, MotionKind, SecondOpinion
from unshutter.estimators.right_angles.likelihood import ManhattanLikelihood
from unshutter.estimators.segments import find_segments, in_rows
from unshutter.estimators.speed_limit import SpeedLimit

SHORT_SIDE = 768  # of the grey copy in which segments are detected [px]
MOST_ENLARGED = 2.0  # smaller photos are enlarged: LSD then finds more lines, more accurately
MOST_SEGMENTS = 320  # the longest are used
_DOUBT = 1.5  # standard deviation of a speed, in speed limits
_LEAST_SPEED, _ANY_SPEED = 1e-4, 10.0  # rows, and rad, over a readout

# Starting motions in addition to zero: t_x [rows] and r_z [rad] growing evenly to this at the last row
STARTS = [np.eye(6)[k] * size for k, size in ((0, 0.12), (0, -0.12), (3, 0.08), (3, -0.08))]


def segments_of(view: View) -> tuple[np.ndarray, tuple[int, int]]:
    """[N, 4] segments in centred units of rows, and (height, width) of the copy in which they were detected [px]."""
    grey = view.grey(SHORT_SIDE)
    factor = min(SHORT_SIDE / min(view.height, view.width), MOST_ENLARGED)
    if factor > 1:
        size = (round(view.width * factor), round(view.height * factor))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
    return in_rows(find_segments(grey, MOST_SEGMENTS), *grey.shape), (grey.shape[0], grey.shape[1])


def likelihood_of(
    view: View,
    segments: np.ndarray,
    size: tuple[int, int],
    opinion: SecondOpinion | None = None,
    kinds: Sequence[MotionKind] = (),
) -> ManhattanLikelihood:
    """Returns the likelihood of a photo's segments, with focal length, roll and tilt as far as known.

    Args:
        view: the photo.
        segments, size: as :func:`segments_of` returns them.
        opinion: another estimate to include.
        kinds: kinds of motion; those of the shipped calibration by default.
    """
    known = known_camera(view)
    return ManhattanLikelihood(segments, size[0], size[1] / size[0], known=known, opinion=opinion, kinds=kinds)


def known_camera(view: View) -> KnownCamera:
    """Returns what is known about the camera from the user or the photo's metadata."""
    focal_px = view.known_focal_px()
    roll_deg, tilt_deg = view.attitude_deg()
    return KnownCamera(
        up=view.up,
        log_focal=math.log(focal_px / view.height) if focal_px else None,
        # a camera rotated clockwise sees the scene rotated counter-clockwise
        roll=None if roll_deg is None else -math.radians(roll_deg),
        tilt=None if tilt_deg is None else math.radians(tilt_deg),
        speed=_known_speed(view.speed_limit, view.height),
    )


def _known_speed(limit: SpeedLimit | None, rows: int) -> KnownSpeed | None:
    """Converts a speed limit to a prior, with a least speed that keeps its density finite."""
    if limit is None:
        return None
    tx = np.clip(_DOUBT * limit.tx_px / rows, _LEAST_SPEED, _ANY_SPEED)
    return KnownSpeed(tx, float(np.clip(_DOUBT * limit.rz_rad, _LEAST_SPEED, _ANY_SPEED)))
