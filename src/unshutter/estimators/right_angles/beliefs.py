"""The unknowns of a photo, and what is assumed of them beforehand: of photos, of this camera, of the motion.

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
NORMAL = 1e9  # degrees of freedom at which Student's t distribution is a normal one


@dataclass(frozen=True)
class Beliefs:
    """What is expected of photos in general; found on photos set aside for that (docs/research/own-model.md).

    Sigmas are standard deviations. Angles in radians, lengths in px of the picture in which segments were found.
    """

    sigma_exact: float = 0.002  # of the directions of well-built edges, on top of the detector's
    sigma_sloppy: float = 0.02  # and of the others, which are
    sloppy_share: float = 0.5
    sigma_end_px: float = 0.3  # detector noise: this over the length
    outlier_share: float = 0.3  # segments that point anywhere
    vertical_share: float = 0.34  # verticals among the others
    full_weight_px: float = 64.0  # shorter segments count less, in proportion
    independent_share: float = 0.4  # segments that tell something new: windows repeat each other's errors
    sigma_roll: float = 0.8 * _DEGREE
    sigma_askew: float = 4 * _DEGREE  # roll of the cameras that were not held with care,
    askew_share: float = 0.1  # and how many they are
    sigma_tilt: float = 9 * _DEGREE
    sigma_steep: float = 25 * _DEGREE  # tilt of the cameras that look up at towers or down from them,
    steep_share: float = 0.15  # and how many they are
    median_focal_rows: float = 1.7  # of a picture as high as wide
    sigma_log_focal: float = 0.35
    sigma_known_log_focal: float = 0.05  # where EXIF or the user says it
    sigma_known_attitude: float = 1.0 * _DEGREE  # of a known roll or tilt: hands shake an accelerometer by so much


@dataclass(frozen=True, eq=False)
class MotionKind:
    """How likely the motions of one kind are beforehand: Student's t distribution about no motion.

    Attributes:
        name: quadratic (drawn as benchmarks draw them), hand (shake) or pan (an even turn to one side).
        scale: [6, 6] scale matrix of the coefficients of t_x and r_z.
        freedom: degrees of freedom; NORMAL for a normal distribution.
        share: of all motions, how many are of this kind.
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
        """Logarithm of the density at no motion, by that of a normal distribution of the same scale."""
        nu, n = self.freedom, len(self.scale)
        return math.lgamma((nu + n) / 2) - math.lgamma(nu / 2) - n / 2 * math.log(nu / 2)


@dataclass(frozen=True)
class KnownCamera:
    """What is known of the camera that took this photo.

    Attributes:
        up: unit vector (right, down) to the scene's top.
        log_focal: logarithm of the focal length [rows] (EXIF, the user); None: unknown.
        roll, tilt: how the scene is turned in the picture, clockwise, and how far the camera looked up [rad] (gimbal,
            accelerometer); None: unknown.
        speed: how fast it can have moved, by the photo's sharpness; None: unknown.
    """

    up: tuple[int, int] = (0, -1)
    log_focal: float | None = None
    roll: float | None = None
    tilt: float | None = None
    speed: KnownSpeed | None = None


@dataclass(frozen=True)
class KnownSpeed:
    """How fast the camera can have moved.

    Attributes:
        tx: [bands] the most that t_x can change over a whole readout at the speed of each band of rows [rows].
        rz: the same of r_z, for all bands [rad].
    """

    tx: np.ndarray
    rz: float

    @property
    def precision(self) -> np.ndarray:
        """[6, 6] of Gaussians about no speed in the middle of each band, in the coefficients of t_x and r_z."""
        u = (np.arange(len(self.tx)) + 0.5) / len(self.tx)
        J_speed = np.stack([np.ones_like(u), 2 * u, 3 * u**2], axis=1)  # of one coefficient each
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
