"""Lines that a person draws in a photo, files of them, and the motion they show together with the photo's segments.

An upright line points to the vertical vanishing point, a level one to some horizontal direction of the scene, receding
or not, and a straight one has no known direction but no bend either. People usually draw level lines along surfaces
that face them, so these lines reveal the camera's roll; the slope of a receding line depends on things that a single
line does not show.

The energies of drawn lines are added to that of the Manhattan likelihood as certain evidence: each has full weight and
none may be an outlier, whereas a detected segment may have any direction.
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
from unshutter.motion import Motion
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter.single.likelihood import (
    STARTS,
    WIDEST_ASPECT,
    AngleResiduals,
    EndPoints,
    ManhattanLikelihood,
    known_camera,
    segments_of,
)
from unshutter.single.network import SegmentNetwork
from unshutter.single.prior import (
    LOG_FOCAL,
    MOTION,
    NORMAL,
    ROLL,
    TILT,
    UNKNOWNS,
    YAW,
    MotionKind,
    SecondOpinion,
    shipped,
    two_gaussians,
)
from unshutter.single.search import PX, descend, displacement
from unshutter.storage.files import read_text

LineKind: TypeAlias = Literal["upright", "level", "straight"]

FORMAT = "unshutter-lines/1"
MOST_LINES, MOST_POINTS = 100, 100


@dataclass(frozen=True)
class DrawnLine:
    """A line drawn by a person.

    Attributes:
        kind: ``upright``: vertical in the scene; ``level``: horizontal in the scene, receding or not; ``straight``:
            straight in the scene, in any direction.
        points: two or more (col, row) along it [px of the stored photo]; a straight line needs three.

    Raises:
        UsageError: unknown kind, too few or too many points, or a position that is not finite.
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
    """Parses text written by :func:`lines_to_json`."""
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
    """Reads a file of lines."""
    try:
        return lines_from_json(read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise UnshutterError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is not text'}") from None


def lines_to_json(lines: Iterable[DrawnLine]) -> str:
    """Returns lines as the text of a file, format ``unshutter-lines/1``."""
    listed = [{"kind": line.kind, "points": [list(point) for point in line.points]} for line in lines]
    return json.dumps({"format": FORMAT, "lines": listed})


def checked_lines(lines: Sequence[DrawnLine]) -> tuple[DrawnLine, ...]:
    """Returns the lines after checking their number."""
    if not 1 <= len(lines) <= MOST_LINES:
        raise UsageError(f"draw at least one line, and at most {MOST_LINES}")
    return tuple(lines)


def _points(points: Any) -> tuple[tuple[float, float], ...]:
    return tuple((float(col), float(row)) for col, row in points)


# ---- their evidence ------------------------------------------------------------------------------------

# Measured on a separate set of photos (val/), as docs/guide/by-hand.md shows.
_SIGMA_ANGLE = 0.0025  # of a drawn direction [rad],
_SIGMA_END = 0.001  # of its ends [rows],
_SIGMA_BEND = 0.002  # and of the points of a straight line [rows]
_FACING = 0.6  # share of level lines on surfaces that face the camera,
_SIGMA_FACING, _SIGMA_RECEDING = math.radians(1), math.radians(12)  # and slopes of these and of other lines
_OTHER_STREET = 0.05  # share of level lines along neither of the two horizontal directions
_LEAST_LENGTH = 0.01  # of a piece of a line [rows]: shorter ones have no usable direction
_STEP = 1e-6  # of numerical derivatives

Expansion: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # energy [S], gradient [S, 10], Hessian [S, 10, 10]


class Pieces:
    """Pieces of lines with a known direction: upright, or along one of the two horizontal directions.

    ``turn`` is the roll [rad] of a camera held upright.
    """

    def __init__(self, lines: Sequence[np.ndarray], turn: float, vertical: bool):
        self._turn = turn
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

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the pieces' angles to the vanishing points, measured by their sines."""
        residuals = AngleResiduals(self._ends, unknowns, self._turn)
        energy, precision = self._weighed(residuals)
        sine, J = residuals.sine[:, self._points_of], residuals.jacobian()[:, :, self._points_of]
        return energy, *_normal_equations(J, sine, precision)

    def _weighed(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Returns the energy E [S], and the precision W [S, 1 or 2, N] in dE/dsine = W sine."""
        exponent = -0.5 * residuals.sine[:, self._points_of] ** 2 * self._precision
        highest = exponent.max(axis=1, keepdims=True) if not self._anywhere else np.zeros(1)
        density = self._peak * np.exp(exponent - highest)
        total = density.sum(axis=1) + self._anywhere
        energy = -(np.log(total) + np.squeeze(highest, axis=1) if not self._anywhere else np.log(total))
        return energy.sum(axis=-1), density / total[:, None] * self._precision


class Bends:
    """Distances of the points of straight lines from the chords between their ends."""

    def __init__(self, lines: Sequence[np.ndarray]):
        self._lines = [
            (
                EndPoints(points[1:-1]),
                EndPoints(points[[0] * (len(points) - 2)]),
                EndPoints(points[[-1] * (len(points) - 2)]),
            )
            for points in lines
        ]

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the inner points' distances from the chords."""
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


class Facing:
    """Slopes of level lines relative to the camera's roll, which are small on surfaces that face the camera."""

    def __init__(self, lines: Sequence[np.ndarray], turn: float):
        self._ends = [(EndPoints(points[:1]), EndPoints(points[-1:])) for points in lines]
        self._turn = turn

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the slopes, modelled by a mixture of two Gaussians."""
        slopes, J = self._slopes(unknowns), _differences(self._slopes, unknowns)
        energy, precision = two_gaussians(slopes, _SIGMA_FACING, _SIGMA_RECEDING, rare_share=1 - _FACING)
        return energy.sum(axis=-1), *_normal_equations(J, slopes, precision)

    def _slopes(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, N] angles between lines and the horizontal of a camera with this roll [rad]."""
        slopes = [np.zeros((len(unknowns), 0))]
        for begin, end in self._ends:
            one, other = begin.rectified(unknowns[:, MOTION]), end.rectified(unknowns[:, MOTION])
            angle = np.arctan2(other.row - one.row, other.col - one.col) - unknowns[:, ROLL, None] - self._turn
            slopes.append((angle + math.pi / 2) % math.pi - math.pi / 2)
        return np.concatenate(slopes, axis=1)


def _differences(residuals: Callable[[np.ndarray], np.ndarray], unknowns: np.ndarray) -> np.ndarray:
    """[S, 10, N] derivative of residuals [S, N] that depend only on motion and roll."""
    at = residuals(unknowns)
    J = np.zeros((len(unknowns), UNKNOWNS, at.shape[1]))
    for k in (*range(UNKNOWNS)[MOTION], ROLL):
        changed = unknowns.copy()
        changed[:, k] += _STEP
        J[:, k] = (residuals(changed) - at) / _STEP
    return J


def _normal_equations(J: np.ndarray, residual: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J^T W r [S, 10] and J^T W J [S, 10, 10], where J is [S, 10, ...], r and W are [S, ...]."""
    count, each = len(J), residual[0].size  # may be 0
    flat = J.reshape(count, UNKNOWNS, each)
    weighted = flat * precision.reshape(count, 1, each)
    return (weighted @ residual.reshape(count, each, 1))[..., 0], weighted @ flat.transpose(0, 2, 1)


NAME = "drawn-lines"  # estimator name of these motions
_ROLLS, _TILTS = np.radians([-3, 0, 3]), np.radians([-8, 0, 8, 18, 32])  # of starting poses
_LOG_FOCALS, _YAWS = np.array([-0.35, 0.25]), np.arange(9) * (math.pi / 2 / 9)
_POSES, _FIRST_STEPS, _FOLLOWED = 2, 10, 8  # per motion and roll; of all poses; best ones that continue
# a broad prior on the motion: lines were drawn because they show it
_ANY_MOTION = MotionKind("any", np.diag([0.06, 0.08, 0.01, 0.07, 0.06, 0.01]) ** 2, NORMAL, 1.0)


def motion_from_lines(view: View, lines: Sequence[DrawnLine], network: SegmentNetwork | None = None) -> Motion:
    """Estimates the motion from drawn lines, the photo's segments and a network; first row as the reference.

    Its confidence is None, because a person has decided.
    """
    lines = checked_lines(lines)
    if max(view.width / view.height, view.height / view.width) > WIDEST_ASPECT:
        return view.no_motion(NAME, Reason.of(Code.TOO_LONG, aspect=WIDEST_ASPECT))
    segments, size = segments_of(view)
    starts, opinion = list(STARTS), None
    if network is not None and len(segments):
        answer = network.coefficients(segments, view.up).ravel()
        errors = shipped().network_errors
        precision = _without_shear(errors.precision(PX * displacement(answer)))
        opinion = SecondOpinion(answer, precision, errors.freedom)
        starts = [answer, *starts]
    likelihood = DrawnLikelihood(view, segments, size, lines, opinion)
    motion = _posterior_mean(likelihood, [np.zeros(6), *starts])
    return view.cubic_motion(motion.reshape(2, 3), NAME)


def _posterior_mean(likelihood: DrawnLikelihood, motions: Sequence[np.ndarray]) -> np.ndarray:
    """Returns [6] coefficients of the posterior mean over the optima reached from the starting motions.

    Poses are searched more widely than without lines, including roll, because lines may show a camera held askew.
    """
    expected = likelihood.prior.mean
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
    optima, energy, hessian = descend(likelihood, tried[np.argsort(energy)[:_FOLLOWED]], everything)
    evidence = -energy - 0.5 * np.linalg.slogdet(hessian)[1]
    weight = np.exp(evidence - evidence.max())
    return weight @ optima[:, MOTION] / weight.sum()


class DrawnLikelihood(ManhattanLikelihood):
    """The likelihood of a photo's segments and of lines drawn by a person."""

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
        upright, level, straight = ([points for kind, points in drawn if kind == each] for each in get_args(LineKind))
        self._parts = (
            Pieces(upright, self._turn, vertical=True),
            Pieces(level, self._turn, vertical=False),
            Facing(level, self._turn),
            Bends(straight),
        )

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the energy of unknowns: [S, 10] -> [S]."""
        return super().energy(unknowns) + sum(part.expanded(unknowns)[0] for part in self._parts)

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None, camera_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10]."""
        energy, gradient, hessian = super().expanded(unknowns, kind, camera_only)
        for part in self._parts:
            part_energy, part_gradient, part_hessian = part.expanded(unknowns)
            energy, gradient, hessian = energy + part_energy, gradient + part_gradient, hessian + part_hessian
        return energy, gradient, hessian


def _without_shear(precision: np.ndarray) -> np.ndarray:
    """[6, 6] precision without the linear coefficient of t_x, which lines determine better than the network."""
    return precision - np.outer(precision[:, 0], precision[0]) / precision[0, 0]


def _in_rows(line: DrawnLine, view: View) -> np.ndarray:
    """[N, 2] points of a line in the readout frame, centred, in rows."""
    col, row = np.array(line.points, np.float64).T
    points = np.stack(view.readout.points_to_frame(col, row, view.photo.height, view.photo.width), axis=-1)
    return (points - np.array([view.width - 1, view.height - 1]) / 2) / view.height
