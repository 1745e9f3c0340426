"""The posterior of the row motion, and how far motions displace a picture.

Coefficients of motions are those of beliefs.py: of u, u^2, u^3 in t_x [rows] and in r_z [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

PX = 256.0  # rows of the picture in which displacements are stated and calibrated


@dataclass(frozen=True)
class Pose:
    """How a camera was held.

    Attributes:
        roll: clockwise turn of the scene [rad].
        tilt: look upwards [rad].
        log_focal: logarithm of its focal length by the expected one.
    """

    roll: float
    tilt: float
    log_focal: float


@dataclass(frozen=True, eq=False)
class Optima:
    """The motions about which the posterior has bumps.

    Attributes:
        motions: [K, 6] coefficients.
        covariances: [K, 6, 6] of each bump.
        kind: [K] index of the kind of motion.
        share: [K] of the probability, if the camera moved.
    """

    motions: np.ndarray
    covariances: np.ndarray
    kind: np.ndarray
    share: np.ndarray


@dataclass(frozen=True)
class Posterior:
    """What the segments and the priors say about the motion, and whether there was one.

    Attributes:
        motion: [6] coefficients of u, u^2, u^3 of t_x [rows] and r_z [rad]: the mean, if the camera moved.
        covariance: [6, 6] of them.
        optima: of all kinds of motion.
        kinds: name of each kind of motion -> its share of the probability, if the camera moved.
        evidence_of: name of each kind -> the evidence for it against a camera that stood still, both as likely
            beforehand [nats].
        evidence: the same for any motion. It is overstated, see odds.py.
        lines_gain: log-likelihood ratio of the segments at the best optimum against chance [nats per unit of weight].
        weight: of all segments together: how many tell something new.
        gain_at_rest: as lines_gain, of no motion with the camera that suits it best.
        breadth: how evenly the picture's parts speak for motion: the sum of what each says [nats] by the root of the
            sum of squares; 4 where all sixteen say the same, negative where they speak against it.
        against: share of what the parts say that speaks against motion.
        in_favour: share of the segments that fit better with motion.
        pose, pose_at_rest: of the camera that suits the best motion, and none.
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
        """Root mean square displacement [rows] that the motion does to a square picture."""
        return displacement(self.motion)


def mixture_moments(share: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean [6] and covariance [6, 6] of a mixture of Gaussians: shares [K], means [K, 6], covariances [K, 6, 6]."""
    mean = share @ means
    apart = means - mean
    return mean, np.einsum("k,kij->ij", share, covariances + apart[:, :, None] * apart[:, None, :])


def displacement(motion: np.ndarray) -> float:
    """Root mean square displacement [rows] that a motion [6] does to a square picture, to first order."""
    return math.sqrt(max(float(motion @ _SQUARED_DISPLACEMENT @ motion), 0.0))


def expected_error(covariance: np.ndarray) -> float:
    """Root mean square displacement [rows] that motions [6] of this covariance do to a square picture."""
    return math.sqrt(max(float(np.sum(_SQUARED_DISPLACEMENT * covariance)), 0.0))


def bend(motion: np.ndarray) -> float:
    """RMS displacement of what remains of a motion [6] without its best shear, which looks like a camera held askew."""
    motion = motion.copy()
    motion[0] -= _SQUARED_DISPLACEMENT[0] @ motion / _SQUARED_DISPLACEMENT[0, 0]
    return displacement(motion)


def _squared_displacement() -> np.ndarray:
    """D [6, 6]: motion @ D @ motion is the mean squared displacement [rows^2] that it does to a square picture."""
    row = np.linspace(-0.5, 0.5, 65)
    powers = (row[:, None] + 0.5) ** np.arange(1, 4)
    J_col = np.concatenate([powers, -row[:, None] * powers], axis=1)  # t_x - row r_z
    J_row = np.concatenate([0 * powers, powers / math.sqrt(12)], axis=1)  # col r_z; mean squared column: 1 / 12
    return (J_col.T @ J_col + J_row.T @ J_row) / len(row)


_SQUARED_DISPLACEMENT = _squared_displacement()
