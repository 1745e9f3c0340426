"""rengarajan2016: estimates polynomial rotations about three axes from curves that were straight lines.

After Rengarajan, Rajagopalan, Aravind, "From Bows to Arrows" (CVPR 2016): rotations that make the curves straight, the
near-vertical ones vertical and the near-horizontal ones horizontal, and preserve the curves' vertical extents. What the
text leaves open (detector, degree, thresholds, optimiser) is our choice, stated in docs/research/rivals.
"""

from __future__ import annotations

import numpy as np

from unshutter.motion.finding import Finding
from unshutter.single.estimator import Estimator, View
from unshutter_lab.methods.curves import (
    RotatedCurves,
    cauchy,
    curve_length,
    find_curves,
    geman_mcclure,
    minimise,
    principal_lines,
)

SHORT_SIDE = 512  # of the grey copy in which curves are detected [px]
SHORTEST = 0.05  # of the short side: length of a prominent curve
MOST_CURVES = 250
MIN_CURVES = 6
DEGREE = 3  # of the polynomials in the row
NEAR = np.radians(25)  # curves within this angle of the vertical or the horizontal belong to that class
# Scales: the residual with a cost of 1. From coarse to fine, those of lines and angles approach the picture's own
# spread, so that the regularising terms for what curves do not determine (lengths, size of the motion) vanish if
# curves are exact. A stage shrinks them by no more than SHRINKAGE, or the fit would creep along a narrow valley.
LINE_SPREADS, COARSEST_LINE = 20.0, 5.0  # of the median distance (high: neighbouring points' errors are correlated); px
ANGLE_SPREADS, COARSEST_ANGLE = 2.0, np.radians(8.0)  # of the median angle; rad
SHRINKAGE = 0.5
LEAST_SPREAD = 1e-4  # px, rad
STAGES = 20
LENGTH_BOUND = 0.02  # root mean square of the relative change of vertical extents; above it, a cost
LENGTH_SIGMA = 0.01  # with this scale
MOTION_SIGMAS = np.array([0.005, 0.15, 0.1])  # rad; of the coefficients about x (barely visible in curves), y and z


class Rengarajan2016(Estimator):
    """Minimises line cost + angle cost + length cost, the Lagrangian form of the method's constrained problem."""

    def estimate(self, view: View) -> Finding:
        """Returns polynomial rotations; zero motion with a reason if there are too few curves."""
        grey = view.grey(SHORT_SIDE)
        curves = find_curves(grey, SHORTEST * min(grey.shape))[:MOST_CURVES]
        if len(curves) < MIN_CURVES:
            return view.no_motion(self.name, f"only {len(curves)} prominent curves found")
        coefficients = fit_rotations(
            curves, grey.shape[0], grey.shape[1], view.focal_px() * grey.shape[0] / view.height
        )
        if coefficients is None:
            return view.no_motion(self.name, "none of the curves is near-vertical or near-horizontal")
        u = (np.arange(view.height) + 0.5) / view.height
        return view.rotation_motion(polynomial_rotations(coefficients, u), self.name)


def polynomial_rotations(coefficients: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Returns rotation vectors [..., 3] at u [...]: the sum of coefficients [D, 3] times u^1 ... u^D [rad]."""
    return np.stack([u ** (k + 1) for k in range(len(coefficients))], axis=-1) @ coefficients


def fit_rotations(curves: np.ndarray, height: int, width: int, focal_px: float) -> np.ndarray | None:
    """Returns coefficients [DEGREE, 3] of the rotations [rad] that rectify the curves; None if no class is known.

    The costs are minimised in stages: the angles' scale shrinks, so that curves that are near-vertical or
    near-horizontal only by chance lose their influence. Curves are [C, K, 2] points (col, row) [px].
    """
    costs = Costs(curves, height, width, focal_px)
    if not (costs.vertical.any() or costs.horizontal.any()):
        return None
    coefficients = np.zeros(DEGREE * 3)
    for _ in range(STAGES):
        coefficients, _ = minimise(costs.residuals, coefficients, costs.loss, steps=30, tolerance=1e-6)
        if not costs.shrink_scales(coefficients):
            break
    return coefficients.reshape(DEGREE, 3)


class Costs:
    """The costs of rotation coefficients [DEGREE * 3], as residuals and their loss for :func:`minimise`."""

    def __init__(self, curves: np.ndarray, height: int, width: int, focal_px: float):
        self._curves = RotatedCurves(curves, height, width, focal_px)
        angle = np.abs(principal_lines(curves)[1])
        self.horizontal, self.vertical = angle < NEAR, angle > np.pi / 2 - NEAR
        self._length, self._extent = curve_length(curves), _extent(curves)
        self._certainty = np.minimum(self._length / (height / 10), 1.0)[self.horizontal | self.vertical]
        self._line_sigma, self._angle_sigma = COARSEST_LINE, COARSEST_ANGLE

    def shrink_scales(self, coefficients: np.ndarray) -> bool:
        """Moves the scales towards the spread of the current residuals; returns whether that changes them much."""
        bends, angles, _ = self._terms(coefficients)
        before = self._line_sigma, self._angle_sigma
        spreads = LINE_SPREADS * np.median(np.abs(bends)), ANGLE_SPREADS * np.median(np.abs(angles))
        self._line_sigma, self._angle_sigma = (
            float(min(now, max(spread, now * SHRINKAGE, LEAST_SPREAD)))
            for now, spread in zip(before, spreads, strict=True)
        )
        return self._line_sigma < 0.9 * before[0] or self._angle_sigma < 0.9 * before[1]

    def residuals(self, coefficients: np.ndarray) -> np.ndarray:
        """Each term divided by its scale: distances from lines, angles to the class's direction, lengths, motion."""
        bends, angles, stretch = self._terms(coefficients)
        excess = max(float(np.sqrt((stretch**2).mean())) - LENGTH_BOUND, 0.0) if stretch.size else 0.0
        held_back = np.append(coefficients.reshape(DEGREE, 3) / MOTION_SIGMAS, excess / LENGTH_SIGMA)
        return np.concatenate([bends.ravel() / self._line_sigma, angles / self._angle_sigma, held_back])

    def loss(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cauchy loss for lines, Geman-McClure loss for angles (weighted by length), squared loss for the rest."""
        bends, angles, held_back = np.split(r, np.cumsum([self._curves.points[..., 0].size, len(self._certainty)]))
        (bend_cost, bend_weight), (angle_cost, angle_weight) = cauchy(bends), geman_mcclure(angles)
        cost = [bend_cost, self._certainty * angle_cost, held_back**2]
        return np.concatenate(cost), np.concatenate(
            [bend_weight, self._certainty * angle_weight, np.ones_like(held_back)]
        )

    def _terms(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        shape = coefficients.reshape(DEGREE, 3)
        points, bends = self._curves.undone(lambda u: polynomial_rotations(shape, u))
        across, down = np.moveaxis(points[:, -1] - points[:, 0], -1, 0)
        off = np.where(self.horizontal, np.arctan2(down * np.sign(across), np.abs(across)), 0.0)
        off = np.where(self.vertical, np.arctan2(across * np.sign(down), np.abs(down)), off)
        stretch = (_extent(points) - self._extent) / self._length
        return bends, off[self.horizontal | self.vertical], stretch[self.vertical]


def _extent(points: np.ndarray) -> np.ndarray:
    """Number of rows that curves [C, K, 2] span [px]."""
    return np.abs(points[:, -1, 1] - points[:, 0, 1])
