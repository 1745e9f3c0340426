"""lao2018: estimates one angular velocity for the whole picture from curves that were straight lines.

After Lao, Ait-Aider, "A Robust Method for Strong Rolling Shutter Effects Correction Using Lines with Automatic Feature
Selection" (CVPR 2018): a camera that rotates at a constant rate bends lines in a way determined by four of them; curves
that are not lines of the scene are rejected by random samples of four. Only the abstract was available: the solver,
the thresholds and the refinement are our choices, stated in docs/research/rivals.
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
    forward_differences,
    minimise,
    squared,
)

SHORT_SIDE = 512  # of the grey copy in which curves are detected [px]
SHORTEST = 0.1  # of the short side: short curves have no measurable bend
MOST_CURVES = 150
MIN_CURVES = 4
SAMPLES = 200
SAMPLE_STEPS = 6  # Gauss-Newton steps on each sample
SAMPLE_PX = 0.2  # error of a point in a sample, relative to the prior of the motion
INLIER_PX = 0.5  # root mean square distance of a straight curve from its line [px]
MOTION_SIGMAS = np.array([0.02, 0.02, 0.15])  # rad over the rows about x, y (barely visible in curves) and z
LINE_SPREADS = 10.0  # scale of the cost, in median distances; high, as neighbouring points' errors are correlated
LEAST_SPREAD = 1e-4  # px
SEED = 0


class Lao2018(Estimator):
    """Random samples of four curves, followed by a fit to all inliers."""

    def estimate(self, view: View) -> Finding:
        """Returns uniform rotation; zero motion with a reason if fewer than four curves are found or agree."""
        grey = view.grey(SHORT_SIDE)
        curves = find_curves(grey, SHORTEST * min(grey.shape))[:MOST_CURVES]
        if len(curves) < MIN_CURVES:
            return view.no_motion(self.name, f"only {len(curves)} curves found, four are needed")
        velocity = fit_velocity(curves, grey.shape[0], grey.shape[1], view.focal_px() * grey.shape[0] / view.height)
        if velocity is None:
            return view.no_motion(self.name, "fewer than four curves agree on one angular velocity")
        u = (np.arange(view.height) + 0.5) / view.height
        return view.rotation_motion(u[:, None] * velocity, self.name)


def fit_velocity(curves: np.ndarray, height: int, width: int, focal_px: float) -> np.ndarray | None:
    """Returns the angular velocity [3] about x, y, z [rad per readout] that fits curves [C, K, 2] (col, row) [px].

    None if none fits.
    """
    bends = _Bends(RotatedCurves(curves, height, width, focal_px))
    rng = np.random.default_rng(SEED)
    samples = np.stack([rng.permutation(len(curves))[:MIN_CURVES] for _ in range(SAMPLES)])
    solved = np.concatenate([np.zeros((1, 3)), bends.solve(samples)])  # zero motion is a candidate too
    best = solved[int(np.argmin([bends.cost(v) for v in solved]))]
    straight = np.flatnonzero(bends.spread(best) < INLIER_PX)
    return bends[straight].refine(best) if len(straight) >= MIN_CURVES else None


class _Bends:
    """The remaining bends of curves as a function of angular velocity."""

    def __init__(self, curves: RotatedCurves):
        self._curves, self._length = curves, curve_length(curves.points)

    def __getitem__(self, index: np.ndarray) -> _Bends:
        """Returns a selection of the curves, in the shape of the index."""
        return _Bends(self._curves[index])

    def __call__(self, velocity: np.ndarray) -> np.ndarray:
        """Returns distances [..., C, K] of curves' points [..., C] from their lines for velocities [..., 3] [px]."""
        return self._curves.undone(lambda u: u[..., None] * velocity[..., None, None, :])[1]

    def solve(self, samples: np.ndarray) -> np.ndarray:
        """Returns velocities [S, 3] for samples [S, 4] of curves: least squares from zero motion; NaN if diverging."""
        sampled, theta = self[samples], np.zeros((len(samples), 3))
        prior_precision = (SAMPLE_PX / MOTION_SIGMAS) ** 2

        def residuals(velocity: np.ndarray) -> np.ndarray:
            return sampled(velocity).reshape(len(samples), -1)

        for _ in range(SAMPLE_STEPS):
            r = residuals(theta)
            J = forward_differences(residuals, theta, r, np.full(3, 1e-6))  # [S, 4 K, 3]
            J_T = np.swapaxes(J, 1, 2)
            normal = J_T @ J + np.diag(prior_precision)
            gradient = (J_T @ r[..., None])[..., 0] + prior_precision * theta
            theta = theta - np.linalg.solve(normal, gradient[..., None])[..., 0]
        return theta

    def spread(self, velocity: np.ndarray) -> np.ndarray:
        """Returns the root mean square distance of each curve from its line [C] [px]."""
        return np.sqrt((self(velocity) ** 2).mean(axis=-1))

    def cost(self, velocity: np.ndarray) -> float:
        """Returns the MSAC cost: squared spreads, bounded, weighted by length."""
        bounded = np.fmin(self.spread(velocity) / INLIER_PX, 1.0) ** 2  # fmin: a sample that diverged counts as bad
        return float((bounded * self._length).sum())

    def refine(self, velocity: np.ndarray) -> np.ndarray:
        """Returns the velocity [3] that best fits all curves; the scale adapts to the residuals."""
        for _ in range(10):
            sigma = max(LINE_SPREADS * float(np.median(np.abs(self(velocity)))), LEAST_SPREAD)
            last = velocity
            velocity, _ = minimise(
                lambda v, sigma=sigma: np.concatenate([v / MOTION_SIGMAS, self(v).ravel() / sigma]), velocity, _loss
            )
            if np.abs(velocity - last).max() < 1e-7:
                break
        return velocity


def _loss(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared loss for the motion, Cauchy loss for distances."""
    (motion_cost, motion_weight), (line_cost, line_weight) = squared(r[:3]), cauchy(r[3:])
    return np.concatenate([motion_cost, line_cost]), np.concatenate([motion_weight, line_weight])
