"""Lines drawn by a person: their files, and the motion that they and the photo's segments show.

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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from unshutter.errors import UnshutterError, UsageError, errors_in_one_line, shortened
from unshutter.motion.finding import Finding
from unshutter.reasons import Code, MotionSource, Reason, Worded
from unshutter.single.estimator import View
from unshutter.single.likelihood import (
    STARTS,
    WIDEST_ASPECT,
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
    MotionKind,
    NetworkObservation,
    shipped,
)
from unshutter.single.search import PX, bend, descend, displacement, poses
from unshutter.storage.files import read_text

LineKind: TypeAlias = Literal["upright", "level", "straight"]

FORMAT = "unshutter-lines/1"
MOST_LINES = 100
MOST_POINTS = 100


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
            raise UsageError(f"unknown kind of line '{shortened(self.kind)}': choose upright, level or straight")
        fewest = 3 if self.kind == "straight" else 2
        if not fewest <= len(self.points) <= MOST_POINTS:
            raise UsageError(f"a line that is {self.kind} needs {fewest} to {MOST_POINTS} points")
        if not all(math.isfinite(value) and abs(value) < 1e9 for point in self.points for value in point):
            raise UsageError("the points of a line are positions in the photo [px]")


def lines_from_json(text: str) -> tuple[DrawnLine, ...]:
    """Parses the text of a file of lines, format ``unshutter-lines/1``."""
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
    with errors_in_one_line(path):  # which the messages name, not the photo
        try:
            return lines_from_json(read_text(path))
        except (OSError, UnicodeDecodeError) as error:
            cause = getattr(error, "strerror", None) or "it is not text"
            raise UnshutterError(f"cannot read {{file}}: {cause}", file=path) from None


def checked_lines(lines: Sequence[DrawnLine]) -> tuple[DrawnLine, ...]:
    """Returns the lines after checking their number."""
    if not 1 <= len(lines) <= MOST_LINES:
        raise UsageError(f"draw at least one line, and at most {MOST_LINES}")
    return tuple(lines)


def _points(points: Iterable[Sequence[float]]) -> tuple[tuple[float, float], ...]:
    return tuple((float(col), float(row)) for col, row in points)


# ---- as constraints ------------------------------------------------------------------------------------

MET_DEG = 0.3  # a line that is this close to its direction in the result is met


@dataclass(frozen=True)
class DrawnLineParams:
    """How drawn lines are met, measured by ``python lab/benchmarks/drawn_lines.py`` (docs/guide/by-hand.md)."""

    sigma_angle: float = 0.0025  # of a drawn direction [rad],
    sigma_bend: float = 0.002  # and of the points of a line [rows]
    askew: float = math.radians(0.25)  # of the camera, at most: lines stay within MET_DEG
    slack: float = 0.01  # of their variance: in the result they are met almost exactly
    steepest: float = math.radians(35)  # tilt that lines show
    max_rotation: float = math.radians(45)  # turn of a line by the motion
    farthest: float = 4.5  # standard deviations of a motion that lines show
    most_bent_px: float = 3.0  # bend that they add [px of 256]
    least_length: float = 0.01  # of a line [rows]
    step: float = 1e-6  # of numerical derivatives
    first_steps: int = 10  # of all starting poses
    followed: int = 8  # best poses that continue
    onto_lines: int = 5  # steps


LINES = DrawnLineParams()


NAME = "drawn-lines"  # estimator name of these motions
# a broad prior on the motion: lines were drawn because they show it
_ANY_MOTION = MotionKind("any", np.diag([0.06, 0.08, 0.01, 0.07, 0.06, 0.01]) ** 2, NORMAL, 1.0)


class DrawnLikelihood(ManhattanLikelihood):
    """The likelihood of a photo's segments [N, 4], found in a picture of this (height, width), and of drawn lines."""

    def __init__(
        self,
        view: View,
        segments: np.ndarray,
        size: tuple[int, int],
        lines: Sequence[DrawnLine],
        observation: NetworkObservation | None = None,
    ):
        known = known_camera(view)
        super().__init__(
            segments, size[0], size[1] / size[0], known=known, observation=observation, kinds=[_ANY_MOTION]
        )
        drawn = [_in_rows(line, view) for line in lines]
        inner = [len(points) - 2 for points in drawn]
        self._lines = [EndPoints(np.array([points[k] for points in drawn])) for k in (0, -1)]
        self._inner = EndPoints(np.concatenate([points[1:-1] for points in drawn]))
        self._chords = [EndPoints(np.repeat([points[k] for points in drawn], inner, axis=0)) for k in (0, -1)]
        self._level = np.array([line.kind == "level" for line in lines])
        self._directed = np.array([line.kind != "straight" for line in lines])

    def angles(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, lines] angles [rad] between lines in the result and their intended directions, -pi / 2 to pi / 2.

        Upright lines run to the vertical vanishing point of a camera with this tilt and roll, level ones across it. A
        straight line may have any direction.
        """
        one, other = (end.rectified(unknowns[:, MOTION]) for end in self._lines)
        roll = self._turn + unknowns[:, ROLL, None]
        # from the middle of a line to the vanishing point, divided by f cos(tilt)
        converging = np.tan(unknowns[:, TILT, None]) / np.exp(unknowns[:, LOG_FOCAL, None]) / 2
        x = np.where(self._level, np.cos(roll), -np.sin(roll) + converging * (one.col + other.col))
        y = np.where(self._level, np.sin(roll), np.cos(roll) + converging * (one.row + other.row))
        angle = np.arctan2(other.row - one.row, other.col - one.col) - np.arctan2(y, x)
        return ((angle + math.pi / 2) % math.pi - math.pi / 2) * self._directed

    def bends(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, points] distances of the inner points of lines from the chords between their ends [rows]."""
        point, one, other = (each.rectified(unknowns[:, MOTION]) for each in (self._inner, *self._chords))
        dx = other.col - one.col
        dy = other.row - one.row
        across = dx * (point.row - one.row) - dy * (point.col - one.col)
        return across / np.maximum(np.hypot(dx, dy), LINES.least_length)

    def residuals(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, M] deviations of the lines from their intended directions and straightness, in standard deviations."""
        angles, bends = self.angles(unknowns), self.bends(unknowns)
        return np.concatenate([angles / LINES.sigma_angle, bends / LINES.sigma_bend], axis=1)

    def jacobian(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, 10, M] derivative of the residuals, which do not depend on the yaw."""
        at = self.residuals(unknowns)
        J = np.zeros((len(unknowns), UNKNOWNS, at.shape[1]))
        for k in (*range(UNKNOWNS)[MOTION], ROLL, TILT, LOG_FOCAL):
            changed = unknowns.copy()
            changed[:, k] += LINES.step
            J[:, k] = (self.residuals(changed) - at) / LINES.step
        return J

    def energy(self, unknowns: np.ndarray) -> np.ndarray:
        """Returns the energy of unknowns: [S, 10] -> [S]."""
        return super().energy(unknowns) + 0.5 * (self.residuals(unknowns) ** 2).sum(axis=-1)

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None, camera_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the energy [S], its gradient [S, 10] and its Gauss-Newton Hessian [S, 10, 10]."""
        energy, gradient, hessian = super().expanded(unknowns, kind, camera_only)
        at = self.residuals(unknowns)
        J = self.jacobian(unknowns)
        energy = energy + 0.5 * (at**2).sum(axis=-1)
        gradient = gradient + (J @ at[..., None])[..., 0]
        return energy, gradient, hessian + J @ J.transpose(0, 2, 1)


# ---- the motion that they show ---------------------------------------------------------------------------


class Trouble(Worded):
    """Why a drawn line does not run as intended in the result."""

    SIDEWAYS = "sideways", "it runs across the direction that it is to have, and was not used"
    CONTRADICTS = "contradicts", "no plausible motion straightens it along with the other lines"


@dataclass(frozen=True)
class StraightenedLines:
    """The motion that drawn lines show."""

    finding: Finding  # first row as the reference; no confidence, because a person has decided
    troubles: tuple[Trouble | None, ...]  # of each line; None: in the result it is within ``MET_DEG`` of its direction
    left_deg: tuple[
        float, ...
    ] = ()  # of each line: angle between it in the result and the direction that it is to have


def motion_from_lines(
    view: View, lines: Sequence[DrawnLine], network: SegmentNetwork | None = None
) -> StraightenedLines:
    """Finds a likely motion that straightens drawn lines, given the photo's segments and a network.

    The posterior, in which the camera may have been held askew, is changed by the least that makes upright lines meet
    in the vanishing point of a camera held upright, and level ones level. If no plausible motion does that, the worst
    lines are left out one by one, and the last two are met as closely as possible.
    """
    lines = checked_lines(lines)
    if max(view.width / view.height, view.height / view.width) > WIDEST_ASPECT:
        finding = view.no_motion(NAME, Reason.of(Code.TOO_LONG, aspect=WIDEST_ASPECT))
        return StraightenedLines(replace(finding, source=MotionSource.HAND), (None,) * len(lines))
    segments, size = segments_of(view)
    starts = [np.zeros(6), *STARTS]
    observation = None
    if network is not None and len(segments):
        answer = network.coefficients(segments, view.up).ravel()
        errors = shipped().network_errors
        precision = errors.precision(PX * displacement(answer))
        precision -= np.outer(precision[:, 0], precision[0]) / precision[0, 0]  # lines determine the shear better
        observation = NetworkObservation(answer, precision, errors.freedom)
        starts = [answer, *starts]
    every = DrawnLikelihood(view, segments, size, lines, observation)
    usable = np.abs(every.angles(np.zeros((1, UNKNOWNS)))[0]) < LINES.max_rotation
    level = np.array([line.kind == "level" for line in lines])
    used = usable
    fit = every.prior.mean[None]
    upright = np.arange(UNKNOWNS) != ROLL
    while used.any():
        likelihood = DrawnLikelihood(view, segments, size, [lines[k] for k in np.flatnonzero(used)], observation)
        mean = _posterior_mean(likelihood, starts)
        fit = _onto_lines(likelihood, mean)
        met = np.abs(every.angles(fit * upright)[0]) <= math.radians(MET_DEG)
        plausible = _plausible(fit[0], mean[0])
        doubtful = used & level if (used & level).any() else used  # a level line may recede
        if (met[used].all() and plausible) or used.sum() == 1 or (doubtful is used and used.sum() == 2):
            fit = fit if plausible else mean
            break
        worst = np.argmax(np.abs(every.angles(mean * upright)[0]) * doubtful)
        used = used & (np.arange(len(lines)) != worst)
    angles = every.angles(fit * upright)[0]
    troubles = [
        Trouble.SIDEWAYS if not usable[k] else Trouble.CONTRADICTS if abs(math.degrees(angle)) > MET_DEG else None
        for k, angle in enumerate(angles)
    ]
    finding = replace(view.cubic_motion(fit[0, MOTION].reshape(2, 3), NAME), source=MotionSource.HAND)
    return StraightenedLines(finding, tuple(troubles), tuple(np.degrees(angles).tolist()))


def _plausible(unknowns: np.ndarray, mean: np.ndarray) -> bool:
    """Whether a hand-held camera moves like that and is tilted that far, and the photo allows the bend."""
    motion = unknowns[MOTION]
    tilt = abs(float(unknowns[TILT]))
    far2 = float(motion @ _ANY_MOTION.precision @ motion)
    return far2 < LINES.farthest**2 and tilt < LINES.steepest and PX * bend(motion - mean[MOTION]) < LINES.most_bent_px


_CHANGED = np.array([*range(UNKNOWNS)[MOTION], TILT])  # unknowns that straighten lines
_READILY = np.array([0.06, 0.03, 0.003, 0.02, 0.01, 0.001, 0.1])  # how much of each: shear rather than bend and turn


def _posterior_mean(likelihood: DrawnLikelihood, motions: Sequence[np.ndarray]) -> np.ndarray:
    """Returns the mean [1, 10] of the posterior over the optima reached from the starting motions.

    Poses are searched more widely than without lines, including roll, because lines may show a camera held askew.
    """
    begin = [poses(likelihood, motion, roll) for motion in motions for roll in np.radians([-3, 0, 3])]
    everything = slice(0, UNKNOWNS)
    tried, energy, _ = descend(likelihood, np.concatenate(begin), everything, steps=LINES.first_steps)
    optima, energy, hessian = descend(likelihood, tried[np.argsort(energy)[: LINES.followed]], everything)
    evidence = -energy - 0.5 * np.linalg.slogdet(hessian)[1]
    weight = np.exp(evidence - evidence.max())
    return (weight @ optima / weight.sum())[None]


def _onto_lines(likelihood: DrawnLikelihood, unknowns: np.ndarray) -> np.ndarray:
    """Changes motion and tilt [1, 10] by the least that straightens the lines in the picture of an upright camera."""
    unknowns = unknowns.copy()
    scale = np.diag(_READILY**2)
    unknowns[:, ROLL] = np.clip(unknowns[:, ROLL], -LINES.askew, LINES.askew)
    for _ in range(LINES.onto_lines):
        at = likelihood.residuals(unknowns)[0]
        J = likelihood.jacobian(unknowns)[0, _CHANGED]
        unknowns[0, _CHANGED] -= scale @ J @ np.linalg.solve(J.T @ scale @ J + LINES.slack * np.eye(len(at)), at)
    return unknowns


def _in_rows(line: DrawnLine, view: View) -> np.ndarray:
    """[N, 2] points of a line in the readout frame, centred, in rows."""
    col, row = np.array(line.points, np.float64).T
    points = np.stack(view.scan_direction.points_to_frame(col, row, view.photo.height, view.photo.width), axis=-1)
    return (points - np.array([view.width - 1, view.height - 1]) / 2) / view.height
