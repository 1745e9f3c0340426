"""How well a row motion and a camera explain the line segments of a scene full of right angles.

A scene whose edges run along three orthogonal directions (Coughlan and Yuille's Manhattan world), seen by a camera
with square pixels: rectified by the right motion, every segment points to one of three vanishing points, or obeys
nothing. Shear turns verticals only, a camera held askew turns everything: that is how this likelihood tells them apart.

Units as in segments.py: centred coordinates in rows, angles in radians. Unknowns are rows of an array [S, 10] (S
guesses are worked on at once): coefficients of u, u^2, u^3 of t_x [rows] and of r_z [rad], with u = row coordinate
+ 1/2; the camera's roll and tilt [rad]; the logarithm of its focal length [rows]; its yaw against the streets [rad].
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

UNKNOWNS = 10
MOTION, ROLL, TILT, LOG_FOCAL, YAW = slice(0, 6), 6, 7, 8, 9
_DEGREES = np.arange(1, 4)
_DEGREE = math.pi / 180


@dataclass(frozen=True)
class Beliefs:
    """What is expected of photos before one is seen; found on photos set aside for that (docs/own-model.md).

    Angles in radians, lengths in px of the picture in which segments were found.
    """

    exact: float = 0.002  # spread of the directions of well-built edges, on top of the detector's
    sloppy: float = 0.02  # and of the others, which are
    sloppy_share: float = 0.5
    end_px: float = 0.3  # detector noise: this over the length
    outliers: float = 0.3  # share of segments that point anywhere
    verticals: float = 0.34  # share of verticals among the others
    full_weight_px: float = 64.0  # shorter segments count less, in proportion
    independent: float = 0.4  # share of segments that tell something new: windows repeat each other's errors
    roll: float = 0.8 * _DEGREE
    askew: float = 4 * _DEGREE  # roll of the cameras that were not held with care,
    askew_share: float = 0.1  # and how many they are
    tilt: float = 9 * _DEGREE
    steep: float = 25 * _DEGREE  # tilt of the cameras that look up at towers or down from them,
    steep_share: float = 0.15  # and how many they are
    focal_rows: float = 1.7  # median focal length of a picture as high as wide
    focal_spread: float = 0.35  # of its logarithm
    attitude: float = 0.5 * _DEGREE  # error of a known roll or tilt (accelerometer, gimbal)
    tx: tuple[float, float, float] = (0.06, 0.08, 0.01)  # of the coefficients of t_x
    rz: tuple[float, float, float] = (0.07, 0.06, 0.01)  # and r_z


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


class ManhattanLikelihood:
    """Energy (minus the logarithm of the posterior) of motions and cameras, and its derivatives.

    Args:
        segments: [N, 4] end points, centred, in rows (segments.py).
        rows: of the picture in which they were found.
        aspect: its width / height.
        beliefs: priors and noise.
        up: unit vector (right, down) to the scene's top.
        log_focal: logarithm of the focal length [rows] if it is known (EXIF).
        roll, tilt: of the camera [rad] where they are known (gimbal, accelerometer).
        opinion: another estimate to be weighed in.
    """

    def __init__(
        self,
        segments: np.ndarray,
        rows: int,
        aspect: float = 1.0,
        beliefs: Beliefs | None = None,
        up: tuple[int, int] = (0, -1),
        log_focal: float | None = None,
        opinion: SecondOpinion | None = None,
        roll: float | None = None,
        tilt: float | None = None,
    ):
        self.beliefs = b = beliefs or Beliefs()
        self.opinion = opinion
        self._ends = [(p[:, 0], p[:, 1], (p[:, 1:] + 0.5) ** _DEGREES) for p in (segments[:, :2], segments[:, 2:])]
        length_px = np.hypot(*(segments[:, 2:] - segments[:, :2]).T) * rows
        self.weight = np.minimum(length_px / b.full_weight_px, 1) * b.independent  # [N]
        spread = b.exact + b.end_px / length_px
        spreads = np.stack([spread, np.hypot(spread, b.sloppy)])
        self._precision = 1 / spreads**2  # [2, N]
        shares = np.array([[1 - b.sloppy_share], [b.sloppy_share]]) * (1 - b.outliers)
        classes = np.array([[b.verticals], [(1 - b.verticals) / 2], [(1 - b.verticals) / 2]])
        self._height = (shares / (spreads * math.sqrt(2 * math.pi)))[:, None] * classes  # [2, 3, N]
        self._turn = math.atan2(up[0], -up[1])
        middle, focal_spread = (math.log(b.focal_rows * (1 + aspect) / 2), b.focal_spread)
        if log_focal is not None:
            middle, focal_spread = log_focal, 0.05
        self.expected = np.array([*[0.0] * 6, roll or 0.0, tilt or 0.0, middle, 0.0])
        self.knows_tilt = tilt is not None
        self._attitude = (
            _known(ROLL, b.attitude) if roll is not None else (ROLL, b.roll, b.askew, b.askew_share),
            _known(TILT, b.attitude) if tilt is not None else (TILT, b.tilt, b.steep, b.steep_share),
        )
        self.scales = np.array([*b.tx, *b.rz, b.roll, b.tilt, focal_spread, 1e3])

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, 10] -> [S]."""
        view = self._view(unknowns)
        return self._lines(view)[0] + self._prior(unknowns)[0]

    def expanded(self, unknowns: np.ndarray, camera_only: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10].

        Args:
            unknowns: [S, 10].
            camera_only: leave out what the segments say about the motion; a third faster.
        """
        view = self._view(unknowns)
        energy, pull = self._lines(view)
        jacobian = self._jacobian(view, camera_only).reshape(len(unknowns), UNKNOWNS, -1)  # [S, 10, 3 * N]
        weighted = jacobian * pull.reshape(len(unknowns), 1, -1)
        gradient = (weighted @ view.sine.reshape(len(unknowns), -1, 1))[..., 0]
        prior, prior_gradient, prior_hessian = self._prior(unknowns)
        return energy + prior, gradient + prior_gradient, weighted @ jacobian.transpose(0, 2, 1) + prior_hessian

    def lines_gain(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, 10] -> [S]: how much better than chance the segments fit, nats per unit of weight."""
        by_chance = self.weight.sum() * math.log(math.pi)
        return (by_chance - self._lines(self._view(unknowns))[0]) / max(self.weight.sum(), 1e-9)

    def _view(self, unknowns: np.ndarray) -> _View:
        return _View(self._ends, unknowns, self._turn)

    def _lines(self, view: _View) -> tuple[np.ndarray, np.ndarray]:
        """Energy of the segments [S], and how strongly each is drawn to each vanishing point [S, 3, N]."""
        square = view.sine**2 * -0.5
        likely = pull = 0.0
        for precision, height in zip(self._precision, self._height, strict=True):
            part = np.exp(square * precision) * height
            likely, pull = likely + part, pull + part * precision
        total = np.sum(likely, 1) + self.beliefs.outliers / math.pi
        return -(self.weight * np.log(total)).sum(-1), pull * (self.weight / total)[:, None]

    def _jacobian(self, view: _View, camera_only: bool) -> np.ndarray:
        """[S, 10, 3, N] derivatives of the sines."""
        jacobian = np.zeros((len(view.sine), UNKNOWNS, *view.sine.shape[1:]))
        powers = [power.T for *_, power in self._ends]  # [3, N] at each end
        for first, turning in () if camera_only else ((0, False), (3, True)):
            moving = [by_end * view.cosine for by_end in view.by_end_points(turning)]
            for k in range(3):
                np.add(moving[0] * powers[0][k], moving[1] * powers[1][k], out=jacobian[:, first + k])
        derivatives = {ROLL: view.by_roll, TILT: view.by_tilt, LOG_FOCAL: view.by_log_focal, YAW: view.by_yaw}
        for k, derivative in derivatives.items():
            np.multiply(view.by_directions(derivative), view.cosine, out=jacobian[:, k])
        return jacobian

    def _prior(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, gradient and Hessian of the prior, with its normalisation: guesses of all kinds compare."""
        off = (unknowns - self.expected) / self.scales
        precision = np.broadcast_to(1 / self.scales**2, unknowns.shape).copy()
        energy = np.zeros(len(unknowns))
        for k, usual, rare, share in self._attitude:
            likely = [
                math.log(part / spread) - 0.5 * ((unknowns[:, k] - self.expected[k]) / spread) ** 2
                for part, spread in ((1 - share, usual), (share, rare))
            ]
            both = np.logaddexp(*likely)
            is_usual = np.exp(likely[0] - both)
            precision[:, k] = is_usual / usual**2 + (1 - is_usual) / rare**2
            off[:, k] = 0
            energy -= both
        energy += 0.5 * (off**2).sum(-1)
        gradient = precision * (unknowns - self.expected)
        hessian = precision[:, :, None] * np.eye(UNKNOWNS)
        if self.opinion is not None:
            o = self.opinion
            apart = unknowns[:, MOTION] - o.motion
            pulled = apart @ o.precision
            distance = (pulled * apart).sum(-1)
            energy = energy + 0.5 * (o.freedom + 6) * np.log1p(distance / o.freedom)
            trust = (o.freedom + 6) / (o.freedom + distance)
            gradient[:, MOTION] += trust[:, None] * pulled
            hessian[:, MOTION, MOTION] += trust[:, None, None] * o.precision
        return energy, gradient, hessian


def _known(unknown: int, spread: float) -> tuple[int, float, float, float]:
    """The prior of an angle that something has measured: both of its parts are the same."""
    return unknown, spread, spread, 0.5


class _View:
    """Segments rectified by S motions, and the directions in which S cameras expect them: shapes [S, 3, N]."""

    def __init__(self, ends: list[tuple[np.ndarray, np.ndarray, np.ndarray]], unknowns: np.ndarray, turn: float):
        motions = unknowns[:, MOTION]
        if (motions == motions[0]).all():  # of many cameras: the segments move but once
            motions = motions[:1]
        tx, rz = motions[:, 0:3], motions[:, 3:6]
        self.moved = [_rectified(*end, tx, rz) for end in ends]
        (x1, y1, *_), (x2, y2, *_) = self.moved
        self.col, self.row = ((a + b)[:, None] / 2 for a, b in ((x1, x2), (y1, y2)))
        self.dx, self.dy = x2 - x1, y2 - y1
        self.length2 = self.dx**2 + self.dy**2 + 1e-18
        self.focal = np.exp(unknowns[:, LOG_FOCAL, None])
        self._point(unknowns, turn)
        x, y, z = self.vanishing
        self.to_x, self.to_y = x - self.col * z, y - self.row * z  # from the middles to the vanishing points
        self.to2 = self.to_x**2 + self.to_y**2 + 1e-12
        dx, dy = self.dx[:, None], self.dy[:, None]
        size = np.sqrt(self.to2 * self.length2[:, None])
        self.sine = (dx * self.to_y - dy * self.to_x) / size
        self.cosine = (dx * self.to_x + dy * self.to_y) / size

    def _point(self, unknowns: np.ndarray, turn: float) -> None:
        """Vanishing points of the vertical and both horizontals, homogeneous, and their derivatives."""
        roll, tilt, yaw = unknowns[:, ROLL] + turn, unknowns[:, TILT], unknowns[:, YAW]
        none, one = np.zeros_like(yaw), np.ones_like(yaw)
        cos, sin = np.cos(yaw), np.sin(yaw)
        flat = _in_camera([none, cos, -sin], [one, none, none], [none, sin, cos], roll, tilt)
        self.vanishing = self._projected(flat)
        self.by_roll = self._projected((-flat[1], flat[0], none[:, None]))
        ahead = _in_camera([none, -sin, -cos], [none, none, none], [none, cos, -sin], roll, tilt)
        self.by_yaw = self._projected(ahead)
        # tilt turns about the camera's x axis before the roll: exchange y and z there
        level = np.cos(roll)[:, None], np.sin(roll)[:, None]
        y = -flat[0] * level[1] + flat[1] * level[0]
        self.by_tilt = self._projected((-level[1] * flat[2], level[0] * flat[2], -y))
        x, y, z = self.vanishing
        self.by_log_focal = (x, y, 0 * z)

    def _projected(self, directions: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        x, y, z = directions
        return (self.focal * x)[..., None], (self.focal * y)[..., None], np.broadcast_to(z, x.shape)[..., None]

    def by_directions(self, derivative: tuple[np.ndarray, ...]) -> np.ndarray:
        """Change of the expected angle with the vanishing points."""
        x, y, z = derivative
        return (self.to_x * (y - self.row * z) - self.to_y * (x - self.col * z)) / self.to2

    def by_end_points(self, turning: bool) -> Iterator[np.ndarray]:
        """Change of the expected minus the seen angle with t_x, or r_z (``turning``), at the one and the other end."""
        pulled = self.vanishing[2] / (2 * self.to2)  # the middle moves half as far as an end
        pulled_x, pulled_y = self.to_y * pulled, self.to_x * pulled
        for (x, y, cos, sin), side in zip(self.moved, (-1, 1), strict=True):
            step_x, step_y = (y, -x) if turning else (-cos, sin)
            seen = side * (self.dx * step_y - self.dy * step_x) / self.length2
            yield pulled_x * step_x[:, None] - pulled_y * step_y[:, None] - seen[:, None]


def _rectified(
    col: np.ndarray, row: np.ndarray, powers: np.ndarray, tx: np.ndarray, rz: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """End points [N] moved by S motions: columns and rows [S, N], and cosine and sine of r_z."""
    turned = rz @ powers.T
    cos, sin = np.cos(turned), np.sin(turned)
    x = col - tx @ powers.T
    return x * cos + row * sin, row * cos - x * sin, cos, sin


def _in_camera(x: list, y: list, z: list, roll: np.ndarray, tilt: np.ndarray) -> tuple[np.ndarray, ...]:
    """World directions (right, down, ahead), each a list of K arrays [S], seen by the cameras: [S, K] each."""
    right, down, ahead = (np.stack(a, -1) for a in (x, y, z))
    cos, sin = np.cos(tilt)[:, None], np.sin(tilt)[:, None]
    down, ahead = cos * down + sin * ahead, cos * ahead - sin * down
    cos, sin = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return cos * right - sin * down, sin * right + cos * down, ahead
