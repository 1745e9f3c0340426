"""Line segments of a picture, detected with OpenCV's LSD, in the units that the estimators share.

Units: centred coordinates (columns right, rows down) divided by the number of rows, so that the picture is one unit
high at any size and its proportions are preserved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, UInt8

FEWEST_SEGMENTS = 8  # with fewer, a photo does not reveal how the camera moved
WIDEST_ASPECT = 2.5  # a little beyond what the network was trained on; beyond it, nothing was measured
_SCALE = 0.8  # LSD works on a copy scaled by this, to smooth the staircase of slanted edges
# LSD maps positions of its scaled copy back without regard to pixel centres; this is the correction.
_PIXEL_SHIFT = 0.5 / _SCALE - 0.5


def find_segments(grey: UInt8[np.ndarray, "height width"], limit: int | None = None) -> Float[np.ndarray, "segments 4"]:
    """Detects straight segments in a grey picture, longest first.

    Args:
        grey: [H, W] uint8.
        limit: maximum number of segments.

    Returns:
        [N, 4] end points (col1, row1, col2, row2) [px], pixel centres at integers, N may be 0.
    """
    cv2.setNumThreads(1)  # LSD is serial; OpenCV's idle threads only cost time
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, _SCALE)
    detected = detector.detect(np.ascontiguousarray(grey))[0]
    if detected is None:
        return np.zeros((0, 4))
    segments = detected.reshape(-1, 4).astype(np.float64) + _PIXEL_SHIFT
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return segments[np.argsort(-length, kind="stable")][:limit]


def in_rows(segments: Float[np.ndarray, "segments 4"], height: int, width: int) -> Float[np.ndarray, "segments 4"]:
    """Converts [N, 4] pixel positions in a picture of that size to centred units of rows."""
    center = np.array([(width - 1) / 2, (height - 1) / 2] * 2)
    return (segments - center) / height


def unusable(segments: Float[np.ndarray, "segments 4"], height: int, width: int) -> Reason | None:
    """Returns why the segments of a photo of that size cannot reveal its motion, or None if they may."""
    if max(width / height, height / width) > WIDEST_ASPECT:
        return Reason.of(Code.TOO_LONG, aspect=WIDEST_ASPECT)
    if len(segments) < FEWEST_SEGMENTS:
        return Reason.of(Code.TOO_FEW_SEGMENTS, segments=len(segments))
    return None
