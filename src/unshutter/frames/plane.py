"""The motion that most of a picture shares between two frames: the homography of tracked corners."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float64, UInt8

_CORNERS = 600
_QUALITY, _DISTANCE = 0.005, 5  # of corners: of the best one's strength; px between them
_WINDOW, _LEVELS = (15, 15), 4  # of Lucas-Kanade tracking
_MOST_ROUND_TRIP = 0.5  # px from a corner to where it is tracked and back
_FEWEST = 12
_INLIER = 1.0  # px
_SEED = 0


def plane_between(
    first: UInt8[np.ndarray, "height width"], second: UInt8[np.ndarray, "height width"]
) -> Float64[np.ndarray, "3 3"]:
    """The homography from the first picture to the second; the identity where too few corners can be tracked.

    Corners are tracked from where they are, and from where phase correlation says that the whole picture went: what
    moves by a sixth of the width is found, too. Whichever start tracks more of them is taken.
    """
    height, width = first.shape
    corners = cv2.goodFeaturesToTrack(first, _CORNERS, _QUALITY, _DISTANCE)
    if corners is None or len(corners) < _FEWEST:
        return np.eye(3)
    starts = [np.zeros(2, np.float32), _shift(first, second)]
    begin, end = max((_tracked(first, second, corners, start) for start in starts), key=lambda ends: len(ends[0]))
    if len(begin) < _FEWEST:
        return np.eye(3)
    cv2.setRNGSeed(_SEED)
    found, inliers = cv2.findHomography(begin, end, cv2.USAC_MAGSAC, _INLIER, maxIters=2000, confidence=0.999)
    if found is None or inliers.sum() < _FEWEST or not _is_sound(found, height, width):
        return np.eye(3)
    return found


def moved(plane: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """Where a homography takes points, float32 [rows, cols, 2]."""
    ends = cv2.perspectiveTransform(points.reshape(1, -1, 2).astype(np.float64), plane)
    return ends.reshape(points.shape).astype(np.float32)


def _shift(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(columns, rows) by which the whole picture moved."""
    height, width = first.shape
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(first.astype(np.float32), second.astype(np.float32), window)
    return np.array(shift, np.float32)


def _tracked(
    first: np.ndarray, second: np.ndarray, corners: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners [N, 2] that are found in the second picture and back again, and where they are there."""
    settings = {"winSize": _WINDOW, "maxLevel": _LEVELS, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, corners + start, **settings)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, there - start, **settings)
    near = np.linalg.norm(back - corners, axis=2)[:, 0] < _MOST_ROUND_TRIP
    kept = near & (found[:, 0] > 0) & (found_back[:, 0] > 0)
    return corners[kept, 0], there[kept, 0]


def _is_sound(plane: np.ndarray, height: int, width: int) -> bool:
    """Whether the picture stays a convex one of about its size, and not all of it leaves the frame."""
    outline = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], np.float64)
    ends = cv2.perspectiveTransform(outline, plane)[0]
    sides = np.roll(ends, -1, axis=0) - ends
    turns = sides[:, 0] * np.roll(sides, -1, axis=0)[:, 1] - sides[:, 1] * np.roll(sides, -1, axis=0)[:, 0]
    far = np.abs(ends - outline[0]).max(axis=0)
    return bool((turns > 0.25 * width * height).all() and (far < [width, height]).all())
