"""Optical flow between two frames, in both directions.

Most of the motion is common to the whole picture: a homography of tracked corners removes it first, and dense inverse
search (DIS: Kroeger, Timofte, Dai, Van Gool, ECCV 2016, in OpenCV) finds the rest. A pixel that leaves the picture has
no match; its flow is that of the homography.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float32, Float64, UInt8

_PATCH, _STRIDE = 12, 4  # px; larger patches than OpenCV's presets: docs/research/frames-attempts.md
_DESCENTS, _REFINEMENTS = 25, 5
_NO_SECOND_MAP: Any = None  # OpenCV's stubs do not allow None; 5.0 would treat an empty array as a map
_CONSISTENT = 1.5  # px: forward-backward error
_CORNERS = 600
_QUALITY, _DISTANCE = 0.005, 5  # of corners: share of the best one's strength; px between them
_WINDOW, _LEVELS = (15, 15), 4  # of Lucas-Kanade tracking
_MOST_ROUND_TRIP = 0.5  # px: forward-backward error of a tracked corner
_FEWEST = 12
_INLIER = 1.0  # px
_SEED = 0


@dataclass(frozen=True)
class Flow:
    """Optical flow between two frames.

    Attributes:
        forward: from each pixel of the earlier frame to its match in the later one [px], (columns, rows).
        backward: from each pixel of the later frame to its match in the earlier one [px].
        plane: homography from the earlier frame to the later one: the motion of most of the picture.
        consistent: share of the pixels with a match whose forward-backward error is below 1.5 px.
    """

    forward: Float32[np.ndarray, "height width 2"]
    backward: Float32[np.ndarray, "height width 2"]
    plane: Float64[np.ndarray, "3 3"]
    consistent: float


def flow_between(
    earlier: UInt8[np.ndarray, "height width"], later: UInt8[np.ndarray, "height width"], halvings: int = 0
) -> Flow:
    """Computes the flow between two grey pictures of the same size, each direction in its own thread.

    Args:
        earlier, later: the pictures.
        halvings: number of times the pictures are halved before the last search; 1 takes a quarter of the time.
    """
    plane = plane_between(earlier, later)
    with ThreadPoolExecutor(2) as threads:
        there = threads.submit(_one_way, earlier, later, plane, halvings)
        back = threads.submit(_one_way, later, earlier, np.linalg.inv(plane), halvings)
        forward, backward = there.result(), back.result()
    return Flow(forward, backward, plane, _consistent_share(forward, backward))


@lru_cache(maxsize=2)
def pixel_grid(height: int, width: int) -> Float32[np.ndarray, "height width 2"]:
    """Returns (column, row) of every pixel; read-only, because the array is shared between callers."""
    grid = np.empty((height, width, 2), np.float32)
    grid[..., 0], grid[..., 1] = np.arange(width), np.arange(height)[:, None]
    grid.setflags(write=False)
    return grid


def bilinear(field: np.ndarray, positions: Float32[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """Interpolates a field [h, w, ...] bilinearly at positions, replicating its border."""
    return cv2.remap(field, positions, _NO_SECOND_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def inside(positions: Float32[np.ndarray, "rows cols 2"], height: int, width: int) -> np.ndarray:
    """Bool [rows, cols]: whether each position lies in a picture."""
    column, row = positions[..., 0], positions[..., 1]
    return (column >= 0) & (column <= width - 1) & (row >= 0) & (row <= height - 1)


def _one_way(source: np.ndarray, target: np.ndarray, plane: np.ndarray, halvings: int) -> np.ndarray:
    height, width = source.shape
    grid = pixel_grid(height, width)
    ends = moved(plane, grid)
    rest = _search(halvings).calc(source, bilinear(target, ends), cast(np.ndarray, None))  # None: no initial flow
    flow = moved(plane, grid + rest) - grid
    outside = ~inside(ends, height, width)
    flow[outside] = (ends - grid)[outside]
    return flow


def _search(halvings: int) -> cv2.DISOpticalFlow:
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(halvings)
    search.setPatchSize(_PATCH)
    search.setPatchStride(_STRIDE)
    search.setGradientDescentIterations(_DESCENTS)
    search.setVariationalRefinementIterations(_REFINEMENTS)
    return search


def _consistent_share(forward: np.ndarray, backward: np.ndarray) -> float:
    height, width = forward.shape[:2]
    partner = pixel_grid(height, width) + forward
    has_one = inside(partner, height, width)
    if not has_one.any():
        return 0.0
    off = np.linalg.norm(forward + bilinear(backward, partner), axis=-1)
    return float((off[has_one] < _CONSISTENT).mean())


# ---- the homography --------------------------------------------------------------------------------------


def plane_between(
    first: UInt8[np.ndarray, "height width"], second: UInt8[np.ndarray, "height width"]
) -> Float64[np.ndarray, "3 3"]:
    """Returns the homography between two pictures, or the identity if too few corners can be tracked.

    Corners are tracked from two starting points: their own position, and that shifted by phase correlation, so that
    motion of up to a sixth of the width is found. The start that tracks more corners is used.
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
    homography, inliers = cv2.findHomography(begin, end, cv2.USAC_MAGSAC, _INLIER, maxIters=2000, confidence=0.999)
    if homography is None or inliers.sum() < _FEWEST or not _is_sound(homography, height, width):
        return np.eye(3)
    return homography


def moved(plane: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """Maps points by a homography, float32 [rows, cols, 2]."""
    ends = cv2.perspectiveTransform(points.reshape(1, -1, 2).astype(np.float64), plane)
    return ends.reshape(points.shape).astype(np.float32)


def _shift(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns (columns, rows) by which the whole picture moved, from phase correlation."""
    height, width = first.shape
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(first.astype(np.float32), second.astype(np.float32), window)
    return np.array(shift, np.float32)


def _tracked(
    first: np.ndarray, second: np.ndarray, corners: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners [N, 2] tracked to the second picture and back, and their positions there."""
    settings = {"winSize": _WINDOW, "maxLevel": _LEVELS, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    there, status, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, corners + start, **settings)
    back, status_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, there - start, **settings)
    near = np.linalg.norm(back - corners, axis=2)[:, 0] < _MOST_ROUND_TRIP
    good = near & (status[:, 0] > 0) & (status_back[:, 0] > 0)
    return corners[good, 0], there[good, 0]


def _is_sound(plane: np.ndarray, height: int, width: int) -> bool:
    """Whether the mapped picture remains convex and of similar size, and does not leave the frame entirely."""
    outline = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], np.float64)
    ends = cv2.perspectiveTransform(outline, plane)[0]
    sides = np.roll(ends, -1, axis=0) - ends
    turns = sides[:, 0] * np.roll(sides, -1, axis=0)[:, 1] - sides[:, 1] * np.roll(sides, -1, axis=0)[:, 0]
    far = np.abs(ends - outline[0]).max(axis=0)
    return bool((turns > 0.25 * width * height).all() and (far < [width, height]).all())
