"""The unknowns of a photo, the priors on them, and the calibration that all photos share.

Hypotheses are rows of an array [S, 10]: coefficients of u, u^2, u^3 of t_x [rows] and of r_z [rad], with u = row
coordinate + 1/2; the camera's roll and tilt [rad]; the logarithm of its focal length [rows]; its yaw against the
streets [rad]. Coordinates are centred, in rows.

unshutter-lab measures the network's errors, the odds of motion and the accuracy of answers,
and writes weights/calibration.json, which names its data.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from unshutter.reasons import JsonObject

UNKNOWNS = 10
MOTION = slice(0, 6)
ROLL = 6
TILT = 7
LOG_FOCAL = 8
YAW = 9
CAMERA = slice(MOTION.stop, UNKNOWNS)

_DEGREE = math.pi / 180
NORMAL = 1e9  # degrees of freedom at which Student's t distribution is practically normal


@dataclass(frozen=True)
class PriorParams:
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
    sigma_askew: float = 4 * _DEGREE  # roll of cameras that were held carelessly
    askew_share: float = 0.1  # share of cameras that were held carelessly
    sigma_tilt: float = 9 * _DEGREE
    sigma_steep: float = 25 * _DEGREE  # tilt of cameras that look up at towers or down from them
    steep_share: float = 0.15  # share of cameras that do so
    median_focal_rows: float = 1.7  # of a square picture
    sigma_log_focal: float = 0.35
    sigma_known_log_focal: float = 0.05  # if known from EXIF or the user
    sigma_known_attitude: float = 1.0 * _DEGREE  # of a known roll or tilt: error of an accelerometer in the hand


@dataclass(frozen=True, eq=False)
class MotionKind:
    """Prior of the motions of one kind: a Student's t distribution centred on no motion."""

    name: str  # quadratic (as drawn in benchmarks), hand (shake) or pan (an even rotation to one side)
    scale: np.ndarray  # [6, 6] scale matrix of the coefficients of t_x and r_z
    freedom: float  # degrees of freedom; NORMAL for a normal distribution
    share: float  # prior probability of this kind

    @property
    def precision(self) -> np.ndarray:
        """[6, 6] inverse of the scale matrix."""
        return np.linalg.inv(self.scale)

    @property
    def log_peak(self) -> float:
        """Log density at no motion, relative to that of a normal distribution with the same scale."""
        nu = self.freedom
        n = len(self.scale)
        return math.lgamma((nu + n) / 2) - math.lgamma(nu / 2) - n / 2 * math.log(nu / 2)


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """Known properties of the camera that took a photo."""

    up: tuple[int, int] = (0, -1)  # unit vector (right, down) towards the top of the scene
    log_focal: float | None = None  # logarithm of the focal length [rows], from EXIF or the user; None if unknown
    roll: float | None = None  # clockwise rotation of the scene in the picture [rad]; None if unknown
    tilt: float | None = None  # upward tilt of the camera [rad]; None if unknown
    speed: np.ndarray | None = None  # [6, 6] precision of the motion from the photo's sharpness; None if unknown


@dataclass(frozen=True)
class NetworkObservation:
    """Another estimate of the motion, with heavy-tailed errors (Student's t)."""

    motion: np.ndarray  # [6] coefficients
    precision: np.ndarray  # [6, 6] inverse of the scale matrix of its errors
    freedom: float = 3.0  # degrees of freedom; the fewer, the more readily it is overruled


_SHIPPED = Path(__file__).parents[1] / "weights" / "calibration.json"


@dataclass(frozen=True)
class NetworkErrors:
    """Errors of the network's six coefficients (t_x [rows], then r_z [rad]): Student's t distribution."""

    freedom: float  # degrees of freedom; the fewer, the more often errors are large
    scales: np.ndarray  # [6] scales of the distribution
    correlations: np.ndarray  # [6, 6] between the coefficients
    usual_px: float  # size of the estimate [px of 256 rows] at which squared errors are twice those of small estimates

    @classmethod
    def of(cls, fields: JsonObject) -> NetworkErrors:
        """Reads the errors from the fields of a file."""
        scales = np.array(fields["scales"])
        correlations = np.array(fields["correlations"])
        return cls(fields["freedom"], scales, correlations, fields["usual_px"])

    def precision(self, size_px: float) -> np.ndarray:
        """[6, 6] inverse of the scale matrix.

        Args:
            size_px: root mean square displacement of the network's estimate [px of 256 rows].
        """
        scale = self.correlations * np.outer(self.scales, self.scales)
        return np.linalg.inv(scale) / (1 + (size_px / self.usual_px) ** 2)


@dataclass(frozen=True)
class Forest:
    """Gradient-boosted decision trees of equal size. The values of their leaves add up to the result."""

    features: tuple[str, ...]  # names of the figures tested by nodes
    baseline: float  # constant to which the leaves' values are added
    depth: int  # steps from a root to its farthest leaf
    feature: np.ndarray  # [trees, nodes] index of a node's figure in ``features``; -1: the node is a leaf
    right: np.ndarray  # [trees, nodes] where a node leads if its figure is above its number; otherwise to the next node
    number: np.ndarray  # [trees, nodes] number with which a node compares its figure; a leaf's value

    def of(self, figures: dict[str, float]) -> float:
        """Returns the result for the figures of a photo."""
        asked = np.array([figures[name] for name in self.features])
        tree = np.arange(len(self.feature))
        node = np.zeros(len(self.feature), int)
        for _ in range(self.depth):
            feature = self.feature[tree, node]
            further = np.where(asked[feature] <= self.number[tree, node], node + 1, self.right[tree, node])
            node = np.where(feature < 0, node, further)
        return self.baseline + float(self.number[tree, node].sum())

    @classmethod
    def read(cls, fields: JsonObject) -> Forest:
        """Reads the forest from the fields of a file."""
        arrays = {name: np.array(fields[name]) for name in ("feature", "right", "number")}
        return cls(tuple(fields["features"]), fields["baseline"], fields["depth"], **arrays)


@dataclass(frozen=True)
class BenefitCalibration:
    """What became of photos whose motions were undone (prospects.py)."""

    better: Forest  # log odds that the result is closer to the truth than the photo, if half of all photos moved
    error: Forest  # log of the error that remains if it is [px of 256 rows]
    moved: tuple[float, float]  # slope and constant of the log odds that the camera moved, by those of ``better``

    @classmethod
    def read(cls, fields: JsonObject) -> BenefitCalibration:
        """Reads the forests from the fields of a file."""
        slope, constant = fields["moved"]
        return cls(Forest.read(fields["better"]), Forest.read(fields["error"]), (slope, constant))


@dataclass(frozen=True)
class Calibration:
    """All parts of the default method other than its network."""

    kinds: tuple[MotionKind, ...]  # kinds of motion and their priors
    network_errors: NetworkErrors  # error distribution of the network's estimate
    with_network: BenefitCalibration  # with the search that includes the network's estimate
    without_network: BenefitCalibration  # with the search that does not

    @classmethod
    def read(cls, path: Path) -> Calibration:
        """Reads a calibration file written by unshutter-lab."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            kinds_of(fields["kinds"]),
            NetworkErrors.of(fields["network_errors"]),
            BenefitCalibration.read(fields["with_network"]),
            BenefitCalibration.read(fields["without_network"]),
        )


def kinds_of(fields: JsonObject) -> tuple[MotionKind, ...]:
    """Reads the kinds of motion from the fields of a file."""
    return tuple(
        MotionKind(
            name,
            np.array(each["correlations"]) * np.outer(each["scales"], each["scales"]),
            each["freedom"] or NORMAL,
            each["share"],
        )
        for name, each in fields.items()
    )


@cache
def shipped() -> Calibration:
    """Returns the calibration that comes with unshutter."""
    return Calibration.read(_SHIPPED)


class Prior:
    """The prior of every kind of motion, each combined with the same prior of the camera.

    Student's t around no motion and around a second opinion; Gaussians for the camera, mixtures of two for roll and
    tilt.
    """

    def __init__(
        self,
        params: PriorParams,
        known: KnownCamera,
        aspect: float,
        observation: NetworkObservation | None = None,
        kinds: Sequence[MotionKind] = (),
    ):
        b = params
        log_focal = math.log(b.median_focal_rows * (1 + aspect) / 2)
        sigma_log_focal = b.sigma_log_focal
        if known.log_focal is not None:
            log_focal = known.log_focal
            sigma_log_focal = b.sigma_known_log_focal
        self.mean = np.array([*[0.0] * 6, known.roll or 0.0, known.tilt or 0.0, log_focal, 0.0])
        any_yaw = 1e3
        self.sigma = np.array([*[math.inf] * 6, b.sigma_roll, b.sigma_tilt, sigma_log_focal, any_yaw])
        # for roll and tilt: sigmas of the main and the rare component, share of the rare one
        measured = b.sigma_known_attitude, b.sigma_known_attitude, 0.5
        self._mixtures = {
            ROLL: measured if known.roll is not None else (b.sigma_roll, b.sigma_askew, b.askew_share),
            TILT: measured if known.tilt is not None else (b.sigma_tilt, b.sigma_steep, b.steep_share),
        }
        self._opinion = observation
        self._of_speed = np.zeros((6, 6)) if known.speed is None else known.speed
        self.kinds = tuple(kinds) or shipped().kinds
        self._precision = np.stack([kind.precision for kind in self.kinds])
        self._freedom = np.array([kind.freedom for kind in self.kinds])
        # of each kind; exact without a speed limit, or if it is much narrower than the kind
        volumes = [
            kind.precision * math.exp(2 * kind.log_peak / len(kind.scale)) + self._of_speed for kind in self.kinds
        ]
        self.log_volume = 0.5 * np.linalg.slogdet(np.stack(volumes))[1]

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the negative log prior [S], its gradient [S, 10], and a positive definite Hessian [S, 10, 10].

        The Hessian ignores how mixture weights and the trust in an opinion change with the unknowns. Normalised as far
        as it differs between the hypotheses of a photo, except for :attr:`log_volume`.

        Args:
            kind: [S] index of each motion's kind in :attr:`kinds`; the first by default.
        """
        kind = np.zeros(len(unknowns), int) if kind is None else kind
        off = unknowns - self.mean
        precision = np.broadcast_to(1 / self.sigma**2, unknowns.shape).copy()
        scaled = off / self.sigma
        energy = np.zeros(len(unknowns))
        for k, mixture in self._mixtures.items():
            scaled[:, k] = 0
            part, precision[:, k] = two_gaussians(off[:, k], *mixture)
            energy += part
        energy += 0.5 * (scaled**2).sum(-1)
        gradient = precision * off
        hessian = precision[:, :, None] * np.eye(UNKNOWNS)
        slowed = unknowns[:, MOTION] @ self._of_speed
        energy += 0.5 * (slowed * unknowns[:, MOTION]).sum(-1)
        gradient[:, MOTION] += slowed
        hessian[:, MOTION, MOTION] += self._of_speed
        pulls = [_student_t(unknowns[:, MOTION], self._precision[kind], self._freedom[kind])]
        if self._opinion is not None:
            off = unknowns[:, MOTION] - self._opinion.motion
            observation = self._opinion
            pulls.append(_student_t(off, observation.precision, observation.freedom))
        for part, J_motion, H_motion in pulls:
            energy = energy + part
            gradient[:, MOTION] += J_motion
            hessian[:, MOTION, MOTION] += H_motion
        return energy, gradient, hessian


def two_gaussians(off: np.ndarray, usual: float, rare: float, rare_share: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns E = -log sum_j share_j / sigma_j exp(-off^2 / 2 sigma_j^2) of off [...], and P in dE/doff = P off."""
    log_usual, log_rare = (
        math.log(share / sigma) - 0.5 * (off / sigma) ** 2
        for share, sigma in ((1 - rare_share, usual), (rare_share, rare))
    )
    log_both = np.logaddexp(log_usual, log_rare)
    is_usual = np.exp(log_usual - log_both)
    return -log_both, is_usual / usual**2 + (1 - is_usual) / rare**2


def _student_t(
    off: np.ndarray, precision: np.ndarray, freedom: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns E = (nu + 6) / 2 log(1 + off^T P off / nu) of off [S, 6], dE/doff = t P off, and t P.

    Here t = (nu + 6) / (nu + off^T P off) is the trust, P is [6, 6] or [S, 6, 6], nu a number or [S].
    """
    dimensions = off.shape[1]
    pulled = (precision @ off[..., None])[..., 0]
    distance2 = (pulled * off).sum(-1)
    trust = (freedom + dimensions) / (freedom + distance2)
    energy = 0.5 * (freedom + dimensions) * np.log1p(distance2 / freedom)
    return energy, trust[:, None] * pulled, trust[:, None, None] * precision
