"""Estimates the camera's speed from motion blur: the length of the smears in each band of rows.

A smear of length L along the rows multiplies the power of the picture along them by sinc^2(f L) at the frequency f. The
power along the columns shows what it would be without smears, up to a factor and a power of f by which scenes differ:

    log(P_rows / P_columns) = a + b log f + log((1 - n) sinc^2(f L) + n)

where n is the share of noise in the power. In each band of rows, a, b and the level of the noise are fitted for each L;
then all bands together give L = |c0 + c1 (u - 1/2)| of the row u. The photo is smeared if this explains the powers much
better than L = 0, and if edges along the rows are wider than edges along the columns, as such smears make them. With
exposure and readout time, L is the speed of the picture, except for its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from unshutter.single.sharpness import BLUR

if TYPE_CHECKING:
    from unshutter.motion.shapes import Float32, Float64, UInt8
    from unshutter.single.sharpness import SpeedLimit

_LENGTHS = np.concatenate([[0.0], np.geomspace(0.8, 64, 80)])  # px of the copy
_SLOPES = np.linspace(-4, 4, 33)  # c1 / c0


@dataclass(frozen=True)
class Smear:
    """The speed of a photo's scene along the rows by its motion blur: c0 + c1 (u - 1/2) at row u, or the opposite."""

    speed: Float64[np.ndarray, "2"]  # c0, c1 [rows per readout]
    covariance: Float64[np.ndarray, "2 2"]  # of their errors

    @staticmethod
    def jacobian() -> Float64[np.ndarray, "2 6"]:
        """Returns the derivatives of c0 and c1 by the coefficients of prior.py: rotation moves rows off the centre."""
        off = _centres()
        u = off + 0.5
        J_tx = np.stack([np.ones_like(u), 2 * u, 3 * u**2], axis=1)
        J_speed = np.concatenate([J_tx, -off[:, None] * J_tx], axis=1)  # [bands, 6]
        return np.linalg.pinv(np.stack([np.ones_like(u), off], axis=1)) @ J_speed


def smear_of(
    grey: UInt8[np.ndarray, "height width"], scale: float, limit: SpeedLimit, readout_error: float
) -> Smear | None:
    """Measures the smears of a photo; returns None if there are none, or they do not fit sideways motion.

    Args:
        scale: px of the photo per px of the copy.
        readout_error: standard deviation of the readout time's logarithm.
    """
    if not limit.readout_s or min(grey.shape) < BLUR.smallest:
        return None
    per_px = limit.readout_s / limit.exposure_s
    across, along = (float(np.median(width)) / per_px for width in (limit.tx_px, limit.ty_px))  # px of the photo
    if not BLUR.across * along <= across < np.inf:
        return None
    profile, gain = _profile(_residuals(grey.astype(np.float32)))
    length = float(np.abs(profile[0] + profile[1] * _centres()).mean())
    low, high = (share * across / scale for share in BLUR.to_edges)
    if gain < BLUR.clear or length < BLUR.shortest or not low <= length <= high:
        return None
    speed = profile * per_px / len(grey)
    size = length * per_px / len(grey)
    own = np.diag([(BLUR.error * size) ** 2, (BLUR.slope_error * size) ** 2])
    return Smear(speed, own + readout_error**2 * np.outer(speed, speed))


def _residuals(grey: Float32[np.ndarray, "height width"]) -> Float64[np.ndarray, "bands lengths"]:
    """Returns what each length leaves unexplained of each band's spectra: the mean square."""
    height = len(grey)
    window = min(BLUR.window, 1 << (min(grey.shape).bit_length() - 1))
    left = []
    for k in range(BLUR.bands):
        top = int(np.clip((k + 0.5) * height / BLUR.bands - window / 2, 0, height - window))
        rows = grey[k * height // BLUR.bands : (k + 1) * height // BLUR.bands]
        columns = np.ascontiguousarray(grey[top : top + window].T)
        left.append(_unexplained(_power(rows, window), _power(columns, window)))
    return np.array(left)


def _unexplained(rows: Float64[np.ndarray, "powers"], columns: Float64[np.ndarray, "powers"]) -> np.ndarray:
    """[lengths] mean square residual of one band, at the best level of noise."""
    window = 2 * (len(rows) - 1)
    k = np.arange(2, window // 2 - 1)
    frequency = k / window
    damping = _damping(window)[:, k]
    measured = np.log((rows[k] + BLUR.faint) / (columns[k] + BLUR.faint))
    floor = np.percentile(rows[int(BLUR.high * window) :], 30)
    best = np.full(len(_LENGTHS), np.inf)
    for level in np.array([0, 0.25, 0.5, 1, 2]):  # multiples of the power along the rows at high frequencies
        noise = np.clip(level * floor / (columns[k] + BLUR.faint), *BLUR.noise)
        weight = (1 - noise) / np.sqrt(k)  # about the same for each octave
        weight /= weight.sum()
        log_f = np.log(frequency)
        model = np.stack([np.ones_like(log_f), log_f - weight @ log_f], axis=1)
        normal = (model * weight[:, None]).T @ model + np.diag([0, BLUR.ridge])
        target = measured - np.log(damping * (1 - noise) + noise)  # [lengths, frequencies]
        fitted = np.linalg.solve(normal, (model * weight[:, None]).T @ target.T)
        best = np.minimum(best, (target - (model @ fitted).T) ** 2 @ weight)
    return best


def _power(lines: Float32[np.ndarray, "lines px"], window: int) -> Float64[np.ndarray, "powers"]:
    """Returns the mean power of half-overlapping pieces of the lines, under a Hann window."""
    count = int(np.ceil((lines.shape[1] - window) / (window / 2))) + 1
    hann = np.hanning(window + 2)[1:-1].astype(np.float32)
    total = np.zeros(window // 2 + 1)
    for start in np.linspace(0, lines.shape[1] - window, count).astype(int):
        piece = lines[:, start : start + window]
        piece = (piece - (piece @ hann / hann.sum())[:, None]) * hann
        total += (np.abs(np.fft.rfft(piece, axis=1)) ** 2).mean(axis=0)
    return total / count / (hann**2).sum()


@cache
def _damping(window: int) -> Float64[np.ndarray, "lengths powers"]:
    """Returns the factor on the power by smears of each length, as the Hann window shows it."""
    frequency = np.arange(window // 2 + 2) / window
    exact = np.sinc(_LENGTHS[:, None] * frequency) ** 2
    seen = exact[:, :-1].copy()
    seen[:, 1:] = exact[:, 1:-1] * 2 / 3 + (exact[:, :-2] + exact[:, 2:]) / 6
    return seen


def _profile(residuals: Float64[np.ndarray, "bands lengths"]) -> tuple[np.ndarray, float]:
    """Returns c0, c1 [px] that explain all bands best, and how many times more no smear leaves unexplained."""
    lower, share = _grid()
    bands = np.arange(BLUR.bands)
    total = (residuals[bands, lower] * (1 - share) + residuals[bands, lower + 1] * share).sum(axis=-1)
    i, j = np.unravel_index(total.argmin(), total.shape)
    middle = _LENGTHS[1 + i]
    return np.array([middle, middle * _SLOPES[j]]), float(residuals[:, 0].sum() / max(total[i, j], 1e-12))


@cache
def _grid() -> tuple[np.ndarray, np.ndarray]:
    """[c0, c1, bands] index of the next smaller length, and share of the next larger one."""
    length = np.abs(_LENGTHS[1:, None, None] * (1 + _SLOPES[:, None] * _centres()))
    position = np.interp(length, _LENGTHS, np.arange(len(_LENGTHS)))
    lower = np.minimum(position.astype(int), len(_LENGTHS) - 2)
    return lower, position - lower


def _centres() -> Float64[np.ndarray, "bands"]:
    """Returns u - 1/2 in the middle of each band."""
    return (np.arange(BLUR.bands) + 0.5) / BLUR.bands - 0.5
