"""How far an estimated motion is from the true one (docs/conventions; protocol in docs/results)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.motion import Motion

_UNIT = 256  # errors are given in px of a picture of so many rows


@dataclass(frozen=True)
class MotionError:
    """Distance of an estimate from the truth, both with the first row as the reference.

    Attributes:
        epe: mean distance [px at 256 rows] of the RS positions over GS pixels seen in the RS picture.
        curvature_epe: the same when the linear coefficient of t_x is replaced by the best one: what would be
            left were the shear known.
        tx_rmse: root mean square over rows of the error in t_x [px at 256 rows].
        rz_rmse: likewise of r_z [deg].
    """

    epe: float
    curvature_epe: float
    tx_rmse: float
    rz_rmse: float


def motion_error(estimate: Motion, truth: Motion, points: int = 64) -> MotionError:
    """Compares two motions of one picture.

    Args:
        estimate, truth: for the same size.
        points: the EPE is averaged over a grid of about this many columns and rows.
    """
    estimate, truth = estimate.rereferenced("first"), truth.rereferenced("first")
    height, width = truth.height, truth.width
    scale = _UNIT / height
    col, row = np.meshgrid(_spread(width, points), _spread(height, points))
    true_col, true_row = truth.gs_to_rs(col, row)
    inside = (true_col >= 0) & (true_col <= width - 1) & (true_row >= 0) & (true_row <= height - 1)
    found_col, found_row = estimate.gs_to_rs(col, row)
    d_col, d_row = (found_col - true_col)[inside], (found_row - true_row)[inside]
    when = np.clip(found_row[inside], 0, height - 1) / max(height - 1, 1)
    return MotionError(
        epe=float(np.hypot(d_col, d_row).mean()) * scale,
        curvature_epe=_best_shear(d_col, d_row, when) * scale,
        tx_rmse=float(np.sqrt(np.mean((estimate.tx_px - truth.tx_px) ** 2))) * scale,
        rz_rmse=float(np.degrees(np.sqrt(np.mean((estimate.rz_rad - truth.rz_rad) ** 2)))),
    )


def _spread(size: int, points: int) -> np.ndarray:
    count = min(size, points)
    return (np.arange(count) + 0.5) * size / count - 0.5


def _best_shear(d_col: np.ndarray, d_row: np.ndarray, when: np.ndarray) -> float:
    """Least mean distance when k * when is added to the columns; convex in k, so thirds of a bracket do.

    t_x has no part in which RS row sees a GS point, so adding a shear moves columns only.
    """
    low, high = -4 * np.abs(d_col).max(initial=1.0) - 1, 4 * np.abs(d_col).max(initial=1.0) + 1

    def error(k: float) -> float:
        return float(np.hypot(d_col + k * when, d_row).mean())

    for _ in range(60):
        third = (high - low) / 3
        low, high = (low, high - third) if error(low + third) < error(high - third) else (low + third, high)
    return error((low + high) / 2)
