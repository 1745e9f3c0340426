"""The unknowns of a photo and the priors on them: for photos in general, for this camera, and for the motion.

Hypotheses are rows of an array [S, 10]: coefficients of u, u^2, u^3 of t_x [rows] and of r_z [rad], with u = row
coordinate + 1/2; the camera's roll and tilt [rad]; the logarithm of its focal length [rows]; its yaw against the
streets [rad]. Coordinates are centred, in rows (segments.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

UNKNOWNS = 10
MOTION, ROLL, TILT, LOG_FOCAL, YAW = slice(0, 6), 6, 7, 8, 9
CAMERA = slice(MOTION.stop, UNKNOWNS)

_DEGREE = math.pi / 180
NORMAL = 1e9  # degrees of freedom at which Student's t distribution is practically normal


@dataclass(frozen=True)
class Beliefs:
    """Priors and noise for photos in general, measured on a separate set of photos (docs/research/own-model.md).

    Sigmas are standard deviations. Angles are in radians, lengths in px of the picture in which segments were detected.
    """

    sigma_exact: float = 0.002  # of the directions of accurate edges, in addition to the detector's
    sigma_sloppy: float = 0.02  # of the directions of inaccurate edges,
    sloppy_share: float = 0.5  # and their share
    sigma_end_px: float = 0.3  # detector noise: this divided by the length
    outlier_share: float = 0.3  # outliers: segments of arbitrary direction
    vertical_share: float = 0.34  # verticals among the inliers
    full_weight_px: float = 64.0  # shorter segments have proportionally less weight
    independent_share: float = 0.4  # independent information: the errors of similar windows are correlated
    sigma_roll: float = 0.8 * _DEGREE
    sigma_askew: float = 4 * _DEGREE  # roll of cameras that were held carelessly,
    askew_share: float = 0.1  # and their share
    sigma_tilt: float = 9 * _DEGREE
    sigma_steep: float = 25 * _DEGREE  # tilt of cameras that look up at towers or down from them,
    steep_share: float = 0.15  # and their share
    median_focal_rows: float = 1.7  # of a square picture
    sigma_log_focal: float = 0.35
    sigma_known_log_focal: float = 0.05  # if known from EXIF or the user
    sigma_known_attitude: float = 1.0 * _DEGREE  # of a known roll or tilt: error of an accelerometer in the hand


@dataclass(frozen=True, eq=False)
class MotionKind:
    """Prior of the motions of one kind: a Student's t distribution centred on no motion.

    Attributes:
        name: quadratic (as drawn in benchmarks), hand (shake) or pan (an even rotation to one side).
        scale: [6, 6] scale matrix of the coefficients of t_x and r_z.
        freedom: degrees of freedom; NORMAL for a normal distribution.
        share: prior probability of this kind.
    """

    name: str
    scale: np.ndarray
    freedom: float
    share: float

    @property
    def precision(self) -> np.ndarray:
        """[6, 6] inverse of the scale matrix."""
        return np.linalg.inv(self.scale)

    @property
    def log_peak(self) -> float:
        """Log density at no motion, relative to that of a normal distribution with the same scale."""
        nu, n = self.freedom, len(self.scale)
        return math.lgamma((nu + n) / 2) - math.lgamma(nu / 2) - n / 2 * math.log(nu / 2)


@dataclass(frozen=True)
class KnownCamera:
    """What is known about the camera that took this photo.

    Attributes:
        up: unit vector (right, down) towards the top of the scene.
        log_focal: logarithm of the focal length [rows] (from EXIF or the user); None if unknown.
        roll, tilt: clockwise rotation of the scene in the picture, and upward tilt of the camera [rad] (from gimbal or
            accelerometer); None if unknown.
        speed: limit on the camera's speed from the photo's sharpness; None if unknown.
    """

    up: tuple[int, int] = (0, -1)
    log_focal: float | None = None
    roll: float | None = None
    tilt: float | None = None
    speed: KnownSpeed | None = None


@dataclass(frozen=True)
class KnownSpeed:
    """A limit on the camera's speed.

    Attributes:
        tx: [bands] largest change of t_x over a whole readout at the speed of each band of rows [rows].
        rz: largest change of r_z over a whole readout, for all bands [rad].
    """

    tx: np.ndarray
    rz: float

    @property
    def precision(self) -> np.ndarray:
        """[6, 6] of Gaussians around zero speed at the centre of each band, in the coefficients of t_x and r_z."""
        u = (np.arange(len(self.tx)) + 0.5) / len(self.tx)
        J_speed = np.stack([np.ones_like(u), 2 * u, 3 * u**2], axis=1)  # derivatives by the coefficients
        precision = np.zeros((6, 6))
        precision[:3, :3] = J_speed.T @ (J_speed / self.tx[:, None] ** 2)
        precision[3:, 3:] = J_speed.T @ J_speed / self.rz**2
        return precision


@dataclass(frozen=True)
class SecondOpinion:
    """Another estimate of the motion, with heavy-tailed errors (Student's t).

    Attributes:
        motion: [6] coefficients.
        precision: [6, 6] inverse of the scale matrix of its errors.
        freedom: degrees of freedom; the fewer, the more readily it is overruled.
    """

    motion: np.ndarray
    precision: np.ndarray
    freedom: float = 3.0
