"""Estimates how fast the camera moved sideways from the length of the motion blur (smears) in the photo.

A camera that moves s px/s while a row is exposed for t_exp smears every edge across its path over L = s t_exp px. Steps
of brightness therefore recur, inverted, L px further on: the autocorrelation of the differences between neighbouring
columns has a dip at L, unlike that of the differences between neighbouring rows. Most bands of rows must agree, and the
edges must be as wide as smears of this length make them (speed_limit.py); otherwise it is a pattern of the scene.

The length gives the distance that the picture moved during readout, L T / t_exp, but not the direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from unshutter.estimators.speed_limit import SpeedLimit
    from unshutter.geometry.shapes import Float32, UInt8

_SHORTEST, _LONGEST = 5, 128  # px of the copy
_SMALLEST = 128  # px, short side of a copy
_BANDS, _AGREEING = 4, 3
_NEAR_PX, _NEAR_SHARE = 2.0, 0.25  # tolerated difference between the bands' lengths and their median
_CLEAR = 3.2  # depth of a dip, relative to the spread of the rest
_STEEPEST = 40.0  # levels: steeper steps are clipped, so that a few edges do not dominate
_WIDEST = 2.0  # smears are rarely longer than this multiple of the sharpest edges' width
_ACROSS = 1.6  # smeared edges are at least this multiple of the width of those along the motion
_LENS_PX = 0.5  # offset of the dip from the length of the smear, due to the lens's blur
_ERROR = 0.12  # relative error of lengths


@dataclass(frozen=True)
class Smear:
    """The motion blur of a photo whose camera moved sideways.

    Attributes:
        tx_px: displacement of the picture over a whole readout, to the left or right [px of the photo].
        error: its relative standard deviation.
    """

    tx_px: float
    error: float


def smear_of(
    grey: UInt8[np.ndarray, "height width"], scale: float, limit: SpeedLimit, readout_error: float
) -> Smear | None:
    """Measures the smears of a photo; returns None if there are none, or they do not fit sideways motion.

    Args:
        grey: copy of the photo in its readout frame.
        scale: px of the photo per px of the copy.
        limit: the speed limit from the photo's sharpness.
        readout_error: standard deviation of the readout time's logarithm.
    """
    if not limit.readout_s or min(grey.shape) < _SMALLEST:
        return None
    per_px = limit.readout_s / limit.exposure_s
    across, along = (float(np.median(width)) / per_px for width in (limit.tx_px, limit.ty_px))
    if not _ACROSS * along <= across < math.inf:
        return None
    lengths, clear = _lengths(grey.astype(np.float32))
    length = float(np.median(lengths))
    agreeing = np.abs(lengths - length) <= max(_NEAR_PX, _NEAR_SHARE * length)
    if agreeing.sum() < _AGREEING or np.median(clear) < _CLEAR or length < _SHORTEST:
        return None
    length = float(np.median(lengths[agreeing])) * scale
    if length > _WIDEST * across:
        return None
    return Smear(length * per_px, math.hypot(_ERROR, readout_error))


def _lengths(grey: Float32[np.ndarray, "height width"]) -> tuple[np.ndarray, np.ndarray]:
    """[_BANDS] lengths of the smears along the rows of each band [px], and their clarity."""
    height, width = grey.shape
    lags = min(_LONGEST, width // 4, height // 4)
    along = _autocorrelation(grey.T, lags)
    lengths, clear = [], []
    for band in np.array_split(grey, _BANDS):
        dips = (_autocorrelation(band, lags) - along)[_SHORTEST:]
        at = int(dips.argmin())
        rest = np.delete(dips, slice(max(at - 3, 0), at + 4))
        spread = 1.48 * float(np.median(np.abs(rest - np.median(rest))))
        clear.append((float(np.median(rest)) - dips[at]) / max(spread, 1e-6))
        lengths.append(at + _SHORTEST - _LENS_PX)
    return np.array(lengths), np.array(clear)


def _autocorrelation(lines: Float32[np.ndarray, "lines px"], lags: int) -> np.ndarray:
    """[lags] autocorrelation of the differences along lines, averaged over them."""
    steps = np.clip(np.diff(lines, axis=1), -_STEEPEST, _STEEPEST)
    size = 1 << (steps.shape[1] + lags - 1).bit_length()
    power = np.abs(np.fft.rfft(steps - steps.mean(), size, axis=1)) ** 2
    found = np.fft.irfft(power.mean(axis=0), size)[:lags]
    return found / max(float(found[0]), 1e-9)
