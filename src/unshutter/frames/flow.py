"""Optical flow between two frames, in both directions.

Most of the motion is that of the whole picture: a homography (plane.py) takes it out first, dense inverse search (DIS:
Kroeger, Timofte, Dai, Van Gool, ECCV 2016, as OpenCV has it) finds what is left. Where a pixel has left the picture,
it has no partner there, and its flow is that of the homography.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import cv2
import numpy as np

from unshutter.frames.plane import moved, plane_between

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float32, Float64, UInt8

_PATCH, _STRIDE = 12, 4  # px; larger patches than OpenCV's presets: docs/frames-attempts.md
_DESCENTS, _REFINEMENTS = 25, 5
_NO_SECOND_MAP: Any = None  # OpenCV's stubs do not know that it may be None; 5.0 reads an empty array as a map
_CONSISTENT = 1.5  # px from a pixel to its partner and back


@dataclass(frozen=True)
class Flow:
    """Where the pixels of two frames are in the other one.

    Attributes:
        forward: from each pixel of the earlier frame to its partner in the later one [px], (columns, rows).
        backward: from each pixel of the later frame to its partner in the earlier one [px].
        plane: homography from the earlier frame to the later one: the motion that most of the picture shares.
        consistent: share of the pixels with a partner that are led there and back to within 1.5 px.
    """

    forward: Float32[np.ndarray, "height width 2"]
    backward: Float32[np.ndarray, "height width 2"]
    plane: Float64[np.ndarray, "3 3"]
    consistent: float


def flow_between(earlier: UInt8[np.ndarray, "height width"], later: UInt8[np.ndarray, "height width"]) -> Flow:
    """The flow between two grey pictures of one size, each direction in a thread of its own."""
    plane = plane_between(earlier, later)
    with ThreadPoolExecutor(2) as threads:
        there = threads.submit(_one_way, earlier, later, plane)
        back = threads.submit(_one_way, later, earlier, np.linalg.inv(plane))
        forward, backward = there.result(), back.result()
    return Flow(forward, backward, plane, _consistent_share(forward, backward))


def pixel_grid(height: int, width: int) -> Float32[np.ndarray, "height width 2"]:
    """(column, row) of every pixel."""
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.stack([columns, rows], axis=-1)


def looked_up(field: np.ndarray, positions: Float32[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """A field [h, w, ...] at positions in it, bilinear; beyond its border, what it has there."""
    return cv2.remap(field, positions, _NO_SECOND_MAP, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def inside(positions: Float32[np.ndarray, "rows cols 2"], height: int, width: int) -> np.ndarray:
    """Bool [rows, cols]: which positions lie in a picture."""
    column, row = positions[..., 0], positions[..., 1]
    return (column >= 0) & (column <= width - 1) & (row >= 0) & (row <= height - 1)


def _one_way(source: np.ndarray, target: np.ndarray, plane: np.ndarray) -> np.ndarray:
    height, width = source.shape
    grid = pixel_grid(height, width)
    ends = moved(plane, grid)
    rest = _search().calc(source, looked_up(target, ends), cast(np.ndarray, None))  # None: from no flow at all
    flow = moved(plane, grid + rest) - grid
    has_left = ~inside(ends, height, width)
    flow[has_left] = (ends - grid)[has_left]
    return flow


def _search() -> cv2.DISOpticalFlow:
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(0)
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
    off = np.linalg.norm(forward + looked_up(backward, partner), axis=-1)
    return float((off[has_one] < _CONSISTENT).mean())
