"""Where a rectified picture looks in its photo, as ``cv2.remap`` takes it."""

import numpy as np

from unshutter import Motion
from unshutter.export import PixelMap


def backward_map(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """(col, row), each float32 [H, W] in stored orientation [px]."""
    pixel_map = PixelMap.of(motion)
    return pixel_map.col, pixel_map.row
