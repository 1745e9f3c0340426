"""Motion blur: rolling-shutter pictures whose lines have an exposure time, as in a real camera.

The exposure of a line is centred on the time for which its motion is known. During the exposure the picture moves with
the velocity of its motion at that line. The picture is distorted once for each of several moments of the exposure, and
the results are averaged in linear light (sRGB, IEC 61966-2-1), as on a sensor.
"""

from __future__ import annotations

import math

import numpy as np

from unshutter.motion import Motion, RowMotion
from unshutter.warp.pixels import distort_pixels

_STEP_PX = 0.75  # largest step between two moments
_MOST_MOMENTS = 65


def distorted(pixels: np.ndarray, motion: Motion, rows: float = 0.0) -> np.ndarray:
    """Returns the rolling-shutter picture of a global-shutter one, with an exposure given in rows of readout.

    Args:
        pixels: [H, W, bands], uint8 or uint16.
        motion: motion of every row, with any reference row.
        rows: number of rows read during an exposure; 0 for no blur.
    """
    if not rows or motion.height < 2:
        return distort_pixels(pixels, motion)
    velocities = np.gradient(motion.tx_px), np.gradient(motion.rz_rad)
    count = _moments(motion, velocities, rows)
    linear, most = _linear_light(pixels.dtype)
    total = np.zeros(pixels.shape, np.float32)
    for moment in (np.arange(count) + 0.5) / count - 0.5:
        tx, rz = (
            known + moment * rows * velocity
            for known, velocity in zip((motion.tx_px, motion.rz_rad), velocities, strict=True)
        )
        moved = RowMotion(motion.width, tx, rz, reference=motion.reference, readout=motion.readout)
        total += linear[distort_pixels(pixels, moved)]
    return np.round(_encoded(total / count) * most).astype(pixels.dtype)


def _moments(motion: Motion, velocities: tuple[np.ndarray, np.ndarray], rows: float) -> int:
    """Returns how many moments of an exposure are needed for small enough steps."""
    reach = math.hypot(motion.width, motion.height) / 2
    fastest = (np.abs(velocities[0]) + np.abs(velocities[1]) * reach).max()
    return int(np.clip(math.ceil(fastest * rows / _STEP_PX), 1, _MOST_MOMENTS))


def _linear_light(dtype: np.dtype) -> tuple[np.ndarray, int]:
    """Returns the linear light 0 ... 1 of each pixel value, and the largest value."""
    most = int(np.iinfo(dtype).max)
    value = np.arange(most + 1, dtype=np.float32) / most
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32), most


def _encoded(light: np.ndarray) -> np.ndarray:
    """Converts linear light to pixel values 0 ... 1."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
