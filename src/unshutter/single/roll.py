"""The uncertainty of the roll of a camera at rest, from the lines of its photo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unshutter.motion.shapes import Float64
from unshutter.single.likelihood import ManhattanLikelihood
from unshutter.single.prior import ROLL, TILT
from unshutter.single.search import CAMERA, descend

_FROM_ROLLS, _FROM_TILTS = np.radians([-6, -3, 0, 3, 6]), np.radians([-10, 0, 10])  # relative to the camera found


@dataclass(frozen=True)
class RollParams:
    """Limits of trust: ``python lab/benchmarks/levelling.py`` (docs/research/own-model-folders.md#levelling)."""

    same_camera: float = 0.003  # of its unknowns
    same_roll: float = math.radians(0.3)
    other_cameras: float = 0.2  # exponent of their evidence, as segments repeat each other's errors
    from_segments: float = 2.0  # times the deviation by the curvature, for the same reason
    least_error: float = math.radians(0.3)  # of lenses and of what people build
    least_gain: float = 0.3  # of the lines over chance [nats per unit of weight]; below it, they show no roll
    fewest_upright: float = 0.1  # share of upright lines; below it, level ones may recede unless one is a horizon
    horizon: float = 0.3  # share of the picture's width that segments of a horizon cover,
    on_a_line: float = 0.006  # rows from it
    level: float = math.sin(math.radians(1))


_ROLL = RollParams()


def roll_error(likelihood: ManhattanLikelihood, camera: Float64[np.ndarray, "4"]) -> float | None:
    """Returns the standard deviation [rad] of the roll of a camera at rest; None if another one fits as well.

    Args:
        camera: the most probable one near a pose (:func:`~unshutter.single.search.cameras_for`).
    """
    still = np.concatenate([np.zeros(6), camera])
    if float(likelihood.lines_gain(still[None])[0]) < _ROLL.least_gain:
        return None
    upright, *level = likelihood.weight_of_directions(still)
    may_recede = likelihood.known.log_focal is None and upright < _ROLL.fewest_upright * (upright + sum(level))
    if may_recede and _longest_line(likelihood, camera[0]) < _ROLL.horizon:
        return None
    begin = np.tile(still, (1 + len(_FROM_ROLLS) * len(_FROM_TILTS), 1))
    begin[1:, ROLL] += np.repeat(_FROM_ROLLS, len(_FROM_TILTS))
    begin[1:, TILT] += np.tile(_FROM_TILTS, len(_FROM_ROLLS))
    cameras, energy, hessian = descend(likelihood, begin, CAMERA)
    cameras = cameras[:, CAMERA]
    order = np.argsort(energy, kind="stable")
    roll = cameras[order[0], 0]
    if abs(roll - camera[0]) > _ROLL.same_roll:
        return None
    kept: list[int] = []
    for k in order:
        if all(np.abs(cameras[k] - cameras[j]).max() > _ROLL.same_camera for j in kept):
            kept.append(int(k))
    curvature = hessian[kept][:, CAMERA, CAMERA]
    evidence = -energy[kept] - 0.5 * np.linalg.slogdet(curvature)[1]
    share = np.exp(_ROLL.other_cameras * (evidence - evidence.max()))
    others = float(share @ (cameras[kept, 0] - roll) ** 2 / share.sum())
    return math.sqrt(_ROLL.from_segments**2 * float(np.linalg.inv(curvature[0])[0, 0]) + others + _ROLL.least_error**2)


def _longest_line(likelihood: ManhattanLikelihood, roll: float) -> float:
    """Returns the largest share of the picture's width that level segments on one line cover."""
    segments = likelihood.segments
    up = likelihood.known.up
    angle = roll + math.atan2(up[0], -up[1])  # of level lines
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    way = segments[:, 2:] - segments[:, :2]
    segments = segments[np.abs(way @ across) < _ROLL.level * np.hypot(*way.T)]
    height = (segments[:, :2] + segments[:, 2:]) @ across / 2
    ends = np.sort(np.stack([segments[:, :2] @ along, segments[:, 2:] @ along], axis=1), axis=1)
    longest = 0.0
    for each in height:
        covered, reached = 0.0, -math.inf
        for start, end in sorted(ends[np.abs(height - each) < _ROLL.on_a_line].tolist()):
            covered += max(end - max(start, reached), 0.0)
            reached = max(reached, end)
        longest = max(longest, covered)
    return longest / float(np.abs(along) @ [likelihood.aspect, 1])
