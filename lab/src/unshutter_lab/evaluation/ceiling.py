"""The best cubic row motion for a pair: fitted to both pictures, which no estimator may see.

It is the ceiling in the tables for real pairs: the remaining difference comes from parallax, moving objects, other axes
of rotation and the sensor itself, not from the estimate.
"""

from __future__ import annotations

import cv2
import numpy as np

from unshutter.motion import Motion, RowMotion
from unshutter.options import Reference

_SHORT_SIDES = (48, 96, 192, 384)  # of the pyramid [px]; 768 gains less than 0.05 dB
_SHEARS = np.linspace(-0.12, 0.12, 13)  # tried first [rows over the whole readout]
_STEPS = 12  # at each level
_NODES = 33  # horizontally and vertically; the map between them is interpolated
_COEFFICIENTS = 6  # u, u^2, u^3 of t_x [rows] and of r_z [rad]


def fit_to_pair(rs: np.ndarray, gs: np.ndarray, reference: Reference) -> Motion:
    """Fits the cubic t_x and r_z that make the rectified picture most like the global-shutter one (least squares).

    Coarse to fine, from the best of several shears, by Levenberg-Marquardt on grey values of uint8 [H, W, bands]. The
    motion is zero at the reference row, at whose time ``gs`` was taken.
    """
    height, width = rs.shape[:2]
    theta = np.zeros(_COEFFICIENTS)
    for k, side in enumerate(_SHORT_SIDES):
        scale = min(side / min(height, width), 1.0)
        level = _Level(_grey(rs, scale), _grey(gs, scale), reference)
        if k == 0:
            starts = [np.array([shear, 0, 0, 0, 0, 0]) for shear in _SHEARS]
            theta = min((_descended(level, start) for start in starts), key=level.error)
        else:
            theta = _descended(level, theta)
        if scale == 1.0:
            break
    return cubic_motion(theta, height, width, reference)


def cubic_motion(theta: np.ndarray, height: int, width: int, reference: Reference) -> Motion:
    """Returns the motion with coefficients [6] of u, u^2, u^3, u = row / (height - 1): t_x [rows] and r_z [rad].

    Cubic relative to the first row, as in estimators' answers, then re-referenced.
    """
    tx, rz = [0, *(theta[:3] * height)], [0, *theta[3:]]
    return RowMotion.from_polynomials(tx, rz, height, width).rereferenced(reference)


class _Level:
    """A pair at one size, with the residuals of a motion and their derivatives with respect to the coefficients."""

    def __init__(self, rs: np.ndarray, gs: np.ndarray, reference: Reference):
        self.rs, self.gs = rs, gs
        self.reference: Reference = reference
        self.height, self.width = rs.shape
        self.slope_row, self.slope_col = np.gradient(rs)
        self.node_col, self.node_row = np.meshgrid(
            np.linspace(0, self.width - 1, _NODES), np.linspace(0, self.height - 1, _NODES)
        )
        self.down, self.across = _between(self.height), _between(self.width)

    def error(self, theta: np.ndarray) -> float:
        """Mean squared difference of grey values over the visible pixels."""
        residual, visible, *_ = self._residual(theta)
        return float((residual[visible] ** 2).mean()) if visible.any() else np.inf

    def normal_equations(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J^T J [6, 6] and J^T residual [6]."""
        residual, visible, col, row, nodes = self._residual(theta)
        slopes = _look_up(self.slope_col, col, row), _look_up(self.slope_row, col, row)
        jacobian = np.empty((_COEFFICIENTS, int(visible.sum())))
        for k in range(_COEFFICIENTS):
            step = np.zeros(_COEFFICIENTS)
            step[k] = 1e-4
            moved = [(a - b) / 1e-4 for a, b in zip(self._nodes(theta + step), nodes, strict=True)]
            d_col, d_row = (self.down @ m @ self.across.T for m in moved)
            jacobian[k] = (slopes[0] * d_col + slopes[1] * d_row)[visible]
        return jacobian @ jacobian.T, jacobian @ residual[visible]

    def _residual(self, theta: np.ndarray):
        nodes = self._nodes(theta)
        col, row = (self.down @ n @ self.across.T for n in nodes)
        visible = (col >= 0) & (col <= self.width - 1) & (row >= 0) & (row <= self.height - 1)
        return _look_up(self.rs, col, row) - self.gs, visible, col, row, nodes

    def _nodes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        motion = cubic_motion(theta, self.height, self.width, self.reference)
        return motion.gs_to_rs(self.node_col, self.node_row)


def _descended(level: _Level, theta: np.ndarray) -> np.ndarray:
    """Returns the coefficients at a minimum near the given ones."""
    error, damping = level.error(theta), 1e-3
    for _ in range(_STEPS):
        square, gradient = level.normal_equations(theta)
        better = False
        while damping < 1e3 and not better:
            step = np.linalg.solve(square + damping * np.diag(np.diag(square) + 1e-9), gradient)
            tried = level.error(theta - step)
            better = tried < error
            damping = damping / 4 if better else damping * 8
        if not better:
            return theta
        gain, theta, error = (error - tried) / error, theta - step, tried
        if gain < 1e-5:
            return theta
    return theta


def _grey(picture: np.ndarray, scale: float) -> np.ndarray:
    """Returns a float64 [h, w] picture, reduced and slightly blurred."""
    grey = picture.astype(np.float32).mean(axis=-1)
    size = (max(round(picture.shape[1] * scale), 2), max(round(picture.shape[0] * scale), 2))
    small = grey if scale == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), 1.0).astype(np.float64)


def _look_up(values: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    x, y = col.astype(np.float32), row.astype(np.float32)
    return cv2.remap(values.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _between(size: int) -> np.ndarray:
    """[size, _NODES]: interpolation weights at every pixel of nodes spaced evenly from the first to the last."""
    at = np.linspace(0, _NODES - 1, size)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(_NODES)))
