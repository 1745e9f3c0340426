"""Estimates the motion from drawn lines and the photo's segments together.

Drawn lines enter the Manhattan likelihood as certain evidence: each has full weight and none may be an outlier, whereas
a detected segment may have any direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import get_args

import numpy as np

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
from unshutter.estimators.right_angles.drawn_evidence import Bends, Evidence, Facing, Pieces
from unshutter.estimators.right_angles.drawn_lines import DrawnLine, LineKind, checked_lines
from unshutter.estimators.right_angles.likelihood import ManhattanLikelihood
from unshutter.estimators.right_angles.posterior import PX, displacement
from unshutter.estimators.right_angles.search import descend
from unshutter.estimators.right_angles.view import STARTS, known_camera, segments_of
from unshutter.estimators.segment_network import SegmentNetwork
from unshutter.estimators.segments import WIDEST_ASPECT
from unshutter.motion import Motion
from unshutter.reasons import Code, Reason

NAME = "drawn-lines"  # estimator name of these motions
_ROLLS, _TILTS = np.radians([-3, 0, 3]), np.radians([-8, 0, 8, 18, 32])  # of starting poses
_LOG_FOCALS, _YAWS = np.array([-0.35, 0.25]), np.arange(9) * (math.pi / 2 / 9)
_POSES, _FIRST_STEPS, _FOLLOWED = 2, 10, 8  # per motion and roll; of all poses; best ones that continue
# a broad prior on the motion: lines were drawn because they show it
_ANY_MOTION = MotionKind("any", np.diag([0.06, 0.08, 0.01, 0.07, 0.06, 0.01]) ** 2, NORMAL, 1.0)


def motion_from_lines(view: View, lines: Sequence[DrawnLine], network: SegmentNetwork | None = None) -> Motion:
    """Estimates the motion from drawn lines together with the photo's segments; first row as the reference.

    Its confidence is None, because a person has decided.

    Args:
        view: the photo.
        lines: at least one.
        network: network whose estimate is included, as in segment-manhattan; None for none.

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
    """The likelihood of a photo's segments and of lines drawn by a person.

    Args:
        view: the photo.
        segments, size: as :func:`segments_of` returns them.
        lines: the drawn lines.
        opinion: another estimate to include.
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
        upright, level, straight = ([points for kind, points in drawn if kind == each] for each in get_args(LineKind))
        self._parts: tuple[Evidence, ...] = (
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
