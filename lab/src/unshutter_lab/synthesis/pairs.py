"""Pairs of rolling-shutter and global-shutter pictures with known motion, made from undistorted photos.

As in the predecessor: the central square of the photo is resized to a canvas, the canvas is distorted about its centre,
and the centre of both, distorted and not, is the pair. Where the motion reaches beyond the canvas, the distorted
picture is black. With an exposure, the distorted picture is blurred by its own motion (exposure.py).
"""

from __future__ import annotations

import numpy as np

from unshutter.motion import Motion
from unshutter_lab.synthesis.exposure import distorted
from unshutter_lab.synthesis.row_motions import DrawnMotion


def synthesize(photo: np.ndarray, drawn: DrawnMotion, exposure: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Returns one pair at the size of the drawn crop.

    Args:
        photo: undistorted, [H, W] or [H, W, bands], uint8 or uint16; its central square is resized (by area, or
            bilinearly if it is smaller) to the motion's canvas.
        drawn: the motion; its truth for the pair is ``drawn.crop``.
        exposure: exposure time of each row, in readout times of the picture; 0 for no blur.

    Returns:
        (rs, gs): distorted and undistorted picture [rows, rows(, bands)], of the photo's type.
    """
    import cv2

    side = drawn.canvas.height
    square = np.ascontiguousarray(_middle_square(photo, min(photo.shape[:2])))
    method = cv2.INTER_AREA if len(square) >= side else cv2.INTER_LINEAR
    canvas = cv2.resize(square, (side, side), interpolation=method).reshape(side, side, *photo.shape[2:])
    return _distort(canvas, drawn, exposure)


def synthesize_native(
    photo: np.ndarray, drawn: DrawnMotion, exposure: float = 0.0
) -> tuple[np.ndarray, np.ndarray, Motion]:
    """Returns one pair at the photo's own size: same motion and share of the picture, without resizing.

    Args:
        photo: as for :func:`synthesize`.
        drawn: the motion at any size.
        exposure: exposure time of each row, in readout times of the picture; 0 for no blur.

    Returns:
        (rs, gs, motion): pictures and their true motion.
    """
    native = drawn.resized(min(photo.shape[:2]))
    return *_distort(_middle_square(photo, native.canvas.height), native, exposure), native.crop


def _distort(canvas: np.ndarray, drawn: DrawnMotion, exposure: float) -> tuple[np.ndarray, np.ndarray]:
    rows = exposure * (drawn.crop.height - 1)  # read during one exposure
    blurred = distorted(np.atleast_3d(canvas), drawn.canvas, rows).reshape(canvas.shape)
    rs, gs = (_middle_square(a, drawn.crop.height) for a in (blurred, canvas))
    return np.ascontiguousarray(rs), np.ascontiguousarray(gs)


def _middle_square(pixels: np.ndarray, side: int) -> np.ndarray:
    top, left = (pixels.shape[0] - side) // 2, (pixels.shape[1] - side) // 2
    return pixels[top : top + side, left : left + side]
