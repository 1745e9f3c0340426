"""Distance of an estimate from the truth: positions (EPE and related figures) and pictures (PSNR, SSIM).

docs/reference/conventions.md defines each.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import minimize_scalar

from unshutter.motion import Motion, RowMotion
from unshutter.motion.shapes import Bool, Float64, UInt8

UNIT_ROWS = 256  # errors are in px of a picture with this many rows

# SSIM as in Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004: Gaussian window, K1, K2
_SSIM_SIGMA = 1.5
_SSIM_RADIUS = 5
_K1, _K2 = 0.01, 0.03


@dataclass(frozen=True)
class MotionError:
    """Distance of an estimate from the truth, both with the first row as the reference.

    Positions come from ``gs_to_rs``, so that every kind of motion is judged by where its picture is sampled, not by t_x
    and r_z. An estimate without a finite position counts as one picture diagonal off.
    """

    epe: float  # mean distance [px at 256 rows] of the RS positions over GS pixels visible in the RS picture
    # the EPE after adding the best multiple of the RS row to the estimate's columns: what would remain if the shear
    # were known. For row motions this replaces the linear coefficient of t_x.
    curvature_epe: float
    tx_rmse: float  # root mean square error of t_x over rows [px at 256 rows]
    rz_rmse: float  # root mean square error of r_z over rows [deg]


def motion_error(
    estimate: Motion, truth: Motion, points: int = 64, moved: Float64[np.ndarray, "2 height width"] | None = None
) -> MotionError:
    """Compares two motions of one picture; the EPE is averaged over a grid of about ``points`` columns and rows.

    ``moved`` is how far every pixel moves (columns, rows) if the true motion does not tell: where there is parallax.
    """
    estimate, truth = estimate.rereferenced("first"), truth.rereferenced("first")
    height, width = truth.height, truth.width
    scale = UNIT_ROWS / height
    col, row = np.meshgrid(_spread(width, points), _spread(height, points))
    if moved is None:
        true_col, true_row = truth.gs_to_rs(col, row)
    else:
        true_col, true_row = np.stack([col, row]) + moved[:, row.astype(int), col.astype(int)]
    inside = (true_col >= 0) & (true_col <= width - 1) & (true_row >= 0) & (true_row <= height - 1)
    with np.errstate(all="ignore"):  # a motion that folds the picture has no solution everywhere
        estimated_col, estimated_row = estimate.gs_to_rs(col, row)
    d_col, d_row = (estimated_col - true_col)[inside], (estimated_row - true_row)[inside]
    d_col, d_row = _at_most(np.hypot(height, width), d_col, d_row)
    when = np.clip((true_row[inside] + d_row), 0, height - 1) / max(height - 1, 1)
    return MotionError(
        epe=float(np.hypot(d_col, d_row).mean()) * scale,
        curvature_epe=_best_shear(d_col, d_row, when) * scale,
        tx_rmse=float(np.sqrt(np.mean((estimate.tx_px - truth.tx_px) ** 2))) * scale,
        rz_rmse=float(np.degrees(np.sqrt(np.mean((estimate.rz_rad - truth.rz_rad) ** 2)))),
    )


def epe_of_nothing(truth: Motion, moved: Float64[np.ndarray, "2 height width"] | None = None) -> float:
    """Returns the EPE [px at 256 rows] of the unchanged picture; for ``moved`` see :func:`motion_error`."""
    return motion_error(RowMotion.zero(truth.height, truth.width), truth, moved=moved).epe


def is_right(epe: np.ndarray, epe_nothing: np.ndarray, epe_best: np.ndarray) -> np.ndarray:
    """[N] whether answers are correct in the sense of the confidence: closer to the truth than the photo.

    For a photo that is left unchanged: whether no candidate would have been closer.

    Args:
        epe, epe_nothing, epe_best: of the answer, of the unchanged photo, and of the best candidate.
    """
    return np.where(epe == epe_nothing, epe_best >= epe_nothing, epe < epe_nothing)


def psnr(
    picture: UInt8[np.ndarray, "height width *bands"],
    truth: UInt8[np.ndarray, "height width *bands"],
    mask: Bool[np.ndarray, "height width"],
) -> float:
    """Returns the peak signal-to-noise ratio [dB] of 8-bit pictures over a mask, all channels together.

    Infinity for equal pictures, NaN if the mask is empty.
    """
    if not mask.any():
        return float("nan")
    off = picture[mask].astype(np.float64) - truth[mask]
    error = float(np.mean(off**2))
    return float("inf") if error == 0 else 10 * float(np.log10(255**2 / error))


def ssim(
    picture: UInt8[np.ndarray, "height width *bands"],
    truth: UInt8[np.ndarray, "height width *bands"],
    mask: Bool[np.ndarray, "height width"],
) -> float:
    """Returns the structural similarity (Wang et al. 2004; Gaussian window of 11 px, sigma 1.5) of 8-bit pictures.

    The mean over channels and over the pixels whose whole window lies in the mask and in the picture; NaN without any.
    """
    window = np.ones((2 * _SSIM_RADIUS + 1,) * 2, np.uint8)
    whole = cv2.erode(mask.astype(np.uint8), window, borderType=cv2.BORDER_CONSTANT, borderValue=[0]) > 0
    if not whole.any():
        return float("nan")
    a, b = (p.reshape(*p.shape[:2], -1).astype(np.float64) for p in (picture, truth))
    channels = [_ssim_map(a[..., k], b[..., k])[whole].mean() for k in range(a.shape[-1])]
    return float(np.mean(channels))


def _ssim_map(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the SSIM index [H, W] of two channels [H, W]; invalid within five pixels of the border."""

    def mean(x: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(x, (2 * _SSIM_RADIUS + 1,) * 2, _SSIM_SIGMA)

    c1, c2 = (_K1 * 255) ** 2, (_K2 * 255) ** 2
    mean_a, mean_b = mean(a), mean(b)
    var_a, var_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
    covariance = mean(a * b) - mean_a * mean_b
    return ((2 * mean_a * mean_b + c1) * (2 * covariance + c2)) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))


def _spread(size: int, points: int) -> np.ndarray:
    count = min(size, points)
    return (np.arange(count) + 0.5) * size / count - 0.5


def _at_most(limit: float, d_col: np.ndarray, d_row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Limits the length of offsets; non-finite ones become offsets of that length along the columns."""
    lost = ~(np.isfinite(d_col) & np.isfinite(d_row))
    d_col, d_row = np.where(lost, limit, d_col), np.where(lost, 0.0, d_row)
    shrink = np.minimum(1.0, limit / np.maximum(np.hypot(d_col, d_row), 1e-12))
    return d_col * shrink, d_row * shrink


def _best_shear(d_col: np.ndarray, d_row: np.ndarray, when: np.ndarray) -> float:
    """Returns the least mean distance over k after adding k * when to the columns; it is convex in k.

    t_x does not determine which RS row reads a GS point, so a shear moves columns only.
    """
    most = 4 * np.abs(d_col).max(initial=1.0) + 1
    best = minimize_scalar(
        lambda k: np.hypot(d_col + k * when, d_row).mean(), bounds=(-most, most), options={"xatol": 1e-9}
    )
    return float(best.fun)
