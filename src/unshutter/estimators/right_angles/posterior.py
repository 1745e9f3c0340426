"""The posterior of the row motion, and the displacement that motions cause in a picture.

Coefficients of motions are those of beliefs.py: of u, u^2, u^3 in t_x [rows] and in r_z [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

PX = 256.0  # rows of the reference picture for displacements and calibration


@dataclass(frozen=True)
class Pose:
    """The orientation and focal length of a camera.

    Attributes:
        roll: clockwise rotation of the scene [rad].
        tilt: upward tilt [rad].
        log_focal: logarithm of the ratio of its focal length to the expected one.
    """

    roll: float
    tilt: float
    log_focal: float


@dataclass(frozen=True, eq=False)
class Optima:
    """The motions at the local maxima of the posterior.

    Attributes:
        motions: [K, 6] coefficients.
        covariances: [K, 6, 6] of each maximum.
        kind: [K] index of the kind of motion.
        share: [K] posterior probability, given that the camera moved.
    """

    motions: np.ndarray
    covariances: np.ndarray
    kind: np.ndarray
    share: np.ndarray


@dataclass(frozen=True)
class Posterior:
    """The posterior of the motion given the segments and priors, with evidence on whether there was any.

    Attributes:
        motion: [6] coefficients of u, u^2, u^3 of t_x [rows] and r_z [rad]: the mean, given that the camera moved.
        covariance: [6, 6] of them.
        optima: optima for all kinds of motion.
        kinds: name of each kind of motion -> its posterior probability, given that the camera moved.
        evidence_of: name of each kind -> log evidence for it against a camera at rest, with equal priors [nats].
        evidence: log evidence for any motion against a camera at rest [nats]. It is overstated, see odds.py.
        lines_gain: log-likelihood ratio of the segments at the best optimum against chance [nats per unit of weight].
        weight: total weight of the segments: their number of independent observations.
        gain_at_rest: lines_gain of no motion, with its best camera.
        breadth: how evenly the picture's parts support motion: the sum of each part's evidence [nats] divided by the
            root of the sum of squares; 4 if all sixteen agree, negative if they oppose it.
        against: share of the parts' evidence that opposes motion.
        in_favour: share of the segments that fit better with motion.
        pose, pose_at_rest: best camera for the best motion, and for no motion.
    """

    motion: np.ndarray
    covariance: np.ndarray
    optima: Optima
    kinds: dict[str, float]
    evidence_of: dict[str, float]
    evidence: float
    lines_gain: float
    weight: float
    gain_at_rest: float
    breadth: float
    against: float
    in_favour: float
    pose: Pose
    pose_at_rest: Pose

    @property
    def expected_error(self) -> float:
        """Root mean square distance [rows] between the mean's picture and the true one, over a square picture."""
        return expected_error(self.covariance)

    @property
    def size(self) -> float:
        """Root mean square displacement [rows] of a square picture by the motion."""
        return displacement(self.motion)


def mixture_moments(share: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean [6] and covariance [6, 6] of a Gaussian mixture: shares [K], means [K, 6], covariances [K, 6, 6]."""
    mean = share @ means
    apart = means - mean
    return mean, np.einsum("k,kij->ij", share, covariances + apart[:, :, None] * apart[:, None, :])


def displacement(motion: np.ndarray) -> float:
    """Returns the root mean square displacement [rows] of a square picture by a motion [6], to first order."""
    return math.sqrt(max(float(motion @ _SQUARED_DISPLACEMENT @ motion), 0.0))


def expected_error(covariance: np.ndarray) -> float:
    """Returns the root mean square displacement [rows] of a square picture by motions [6] of this covariance."""
    return math.sqrt(max(float(np.sum(_SQUARED_DISPLACEMENT * covariance)), 0.0))


def bend(motion: np.ndarray) -> float:
    """Returns the RMS displacement of a motion [6] after removing its best shear, which resembles a tilted camera."""
    motion = motion.copy()
    motion[0] -= _SQUARED_DISPLACEMENT[0] @ motion / _SQUARED_DISPLACEMENT[0, 0]
    return displacement(motion)


def _squared_displacement() -> np.ndarray:
    """D [6, 6]: motion @ D @ motion is the mean squared displacement [rows^2] of a square picture."""
    row = np.linspace(-0.5, 0.5, 65)
    powers = (row[:, None] + 0.5) ** np.arange(1, 4)
    J_col = np.concatenate([powers, -row[:, None] * powers], axis=1)  # t_x - row r_z
    J_row = np.concatenate([0 * powers, powers / math.sqrt(12)], axis=1)  # col r_z; mean squared column: 1 / 12
    return (J_col.T @ J_col + J_row.T @ J_row) / len(row)


_SQUARED_DISPLACEMENT = _squared_displacement()
