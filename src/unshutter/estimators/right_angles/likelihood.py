"""The likelihood of line segments given a row motion and a camera, for a scene full of right angles.

The edges of the scene run along three orthogonal directions (Coughlan and Yuille's Manhattan world), seen by a camera
with square pixels: once rectified by the right motion, every segment points to one of three vanishing points or is an
outlier. Shear rotates verticals only, a camera held askew rotates everything: this is how the likelihood distinguishes
them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from unshutter.estimators.right_angles.beliefs import UNKNOWNS, Beliefs, KnownCamera, MotionKind, SecondOpinion
from unshutter.estimators.right_angles.prior import Prior
from unshutter.estimators.right_angles.residuals import AngleResiduals, EndPoints

_PARTS = 4  # horizontally and vertically


class ManhattanLikelihood:
    """Energy (negative log posterior) of hypotheses [S, 10] (beliefs.py), and its derivatives.

    Each segment's sine (residuals.py) comes from a mixture: accurate and inaccurate edges, towards each of the three
    vanishing points, and outliers of arbitrary direction.

    Args:
        segments: [N, 4] end points, centred, in rows (segments.py).
        rows: rows of the picture in which they were detected.
        aspect: its width / height.
        beliefs: priors and noise.
        known: what is known about the camera.
        opinion: another estimate to include.
        kinds: kinds of motion; those of the shipped calibration by default.

    Attributes:
        prior: prior of the unknowns.
        known: what is known about the camera.
        weight: [N] weight of each segment.
        part: [N] the part of the picture, one of sixteen, in which each lies.
    """

    def __init__(
        self,
        segments: np.ndarray,
        rows: int,
        aspect: float = 1.0,
        beliefs: Beliefs | None = None,
        known: KnownCamera | None = None,
        opinion: SecondOpinion | None = None,
        kinds: Sequence[MotionKind] = (),
    ):
        b = beliefs or Beliefs()
        self.known = known or KnownCamera()
        self.prior = Prior(b, self.known, aspect, opinion, kinds)
        self._ends = EndPoints(segments[:, :2]), EndPoints(segments[:, 2:])
        self.part = _parts(segments, aspect)
        self._turn = math.atan2(self.known.up[0], -self.known.up[1])
        length_px = np.hypot(*(segments[:, 2:] - segments[:, :2]).T) * rows
        self.weight = np.minimum(length_px / b.full_weight_px, 1) * b.independent_share
        exact = b.sigma_exact + b.sigma_end_px / length_px
        sigmas = np.stack([exact, np.hypot(exact, b.sigma_sloppy)])  # [2, N]
        self._precisions = 1 / sigmas**2
        shares = np.array([[1 - b.sloppy_share], [b.sloppy_share]]) * (1 - b.outlier_share)
        horizontal_share = (1 - b.vertical_share) / 2
        directions = np.array([[b.vertical_share], [horizontal_share], [horizontal_share]])
        # [2, 3, N]: each Gaussian's share times its density at its peak
        self._peaks = (shares / (sigmas * math.sqrt(2 * math.pi)))[:, None] * directions
        self._anywhere = b.outlier_share / math.pi

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the energy of unknowns: [S, 10] -> [S]."""
        return self._of_segments(self._residuals(unknowns))[0] + self.prior.expanded(unknowns)[0]

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None, camera_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10].

        With the residuals r, their precisions W and J = dr/d unknowns: gradient J^T W r, Hessian J^T W J, plus those of
        the prior.

        Args:
            unknowns: [S, 10].
            kind: [S] index of each motion's kind in the prior; the first by default.
            camera_only: omit derivatives of the segments' energy with respect to the motion; a third faster.
        """
        residuals = self._residuals(unknowns)
        energy, precision = self._of_segments(residuals)
        J = residuals.jacobian(camera_only).reshape(len(unknowns), UNKNOWNS, -1)  # [S, 10, 3 * N]
        J_weighted = J * precision.reshape(len(unknowns), 1, -1)
        gradient = (J_weighted @ residuals.sine.reshape(len(unknowns), -1, 1))[..., 0]
        prior, prior_gradient, prior_hessian = self.prior.expanded(unknowns, kind)
        return energy + prior, gradient + prior_gradient, J_weighted @ J.transpose(0, 2, 1) + prior_hessian

    def lines_gain(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the log-likelihood ratio of the segments against chance, [S, 10] -> [S], nats per unit of weight."""
        by_chance = self.weight.sum() * math.log(math.pi)
        return (by_chance - self._of_segments(self._residuals(unknowns))[0]) / max(self.weight.sum(), 1e-9)

    def of_segments(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the log-likelihood of each segment times its weight: [S, 10] -> [S, N]."""
        return self.weight * np.log(self._densities(self._residuals(unknowns))[0])

    def _residuals(self, unknowns: np.ndarray) -> AngleResiduals:
        return AngleResiduals(self._ends, unknowns, self._turn)

    def _of_segments(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Returns the energy of the segments E [S], and the precision W [S, 3, N] in dE/dsine = W sine.

        W is the precision of each Gaussian times the probability that the segment comes from it (the E step of EM).
        """
        total, precision = self._densities(residuals)
        return -(self.weight * np.log(total)).sum(-1), precision * (self.weight / total)[:, None]

    def _densities(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Densities of the mixture at each sine [S, N], and of its Gaussians times their precision [S, 3, N]."""
        exponent = residuals.sine**2 * -0.5
        density = precision = 0.0
        for each_precision, peak in zip(self._precisions, self._peaks, strict=True):
            part = np.exp(exponent * each_precision) * peak
            density, precision = density + part, precision + part * each_precision
        return np.sum(density, 1) + self._anywhere, np.asarray(precision)


def _parts(segments: np.ndarray, aspect: float) -> np.ndarray:
    """Returns the part of the picture that contains each segment's centre, row by row from 0: [N, 4] -> [N]."""
    middle = (segments[:, :2] + segments[:, 2:]) / 2 / [aspect, 1] + 0.5
    column, row = np.clip((middle * _PARTS).astype(int), 0, _PARTS - 1).T
    return row * _PARTS + column
