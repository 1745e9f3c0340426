"""The central square of 256 px that pixel-based networks see, and the photo's motion derived from the square's.

Rows beyond it (tall photos) get the motion extrapolated by the last slope.
"""

from __future__ import annotations

import numpy as np

from unshutter.estimators.base import View
from unshutter.motion import Motion, RowMotion

SIZE = 256  # px of the square


def square_of(view: View) -> np.ndarray:
    """Returns the largest central square of the readout frame: float32 [1, 3, 256, 256], RGB in 0 ... 1."""
    import cv2

    pixels = view.readout.turn(view.photo.to_array())
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    side, (left, top) = side_of(view), corner_of(view)
    pixels = np.ascontiguousarray(pixels[top : top + side, left : left + side, : 3 if pixels.shape[-1] > 2 else 1])
    shrinks = side >= SIZE
    small = cv2.resize(pixels, (SIZE, SIZE), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    scaled = small.reshape(SIZE, SIZE, -1).astype(np.float32) / np.iinfo(pixels.dtype).max
    return np.ascontiguousarray(np.broadcast_to(scaled, (SIZE, SIZE, 3)).transpose(2, 0, 1)[None])


def motion_of_square(
    view: View, rows: np.ndarray, samples: np.ndarray, estimator: str, degree: int | None = None
) -> Motion:
    """Returns the motion of the whole photo from samples [2, N] (t_x [px of 256], r_z [rad]) at rows [N] of its square.

    Args:
        view: the photo.
        rows: increasing, of 256.
        samples: motion at these rows.
        estimator: name of the estimator.
        degree: degree of the polynomial to fit; None for linear interpolation between the samples.
    """
    scale = side_of(view) / SIZE
    at = (rows + 0.5) * scale - 0.5 + corner_of(view)[1]
    tx, rz = samples[0] * scale, samples[1]
    return RowMotion.from_key_rows(
        at.tolist(),
        tx.tolist(),
        rz.tolist(),
        view.height,
        view.width,
        degree,
        readout=view.readout,
        estimator=estimator,
    )


def side_of(view: View) -> int:
    """Number of rows and columns of the photo within the square [px]."""
    return min(view.height, view.width)


def corner_of(view: View) -> tuple[int, int]:
    """(left, top) of the square in the photo [px]."""
    return (view.width - side_of(view)) // 2, (view.height - side_of(view)) // 2
