"""Estimates the readout ratio from right angles: the lean of upright objects reveals the readout time.

A scene that moves by v from frame to frame is sheared by ratio * v over a frame's height. Optical flow between frames
gives v; right angles in each photo (estimators/right_angles) give the shear, though imprecisely: a camera tilted
sideways by a degree looks much the same. The evidence of all photos for each ratio is therefore summed, with one error
of the shear common to all: a line through the shears of frames that move differently. It is the only source of the
ratio if the camera moves evenly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.estimators.base import View
from unshutter.estimators.right_angles.likelihood import ManhattanLikelihood
from unshutter.estimators.right_angles.search import evidence_of
from unshutter.estimators.right_angles.view import known_camera, segments_of
from unshutter.estimators.segments import unusable
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.frames.tracks import Tracks
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_RATIO_GRID = np.linspace(-0.4, 1.4, 19)  # ratios for which each photo's evidence is computed
_RATIOS = np.linspace(0.01, 1.0, 100)
_LEANS = np.linspace(-0.15, 0.15, 61)  # rows: shear errors common to all photos
_ASKEW = np.radians(2.5)  # their standard deviation: video cameras are held less carefully than still cameras
_COMMON = 4.0  # segments' errors are correlated: divisor of the evidence, as for single photos (odds.py)
_SLOWEST = 0.01  # rows per frame: slower frames are sheared by less than cameras are tilted
_TOO_UNSURE = 0.1
_GUESSED_RATIO = 0.5
SURE_ENOUGH = 0.03  # error of a ratio that right angles could not reduce


@dataclass(frozen=True)
class PhotoSpeed:
    """A photo of a sequence with the speed of its scene.

    Attributes:
        view: the photo.
        speed: [3] t_x and t_y [rows] and r_z [rad] per frame interval, from its neighbouring frames.
    """

    view: View
    speed: Float64[np.ndarray, "3"]


def speed_of(pair: Tracks) -> Float64[np.ndarray, "3"]:
    """Returns t_x and t_y [rows] and r_z [rad] per frame interval, from the tracks between two frames.

    Args:
        pair: tracks of the background, at least three.
    """
    x, y = ((pair.start + pair.end + 1) / 2 - [pair.width / 2, pair.height / 2]).T / pair.height
    moved = (pair.end - pair.start) / pair.height
    moved = moved / (1 + _GUESSED_RATIO * moved[:, 1:])
    one, none = np.ones_like(x), np.zeros_like(x)
    columns, rows = np.stack([one, none, -y, x], axis=-1), np.stack([none, one, x, y], axis=-1)  # last: scale
    return np.linalg.lstsq(np.concatenate([columns, rows]), moved.T.ravel(), rcond=None)[0][:3]


def ratio_from_angles(photos: Sequence[PhotoSpeed]) -> ReadoutRatio:
    """Estimates the readout ratio of a sequence from the right angles in some of its photos.

    Raises:
        UnknownRatioError: there is too little sideways motion, or the photos show no right angles.
    """
    total = np.zeros((len(_RATIOS), len(_LEANS)))
    count = 0
    for photo in photos:
        sideways = photo.speed[0]
        likelihood = _likelihood(photo.view)
        if likelihood is None or abs(sideways) < _SLOWEST:
            continue
        motions = _RATIO_GRID[:, None] * np.array([sideways, 0, 0, photo.speed[2], 0, 0])
        evidence = evidence_of(likelihood, motions) / _COMMON
        total += np.interp(_RATIOS[:, None] + _LEANS / sideways, _RATIO_GRID, evidence)
        count += 1
    if not count:
        raise UnknownRatioError.because(Reason(Code.NO_ANGLES_OR_MOTION))
    total -= 0.5 * (_LEANS / _ASKEW) ** 2
    share = np.exp(total - total.max()).sum(axis=1)
    share /= share.sum()
    mean = float(share @ _RATIOS)
    error = float(np.sqrt(share @ (_RATIOS - mean) ** 2))
    if error > _TOO_UNSURE:
        cause = Reason.of(Code.IMPRECISE, evidence="right angles", value=mean, error=error)
        raise UnknownRatioError.because(cause)
    return ReadoutRatio(mean, error, "right angles")


def combined(first: ReadoutRatio, second: ReadoutRatio) -> ReadoutRatio:
    """Combines two estimates of the ratio; if they disagree, the error grows accordingly."""
    weights = np.array([first.error, second.error]) ** -2.0
    value = float(weights @ [first.value, second.value] / weights.sum())
    apart = abs(first.value - second.value) / np.hypot(first.error, second.error)
    return ReadoutRatio(value, float(max(1.0, apart) / np.sqrt(weights.sum())), f"{first.source} and {second.source}")


def _likelihood(view: View) -> ManhattanLikelihood | None:
    """Returns the likelihood of a photo's segments for any motion, or None if there are too few segments."""
    segments, (height, width) = segments_of(view)
    if unusable(segments, view.height, view.width):
        return None
    # no speed limit from the photo's sharpness: a prior on the motion would favour a ratio of 0
    return ManhattanLikelihood(segments, height, width / height, known=replace(known_camera(view), speed=None))
