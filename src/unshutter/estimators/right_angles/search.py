"""Searches for the most probable motions under the Manhattan likelihood, from many starts, weighted by evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unshutter.estimators.right_angles.beliefs import CAMERA, LOG_FOCAL, MOTION, ROLL, TILT, UNKNOWNS, YAW
from unshutter.estimators.right_angles.likelihood import ManhattanLikelihood
from unshutter.estimators.right_angles.posterior import Optima, Pose, Posterior, displacement, mixture_moments

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_YAWS = np.arange(9) * (math.pi / 2 / 9)
_TILTS = np.radians([-8, 0, 8, 18, 32])
_LOG_FOCALS = np.array([-0.35, 0.25])  # relative to the expected one
_OTHER_YAW = 0.2  # rad between the starting poses for one motion
_FIRST_STEPS = 10  # of every start;
_FOLLOWED = 4  # only this many of the best continue, as motions of each kind
_TEMPER = 0.25  # tempers the evidence for one kind of motion against another: segments' errors are correlated
_LONGEST_STEP = 0.3
_LEAST_GAIN = 1e-3  # of a step [nats]; smaller gains end the search
_SAME = 0.3 / 256  # rows: optima closer than this are merged
_DIAGONAL = np.arange(UNKNOWNS)


def explore(likelihood: ManhattanLikelihood, motions: Sequence[np.ndarray], poses: int = 2) -> Posterior:
    """Finds the optima near the given motions, searching the camera's pose for each.

    Args:
        likelihood: likelihood of one photo.
        motions: [6] coefficients each, to start from; zero motion is always included.
        poses: number of starting cameras per motion.
    """
    begin = np.concatenate([_poses(likelihood, motion, poses) for motion in (np.zeros(6), *motions)])
    (hypotheses, kind, moving, covariances), (at_rest, still) = _optima(likelihood, begin, begin[:poses])
    each = _by_kind(moving, kind)  # evidence
    log_shares = np.log([known.share for known in likelihood.prior.kinds])  # prior
    tempered = _TEMPER * each + log_shares
    share = np.exp(moving - each[kind] + (tempered - np.logaddexp.reduce(tempered))[kind])
    # the posterior of the motion is a mixture of Gaussians, one for each optimum
    optima = Optima(hypotheses[:, MOTION], covariances, kind, share)
    mean, covariance = mixture_moments(share, optima.motions, covariances)
    best = hypotheses[np.argmax(share)]
    breadth, against, in_favour = _by_parts(likelihood, best, still)
    return Posterior(
        motion=mean,
        covariance=covariance,
        optima=optima,
        kinds={known.name: float(share[kind == k].sum()) for k, known in enumerate(likelihood.prior.kinds)},
        evidence_of={known.name: float(each[k]) - at_rest for k, known in enumerate(likelihood.prior.kinds)},
        evidence=float(np.logaddexp.reduce(each + log_shares)) - at_rest,
        lines_gain=float(likelihood.lines_gain(best[None])[0]),
        weight=float(likelihood.weight.sum()),
        gain_at_rest=float(likelihood.lines_gain(still[None])[0]),
        breadth=breadth,
        against=against,
        in_favour=in_favour,
        pose=_pose(likelihood, best),
        pose_at_rest=_pose(likelihood, still),
    )


class _Moving(NamedTuple):
    """Optima with motion: unknowns [K, 10], kinds [K], log evidence [K], covariances of the motion [K, 6, 6].

    The evidence is the Laplace approximation.
    """

    hypotheses: np.ndarray
    kind: np.ndarray
    log_evidence: np.ndarray
    covariances: np.ndarray


class _AtRest(NamedTuple):
    """The hypothesis of no motion: its log evidence [nats], and [10] unknowns with its best camera."""

    log_evidence: float
    hypothesis: np.ndarray


def _optima(likelihood: ManhattanLikelihood, begin: np.ndarray, cameras: np.ndarray) -> tuple[_Moving, _AtRest]:
    """Returns the optima of every kind of motion reached from some starts [S, 10], and that without motion.

    Kinds share their first steps, with the prior of the first one, which is the widest. The rest is searched together
    with the cameras at rest, since a few more hypotheses cost little.

    Args:
        likelihood: likelihood of one photo.
        begin: [S, 10] starts.
        cameras: [C, 10] starts without motion.
    """
    tried, energy, _ = descend(likelihood, begin, slice(0, UNKNOWNS), steps=_FIRST_STEPS)
    promising = tried[_distinct(tried, energy)[:_FOLLOWED]]
    count = len(likelihood.prior.kinds)
    kind = np.repeat(np.arange(count), len(promising))
    starts = np.concatenate([np.tile(promising, (count, 1)), cameras])
    moving, at_rest = slice(0, len(kind)), slice(len(kind), None)
    free = np.ones(starts.shape, bool)
    free[at_rest, MOTION] = False
    optima = descend(likelihood, starts, free, np.concatenate([kind, np.zeros(len(cameras), int)]))
    still, energy, hessian = (each[at_rest] for each in optima)
    best = int(np.argmin(energy))
    evidence_at_rest = float(-energy[best] - 0.5 * np.linalg.slogdet(hessian[best, CAMERA, CAMERA])[1])
    resting = _AtRest(evidence_at_rest, still[best])
    hypotheses, energy, hessian = (each[moving] for each in optima)
    kept = np.concatenate(
        [np.flatnonzero(kind == k)[_distinct(hypotheses[kind == k], energy[kind == k])] for k in range(count)]
    )
    hypotheses, kind, hessian = hypotheses[kept], kind[kept], hessian[kept]
    log_evidence = likelihood.prior.log_volume[kind] - energy[kept] - 0.5 * np.linalg.slogdet(hessian)[1]
    return _Moving(hypotheses, kind, log_evidence, np.linalg.inv(hessian)[:, MOTION, MOTION]), resting


def _by_kind(moving: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """[kinds] log of the summed evidence of each kind's optima."""
    return np.array([np.logaddexp.reduce(moving[kind == k]) for k in range(kind.max() + 1)])


def _by_parts(likelihood: ManhattanLikelihood, best: np.ndarray, still: np.ndarray) -> tuple[float, float, float]:
    """Returns breadth, against and in_favour, as defined in :class:`Posterior`."""
    moving, resting = likelihood.of_segments(np.stack([best, still]))
    for_motion = moving - resting
    parts = np.bincount(likelihood.part, for_motion)
    breadth = parts.sum() / math.sqrt(1 + (parts**2).sum())
    against = -parts[parts < 0].sum() / (1 + np.abs(parts).sum())
    return float(breadth), float(against), float((for_motion > 0).mean())


def _pose(likelihood: ManhattanLikelihood, unknowns: np.ndarray) -> Pose:
    expected = likelihood.prior.mean[LOG_FOCAL]
    return Pose(float(unknowns[ROLL]), float(unknowns[TILT]), float(unknowns[LOG_FOCAL] - expected))


def evidence_of(likelihood: ManhattanLikelihood, motions: np.ndarray, poses: int = 2) -> Float64[np.ndarray, "motions"]:
    """Returns the log evidence for each of the given motions, with equal priors [nats].

    Args:
        likelihood: likelihood of one photo, without a speed limit.
        motions: [M, 6] coefficients.
        poses: number of starting cameras for each.
    """
    begin = [_poses(likelihood, motion, poses) for motion in motions]
    _, energy, hessian = descend(likelihood, np.concatenate(begin), CAMERA)
    evidence = -energy - 0.5 * np.linalg.slogdet(hessian[:, CAMERA, CAMERA])[1]
    edges = np.cumsum([0, *(len(each) for each in begin)])
    best = np.array([evidence[a:b].max() for a, b in pairwise(edges)])
    return best + likelihood.prior.of_motions(motions)


def descend(
    likelihood: ManhattanLikelihood,
    begin: np.ndarray,
    free: slice | np.ndarray,
    kind: np.ndarray | None = None,
    steps: int = 40,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Runs Levenberg-Marquardt from all starts at once; mixture weights are updated at every step (EM).

    Args:
        likelihood: the energy to minimise.
        begin: [S, 10] starts.
        free: the unknowns that may change: for all starts, or [S, 10] for each.
        kind: [S] index of each motion's kind in the prior; the first by default.
        steps: maximum number of steps.

    Returns:
        Unknowns [S, 10], energies [S], Hessians [S, 10, 10].
    """
    at, may_change = begin.copy(), np.zeros(begin.shape, bool)
    if isinstance(free, slice):
        may_change[:, free] = True
    else:
        may_change |= free
    camera_only = not may_change[:, MOTION].any()
    kind = np.zeros(len(at), int) if kind is None else kind
    energy, gradient, hessian = likelihood.expanded(at, kind, camera_only)
    damping = np.full(len(at), 1e-3)
    going = np.arange(len(at))
    for _ in range(steps):
        matrix = _with_fixed(hessian[going], may_change[going])
        matrix[:, _DIAGONAL, _DIAGONAL] *= 1 + damping[going, None]
        step = -np.linalg.solve(matrix, (gradient[going] * may_change[going])[..., None])[..., 0]
        tried = at[going] + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        new_energy, new_gradient, new_hessian = likelihood.expanded(tried, kind[going], camera_only)
        gain = energy[going] - new_energy
        better = gain > 0
        moved = going[better]
        at[moved], energy[moved] = tried[better], new_energy[better]
        gradient[moved], hessian[moved] = new_gradient[better], new_hessian[better]
        damping[going] *= np.where(better, 0.2, 8.0)
        arrived = (better & (gain < _LEAST_GAIN)) | (damping[going] > 1e4)
        going = going[~arrived]
        if not len(going):
            break
    return at, energy, hessian


def _with_fixed(hessian: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Returns Hessians [S, 10, 10] with rows of the identity for unknowns that are not free [S, 10]."""
    return np.where(free[:, :, None] & free[:, None, :], hessian, np.eye(UNKNOWNS))


def _poses(likelihood: ManhattanLikelihood, motion: np.ndarray, count: int) -> np.ndarray:
    """[count, 10] the cameras of a grid that best fit a motion, with distinct yaws."""
    expected = likelihood.prior.mean
    tilts = _TILTS if likelihood.known.tilt is None else [expected[TILT]]
    yaw, tilt, log_focal = (a.ravel() for a in np.meshgrid(_YAWS, tilts, _LOG_FOCALS))
    grid = np.zeros((len(yaw), UNKNOWNS))
    grid[:, MOTION] = motion
    grid[:, YAW], grid[:, TILT] = yaw, tilt
    grid[:, ROLL] = expected[ROLL]
    grid[:, LOG_FOCAL] = expected[LOG_FOCAL] + log_focal
    kept: list[int] = []
    for k in np.argsort(likelihood.energy(grid), kind="stable"):
        apart = [(yaw[k] - yaw[j] + math.pi / 4) % (math.pi / 2) - math.pi / 4 for j in kept]
        if all(abs(angle) > _OTHER_YAW for angle in apart):
            kept.append(int(k))
        if len(kept) == count:
            break
    return grid[kept]


def _distinct(hypotheses: np.ndarray, energy: np.ndarray) -> list[int]:
    """Returns one index per distinct optimum, the best first: several starts may lead to the same one."""
    kept: list[int] = []
    for k in np.argsort(energy, kind="stable"):
        if all(displacement(hypotheses[k, MOTION] - hypotheses[j, MOTION]) > _SAME for j in kept):
            kept.append(int(k))
    return kept
