"""Lines that a person draws along things in a photo, and the motion that they and the photo's segments show.

An upright line points to the vertical vanishing point, a level one to some horizontal direction of the scene, receding
or not, and a straight one has no direction but no bend either. They enter the Manhattan likelihood as sure evidence:
each counts in full and none may be an outlier, whereas a detected segment may point anywhere. People draw level lines
along what faces them more often than not, so that those tell how far the camera was turned; how far a receding one
slopes depends on things that one line does not show.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.base import View
from unshutter.estimators.right_angles.beliefs import (
    LOG_FOCAL,
    MOTION,
    NORMAL,
    ROLL,
    TILT,
    UNKNOWNS,
    YAW,
    MotionKind,
    SecondOpinion,
)
from unshutter.estimators.right_angles.calibration import shipped
from unshutter.estimators.right_angles.likelihood import ManhattanLikelihood
from unshutter.estimators.right_angles.residuals import AngleResiduals, EndPoints
from unshutter.estimators.right_angles.search import descend, displacement
from unshutter.estimators.right_angles.view import STARTS, known_camera, segments_of
from unshutter.estimators.segment_network import SegmentNetwork
from unshutter.estimators.segments import WIDEST_ASPECT
from unshutter.motion import Motion
from unshutter.reasons import Code, Reason

LineKind: TypeAlias = Literal["upright", "level", "straight"]

NAME = "drawn-lines"  # which motions carry as their estimator
FORMAT = "unshutter-lines/1"
MOST_LINES, MOST_POINTS = 100, 100
# Measured on photos set aside for that (val/), as docs/guide/by-hand.md shows.
_SIGMA_ANGLE = 0.0025  # of a drawn direction [rad],
_SIGMA_END = 0.001  # of its ends [rows],
_SIGMA_BEND = 0.002  # and of the points of a straight line [rows]
_FACING = 0.6  # share of level lines on something that faces the camera,
_SIGMA_FACING, _SIGMA_RECEDING = math.radians(1), math.radians(12)  # and how far they and others slope in the picture
_OTHER_STREET = 0.05  # share of level lines along neither of the two horizontal directions
_ROLLS, _TILTS = np.radians([-3, 0, 3]), np.radians([-8, 0, 8, 18, 32])  # of poses to start from
_LOG_FOCALS, _YAWS = np.array([-0.35, 0.25]), np.arange(9) * (math.pi / 2 / 9)
_POSES, _FIRST_STEPS, _FOLLOWED = 2, 10, 8  # for each motion and roll; steps of all; the best, which go on
_LEAST_LENGTH = 0.01  # of a piece of a line [rows]: shorter ones show no direction
_STEP = 1e-6  # of numerical derivatives
_PX = 256.0  # rows of the picture in which the calibration measures displacements
# beforehand, the motion may be of any kind: lines were drawn because they show it
_ANY_MOTION = MotionKind("any", np.diag([0.06, 0.08, 0.01, 0.07, 0.06, 0.01]) ** 2, NORMAL, 1.0)


@dataclass(frozen=True)
class DrawnLine:
    """A line that a person drew along something.

    Attributes:
        kind: ``upright``: vertical in the scene; ``level``: horizontal in the scene, receding or not; ``straight``:
            straight in the scene, whatever its direction.
        points: two or more (col, row) along it [px of the stored photo]; a straight line needs three.

    Raises:
        UsageError: another kind, too few or too many points, or a position that is not finite.
    """

    kind: LineKind
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if self.kind not in get_args(LineKind):
            raise UsageError(f"unknown kind of line '{self.kind!s:.40}': choose upright, level or straight")
        fewest = 3 if self.kind == "straight" else 2
        if not fewest <= len(self.points) <= MOST_POINTS:
            raise UsageError(f"a line that is {self.kind} needs {fewest} to {MOST_POINTS} points")
        if not all(math.isfinite(value) and abs(value) < 1e9 for point in self.points for value in point):
            raise UsageError("the points of a line are positions in the photo [px]")


def lines_from_json(text: str) -> tuple[DrawnLine, ...]:
    """Reads what :func:`lines_to_json` writes.

    Raises:
        UnshutterError: it is not of this form; UsageError: a line that cannot be.
    """
    try:
        data = json.loads(text)
        if data["format"] != FORMAT:
            raise ValueError
        return checked_lines([DrawnLine(each["kind"], _points(each["points"])) for each in data["lines"]])
    except (ValueError, TypeError, KeyError, RecursionError):
        line = '{"kind": "upright", "points": [[col, row], [col, row]]}'
        example = f'{{"format": "{FORMAT}", "lines": [{line}]}}'
        raise UnshutterError(f"not a file of drawn lines: it must be {example}") from None


def read_lines(path: Path) -> tuple[DrawnLine, ...]:
    """The lines in a file.

    Raises:
        UnshutterError: it cannot be read, or is not of the form that :func:`lines_to_json` writes.
    """
    try:
        return lines_from_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UnshutterError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is not text'}") from None


def lines_to_json(lines: Iterable[DrawnLine]) -> str:
    """Lines as a file of their own, format ``unshutter-lines/1``."""
    listed = [{"kind": line.kind, "points": [list(point) for point in line.points]} for line in lines]
    return json.dumps({"format": FORMAT, "lines": listed})


def checked_lines(lines: Sequence[DrawnLine]) -> tuple[DrawnLine, ...]:
    """The lines.

    Raises:
        UsageError: there are none, or too many.
    """
    if not 1 <= len(lines) <= MOST_LINES:
        raise UsageError(f"draw at least one line, and at most {MOST_LINES}")
    return tuple(lines)


def motion_from_lines(view: View, lines: Sequence[DrawnLine], network: SegmentNetwork | None = None) -> Motion:
    """The motion that drawn lines show, together with the photo's segments; first row as the reference.

    Its confidence is None: a person has decided.

    Args:
        view: the photo.
        lines: at least one.
        network: whose answer is weighed in, as by segment-manhattan; None: none is.

    Raises:
        UsageError: no lines.
    """
    lines = checked_lines(lines)
    if max(view.width / view.height, view.height / view.width) > WIDEST_ASPECT:
        return view.no_motion(NAME, Reason.of(Code.TOO_LONG, aspect=WIDEST_ASPECT))
    segments, size = segments_of(view)
    starts, opinion = list(STARTS), None
    if network is not None and len(segments):
        answer = network.coefficients(segments, view.up).ravel()
        errors = shipped().network_errors
        precision = _without_shear(errors.precision(_PX * displacement(answer)))
        opinion = SecondOpinion(answer, precision, errors.freedom)
        starts = [answer, *starts]
    likelihood = DrawnLikelihood(view, segments, size, lines, opinion)
    motion = _posterior_mean(likelihood, [np.zeros(6), *starts])
    return view.cubic_motion(motion.reshape(2, 3), NAME)


def _posterior_mean(likelihood: DrawnLikelihood, motions: Sequence[np.ndarray]) -> np.ndarray:
    """[6] coefficients of the motion: the mean over the optima that are reached from some motions.

    Poses are searched more widely than without lines, in roll, too: lines may say that the camera was held askew.
    """
    expected, kinds = likelihood.prior.mean, likelihood.prior.kinds
    poses = np.stack(np.meshgrid(_ROLLS, _TILTS, _LOG_FOCALS, _YAWS), axis=-1).reshape(-1, 4)
    grid = np.zeros((len(poses), UNKNOWNS))
    grid[:, [ROLL, TILT, LOG_FOCAL, YAW]] = poses + expected[[ROLL, TILT, LOG_FOCAL, YAW]]
    begin = []
    for motion in motions:
        grid[:, MOTION] = motion
        energy = likelihood.energy(grid)
        for roll in _ROLLS:
            (held,) = np.nonzero(poses[:, 0] == roll)
            begin.append(grid[held[np.argsort(energy[held])[:_POSES]]])
    everything = slice(0, UNKNOWNS)
    tried, energy, _ = descend(likelihood, np.concatenate(begin), everything, steps=_FIRST_STEPS)
    promising = tried[np.argsort(energy)[:_FOLLOWED]]
    kind = np.repeat(np.arange(len(kinds)), len(promising))
    optima, energy, hessian = descend(likelihood, np.tile(promising, (len(kinds), 1)), everything, kind)
    log_share = np.log([each.share for each in kinds]) + likelihood.prior.log_volume
    evidence = log_share[kind] - energy - 0.5 * np.linalg.slogdet(hessian)[1]
    weight = np.exp(evidence - evidence.max())
    return weight @ optima[:, MOTION] / weight.sum()


class DrawnLikelihood(ManhattanLikelihood):
    """The likelihood of a photo's segments, and of lines that a person drew.

    Args:
        view: the photo.
        segments, size: as :func:`segments_of` returns them.
        lines: that were drawn.
        opinion: another estimate to be weighed in.
    """

    def __init__(
        self,
        view: View,
        segments: np.ndarray,
        size: tuple[int, int],
        lines: Sequence[DrawnLine],
        opinion: SecondOpinion | None = None,
    ):
        known = known_camera(view)
        super().__init__(segments, size[0], size[1] / size[0], known=known, opinion=opinion, kinds=[_ANY_MOTION])
        drawn = [(line.kind, _in_rows(line, view)) for line in lines]
        self._upright = _Pieces([points for kind, points in drawn if kind == "upright"], vertical=True)
        self._level = _Pieces([points for kind, points in drawn if kind == "level"], vertical=False)
        self._facing = _Facing([points for kind, points in drawn if kind == "level"], self._turn)
        self._straight = _Bends([points for kind, points in drawn if kind == "straight"])
        self._parts = self._upright, self._level, self._facing, self._straight

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, 10] -> [S]."""
        return super().energy(unknowns) + sum(part.expanded(unknowns, self._turn)[0] for part in self._parts)

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None, camera_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10]."""
        energy, gradient, hessian = super().expanded(unknowns, kind, camera_only)
        for part in self._parts:
            of_part = part.expanded(unknowns, self._turn)
            energy, gradient, hessian = energy + of_part[0], gradient + of_part[1], hessian + of_part[2]
        return energy, gradient, hessian


Expansion: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # energy [S], gradient [S, 10], Hessian [S, 10, 10]


class _Pieces:
    """The pieces of lines of which the direction is known.

    Args:
        lines: points [N, 2] of each, centred, in rows.
        vertical: whether they are upright; else they run along one of the two horizontal directions.
    """

    def __init__(self, lines: Sequence[np.ndarray], vertical: bool):
        begin = np.concatenate([np.zeros((0, 2)), *(points[:-1] for points in lines)])
        end = np.concatenate([np.zeros((0, 2)), *(points[1:] for points in lines)])
        length = np.hypot(*(end - begin).T)
        kept = length > _LEAST_LENGTH
        self._ends = EndPoints(begin[kept]), EndPoints(end[kept])
        sigma = np.hypot(_SIGMA_ANGLE, _SIGMA_END / length[kept])
        self._precision = 1 / sigma**2
        self._points_of = slice(0, 1) if vertical else slice(1, 3)
        share = 1.0 if vertical else (1 - _OTHER_STREET) / 2
        self._peak = share / (sigma * math.sqrt(2 * math.pi))
        self._anywhere = 0.0 if vertical else _OTHER_STREET / math.pi

    def expanded(self, unknowns: np.ndarray, turn: float) -> Expansion:
        if not len(self._precision):
            return _nothing(unknowns)
        residuals = AngleResiduals(self._ends, unknowns, turn)
        energy, precision = self._weighed(residuals)
        sine, J = residuals.sine[:, self._points_of], residuals.jacobian()[:, :, self._points_of]
        return energy, *_normal_equations(J, sine, precision)

    def _weighed(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Energy E [S], and the precision W [S, 1 or 2, N] in dE/dsine = W sine."""
        exponent = -0.5 * residuals.sine[:, self._points_of] ** 2 * self._precision
        highest = exponent.max(axis=1, keepdims=True) if not self._anywhere else np.zeros(1)
        density = self._peak * np.exp(exponent - highest)
        total = density.sum(axis=1) + self._anywhere
        energy = -(np.log(total) + np.squeeze(highest, axis=1) if not self._anywhere else np.log(total))
        return energy.sum(axis=-1), density / total[:, None] * self._precision


class _Bends:
    """How far the points of straight lines lie from the chords between their ends.

    Args:
        lines: points [N, 2] of each, centred, in rows.
    """

    def __init__(self, lines: Sequence[np.ndarray]):
        self._lines = [
            (
                EndPoints(points[1:-1]),
                EndPoints(points[[0] * (len(points) - 2)]),
                EndPoints(points[[-1] * (len(points) - 2)]),
            )
            for points in lines
        ]

    def expanded(self, unknowns: np.ndarray, turn: float) -> Expansion:
        if not self._lines:
            return _nothing(unknowns)
        offsets, J = self._offsets(unknowns), _differences(self._offsets, unknowns)
        precision = np.full_like(offsets, 1 / _SIGMA_BEND**2)
        energy = 0.5 * (offsets**2 * precision).sum(axis=-1)
        return energy, *_normal_equations(J, offsets, precision)

    def _offsets(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, N] distances of all inner points from their chords [rows]."""
        offsets = [np.zeros((len(unknowns), 0))]
        for inner, begin, end in self._lines:
            point, one, other = (each.rectified(unknowns[:, MOTION]) for each in (inner, begin, end))
            dx, dy = other.col - one.col, other.row - one.row
            across = dx * (point.row - one.row) - dy * (point.col - one.col)
            offsets.append(across / np.maximum(np.hypot(dx, dy), _LEAST_LENGTH))
        return np.concatenate(offsets, axis=1)


class _Facing:
    """How far level lines slope against the camera's roll: little where they face the camera.

    Args:
        lines: points [N, 2] of each, centred, in rows.
        turn: roll [rad] of a camera that is held upright.
    """

    def __init__(self, lines: Sequence[np.ndarray], turn: float):
        self._ends = [(EndPoints(points[:1]), EndPoints(points[-1:])) for points in lines]
        self._turn = turn

    def expanded(self, unknowns: np.ndarray, turn: float) -> Expansion:
        if not self._ends:
            return _nothing(unknowns)
        slopes, J = self._slopes(unknowns), _differences(self._slopes, unknowns)
        facing, receding = (
            math.log(share / sigma) - 0.5 * (slopes / sigma) ** 2
            for share, sigma in ((_FACING, _SIGMA_FACING), (1 - _FACING, _SIGMA_RECEDING))
        )
        both = np.logaddexp(facing, receding)
        is_facing = np.exp(facing - both)
        precision = is_facing / _SIGMA_FACING**2 + (1 - is_facing) / _SIGMA_RECEDING**2
        return -both.sum(axis=-1), *_normal_equations(J, slopes, precision)

    def _slopes(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, N] angles between lines and what is level in a camera of this roll [rad]."""
        slopes = []
        for begin, end in self._ends:
            one, other = begin.rectified(unknowns[:, MOTION]), end.rectified(unknowns[:, MOTION])
            angle = np.arctan2(other.row - one.row, other.col - one.col) - unknowns[:, ROLL, None] - self._turn
            slopes.append((angle + math.pi / 2) % math.pi - math.pi / 2)
        return np.concatenate(slopes, axis=1)


def _differences(residuals: Callable[[np.ndarray], np.ndarray], unknowns: np.ndarray) -> np.ndarray:
    """[S, 10, N] the derivative of residuals [S, N] that depend on the motion and the roll alone."""
    at = residuals(unknowns)
    J = np.zeros((len(unknowns), UNKNOWNS, at.shape[1]))
    for k in (*range(UNKNOWNS)[MOTION], ROLL):
        changed = unknowns.copy()
        changed[:, k] += _STEP
        J[:, k] = (residuals(changed) - at) / _STEP
    return J


def _normal_equations(J: np.ndarray, residual: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J^T W r [S, 10] and J^T W J [S, 10, 10], where J is [S, 10, ...], r and W are [S, ...]."""
    count = len(J)
    flat = J.reshape(count, UNKNOWNS, -1)
    weighted = flat * precision.reshape(count, 1, -1)
    return (weighted @ residual.reshape(count, -1, 1))[..., 0], weighted @ flat.transpose(0, 2, 1)


def _nothing(unknowns: np.ndarray) -> Expansion:
    count = len(unknowns)
    return np.zeros(count), np.zeros((count, UNKNOWNS)), np.zeros((count, UNKNOWNS, UNKNOWNS))


def _without_shear(precision: np.ndarray) -> np.ndarray:
    """[6, 6] the precision of all but the linear coefficient of t_x, of which lines tell more than the network."""
    return precision - np.outer(precision[:, 0], precision[0]) / precision[0, 0]


def _in_rows(line: DrawnLine, view: View) -> np.ndarray:
    """[N, 2] points of a line in the readout frame, centred, in rows."""
    col, row = np.array(line.points, np.float64).T
    points = np.stack(view.readout.points_to_frame(col, row, view.photo.height, view.photo.width), axis=-1)
    return (points - np.array([view.width - 1, view.height - 1]) / 2) / view.height


def _points(points: Any) -> tuple[tuple[float, float], ...]:
    return tuple((float(col), float(row)) for col, row in points)
