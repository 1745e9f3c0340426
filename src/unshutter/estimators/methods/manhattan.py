"""manhattan: line segments -> motion, camera and focal length that make them straight and square. No learning.

The likelihood and the search are in lines/manhattan_likelihood.py and manhattan_search.py.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.lines.segments import find_segments, in_rows
from unshutter.estimators.right_angles.likelihood import Beliefs, ManhattanLikelihood, SecondOpinion
from unshutter.estimators.right_angles.search import Posterior, explore
from unshutter.motion import Motion

SHORT_SIDE = 768  # of the grey copy in which segments are found [px]
MOST_ENLARGED = 2.0  # smaller photos are enlarged: LSD places the lines better, and finds more of them
MOST_SEGMENTS = 320  # the longest are kept
FEWEST_SEGMENTS = 8  # below this the photo does not say how the camera moved
LEAST_GAIN = -0.2  # of the lines over chance [nats per unit of weight]; below it, these are no buildings
LARGEST = 45 / 256  # rows of displacement; hands do not move more, nor do the motions used for measuring
WIDEST_ASPECT = 2.5  # beyond it, nothing was measured

# Motions to start from beside none: t_x [rows] and r_z [rad] growing evenly to this at the last row
STARTS = [np.eye(6)[k] * size for k, size in ((0, 0.12), (0, -0.12), (3, 0.08), (3, -0.08))]


class Manhattan(Estimator):
    """The mean of the posterior under the Manhattan likelihood, over all optima found."""

    def estimate(self, view: View) -> Motion:
        """Cubic t_x and r_z; no motion and a reason where there are too few segments."""
        segments, size = segments_of(view)
        reason = unusable(view, segments)
        if reason:
            return view.no_motion(self.name, reason)
        posterior = explore(likelihood_of(view, segments, size), STARTS)
        return motion_of(posterior, view, self.name)


def segments_of(view: View) -> tuple[np.ndarray, tuple[int, int]]:
    """[N, 4] segments in centred units of rows, and (height, width) of the copy in which they were found [px]."""
    grey = view.grey(SHORT_SIDE)
    factor = min(SHORT_SIDE / min(view.height, view.width), MOST_ENLARGED)
    if factor > 1:
        size = (round(view.width * factor), round(view.height * factor))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
    return in_rows(find_segments(grey, MOST_SEGMENTS), *grey.shape), (grey.shape[0], grey.shape[1])


def unusable(view: View, segments: np.ndarray) -> str:
    """Why these segments say nothing, or an empty string."""
    aspect = view.width / view.height
    if max(aspect, 1 / aspect) > WIDEST_ASPECT:
        return f"the photo's sides differ by more than {WIDEST_ASPECT:g} times"
    if len(segments) < FEWEST_SEGMENTS:
        return f"only {len(segments)} straight segments found"
    return ""


def likelihood_of(
    view: View,
    segments: np.ndarray,
    size: tuple[int, int],
    beliefs: Beliefs | None = None,
    opinion: SecondOpinion | None = None,
) -> ManhattanLikelihood:
    """The likelihood of a photo's segments, with focal length, roll and tilt where the user or EXIF knows them."""
    focal_px = view.known_focal_px()
    log_focal = math.log(focal_px / view.height) if focal_px else None
    roll_deg, tilt_deg = view.attitude_deg()
    # a camera turned clockwise sees the scene turned the other way
    roll = None if roll_deg is None else -math.radians(roll_deg)
    tilt = None if tilt_deg is None else math.radians(tilt_deg)
    return ManhattanLikelihood(segments, size[0], size[1] / size[0], beliefs, view.up, log_focal, opinion, roll, tilt)


def motion_of(posterior: Posterior, view: View, estimator: str) -> Motion:
    """The posterior's mean as a motion; none, with the reason, where it is not to be believed."""
    if posterior.lines_gain < LEAST_GAIN:
        return view.no_motion(estimator, "the photo shows no right angles")
    if posterior.size > LARGEST:
        return view.no_motion(estimator, "what fits the lines is more motion than hands can do")
    return view.cubic_motion(posterior.mean.reshape(2, 3), estimator, posterior.confidence)
