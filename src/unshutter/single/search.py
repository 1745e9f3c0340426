"""Searches for the most probable motions under the Manhattan likelihood, from many starts, weighted by evidence.

Coefficients of motions are those of prior.py: of u, u^2, u^3 in t_x [rows] and in r_z [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unshutter.motion.shapes import Float64
from unshutter.single.likelihood import ManhattanLikelihood
from unshutter.single.prior import CAMERA, LOG_FOCAL, MOTION, ROLL, TILT, UNKNOWNS, YAW

PX = 256.0  # rows of the reference picture for displacements and calibration


@dataclass(frozen=True, eq=False)
class Optima:
    """The motions at the local maxima of the posterior."""

    motions: np.ndarray  # [K, 6] coefficients
    covariances: np.ndarray  # [K, 6, 6] of each maximum
    kind: np.ndarray  # [K] index of the kind of motion
    share: np.ndarray  # [K] posterior probability, given that the camera moved


@dataclass(frozen=True)
class Posterior:
    """The posterior of the motion given the segments and priors, with evidence on whether there was any."""

    # [6] coefficients of u, u^2, u^3 of t_x [rows] and r_z [rad]: the mean, given that the camera moved
    motion: np.ndarray
    covariance: np.ndarray  # [6, 6] covariance of the coefficients
    optima: Optima  # optima for all kinds of motion
    kinds: dict[str, float]  # name of each kind of motion -> its posterior probability, given that the camera moved
    # name of each kind -> log evidence for it against a camera at rest, with equal priors [nats]
    evidence_of: dict[str, float]
    evidence: float  # log evidence for any motion against a camera at rest [nats]. It is overstated, see candidates.py.
    # log-likelihood ratio of the segments at the best optimum against chance [nats per unit of weight]
    lines_gain: float
    weight: float  # total weight of the segments: their number of independent observations
    gain_at_rest: float  # lines_gain of no motion, with its best camera
    # how evenly the picture's parts support motion: the sum of each part's evidence [nats] divided by the root of the
    # sum of squares; 4 if all sixteen agree, negative if they oppose it
    breadth: float
    against: float  # share of the parts' evidence that opposes motion
    in_favour: float  # share of the segments that fit better with motion
    # [4] best camera for the best motion: roll (clockwise rotation of the scene) and upward tilt [rad], logarithm of
    # the ratio of the focal length to the expected one, yaw against the streets [rad]
    pose: np.ndarray
    pose_at_rest: np.ndarray  # [4] best camera for no motion

    @property
    def expected_error(self) -> float:
        """Root mean square distance [rows] between the mean's picture and the true one, over a square picture."""
        return expected_error(self.covariance)

    @property
    def size(self) -> float:
        """Root mean square displacement [rows] of a square picture by the motion."""
        return displacement(self.motion)


def mixture_moments(share: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean [6] and covariance [6, 6] of a Gaussian mixture: shares [K], means [K, 6], covariances [K, 6, 6]."""
    mean = share @ means
    apart = means - mean
    return mean, np.einsum("k,kij->ij", share, covariances + apart[:, :, None] * apart[:, None, :])


def displacement(motion: np.ndarray) -> float:
    """Returns the root mean square displacement [rows] of a square picture by a motion [6], to first order."""
    return math.sqrt(max(float(motion @ _SQUARED_DISPLACEMENT @ motion), 0.0))


def expected_error(covariance: np.ndarray) -> float:
    """Returns the root mean square displacement [rows] of a square picture by motions [6] of this covariance."""
    return math.sqrt(max(float(np.sum(_SQUARED_DISPLACEMENT * covariance)), 0.0))


def bend(motion: np.ndarray) -> float:
    """Returns the RMS displacement of a motion [6] after removing its best shear, which resembles a tilted camera."""
    motion = motion.copy()
    motion[0] -= _SQUARED_DISPLACEMENT[0] @ motion / _SQUARED_DISPLACEMENT[0, 0]
    return displacement(motion)


def _squared_displacement() -> np.ndarray:
    """D [6, 6]: motion @ D @ motion is the mean squared displacement [rows^2] of a square picture."""
    row = np.linspace(-0.5, 0.5, 65)
    powers = (row[:, None] + 0.5) ** np.arange(1, 4)
    J_col = np.concatenate([powers, -row[:, None] * powers], axis=1)  # t_x - row r_z
    J_row = np.concatenate([0 * powers, powers / math.sqrt(12)], axis=1)  # col r_z; mean squared column: 1 / 12
    return (J_col.T @ J_col + J_row.T @ J_row) / len(row)


_SQUARED_DISPLACEMENT = _squared_displacement()


_YAWS = np.arange(9) * (math.pi / 2 / 9)
_TILTS = np.radians([-8, 0, 8, 18, 32])
_LOG_FOCALS = np.array([-0.35, 0.25])  # relative to the expected one
_DIAGONAL = np.arange(UNKNOWNS)


@dataclass(frozen=True)
class SearchParams:
    """How far the posterior is searched (docs/research/own-model-search.md)."""

    cameras: int = 2  # starting poses for one motion,
    other_yaw: float = 0.2  # which are this far apart [rad]
    first_steps: int = 10  # of every start;
    followed: int = 4  # only this many of the best continue, as motions of each kind
    temper: float = 0.25  # of the evidence for one kind against another: segments' errors are correlated
    longest_step: float = 0.3
    least_gain: float = 1e-3  # of a step [nats]; smaller gains end the search
    same: float = 0.3 / 256  # rows: optima closer than this are merged


_SEARCH = SearchParams()


def explore(likelihood: ManhattanLikelihood, motions: Sequence[np.ndarray]) -> Posterior:
    """Finds the optima near the given motions, searching the camera's pose for each.

    Args:
        motions: [6] coefficients each, to start from; zero motion is always included.
    """
    begin = np.concatenate([poses(likelihood, motion) for motion in (np.zeros(6), *motions)])
    (hypotheses, kind, moving, covariances), at_rest, still = _optima(likelihood, begin, begin[: _SEARCH.cameras])
    each = np.array([np.logaddexp.reduce(moving[kind == k]) for k in range(kind.max() + 1)])  # evidence of the kinds
    log_shares = np.log([known.share for known in likelihood.prior.kinds])  # prior
    tempered = _SEARCH.temper * each + log_shares
    share = np.exp(moving - each[kind] + (tempered - np.logaddexp.reduce(tempered))[kind])
    # the posterior of the motion is a mixture of Gaussians, one for each optimum
    optima = Optima(hypotheses[:, MOTION], covariances, kind, share)
    mean, covariance = mixture_moments(share, optima.motions, covariances)
    best = hypotheses[np.argmax(share)]
    with_motion, at_rest_too = likelihood.of_segments(np.stack([best, still]))
    for_motion = with_motion - at_rest_too
    parts = np.bincount(likelihood.part, for_motion)
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
        breadth=float(parts.sum() / math.sqrt(1 + (parts**2).sum())),
        against=float(-parts[parts < 0].sum() / (1 + np.abs(parts).sum())),
        in_favour=float((for_motion > 0).mean()),
        pose=best[CAMERA] - _expected(likelihood),
        pose_at_rest=still[CAMERA] - _expected(likelihood),
    )


def _optima(
    likelihood: ManhattanLikelihood, begin: np.ndarray, cameras: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], float, np.ndarray]:
    """Returns the optima of every kind of motion, and without motion the log evidence [nats] and the best camera [10].

    The optima are unknowns [K, 10], kinds [K], log evidence [K] (Laplace's approximation) and covariances of the motion
    [K, 6, 6].

    Kinds share their first steps, with the prior of the first one, which is the widest. The rest is searched together
    with the cameras at rest, since a few more hypotheses cost little.
    """
    tried, energy, _ = descend(likelihood, begin, slice(0, UNKNOWNS), steps=_SEARCH.first_steps)
    promising = tried[_distinct(tried, energy)[: _SEARCH.followed]]
    count = len(likelihood.prior.kinds)
    kind = np.repeat(np.arange(count), len(promising))
    starts = np.concatenate([np.tile(promising, (count, 1)), cameras])
    moving = slice(0, len(kind))
    at_rest = slice(len(kind), None)
    free = np.ones(starts.shape, bool)
    free[at_rest, MOTION] = False
    optima = descend(likelihood, starts, free, np.concatenate([kind, np.zeros(len(cameras), int)]))
    still, energy, hessian = (each[at_rest] for each in optima)
    best = int(np.argmin(energy))
    evidence_at_rest = float(-energy[best] - 0.5 * np.linalg.slogdet(hessian[best, CAMERA, CAMERA])[1])
    hypotheses, energy, hessian = (each[moving] for each in optima)
    kept = np.concatenate(
        [np.flatnonzero(kind == k)[_distinct(hypotheses[kind == k], energy[kind == k])] for k in range(count)]
    )
    hypotheses = hypotheses[kept]
    kind = kind[kept]
    hessian = hessian[kept]
    log_evidence = likelihood.prior.log_volume[kind] - energy[kept] - 0.5 * np.linalg.slogdet(hessian)[1]
    covariances = np.linalg.inv(hessian)[:, MOTION, MOTION]
    return (hypotheses, kind, log_evidence, covariances), evidence_at_rest, still[best]


def _expected(likelihood: ManhattanLikelihood) -> np.ndarray:
    """[4] the reference of a camera's pose: the expected focal length; zero for the angles and the yaw."""
    return np.array([0.0, 0.0, likelihood.prior.mean[LOG_FOCAL], 0.0])


def cameras_for(
    likelihood: ManhattanLikelihood, motions: np.ndarray, near: Sequence[np.ndarray]
) -> Float64[np.ndarray, "motions 4"]:
    """Returns the most probable camera (roll, tilt, log focal length, yaw) given each of the motions [M, 6].

    The search for each begins at a pose [4] that roughly fits.
    """
    cameras = np.stack(near) + _expected(likelihood)
    return descend(likelihood, np.concatenate([motions, cameras], axis=1), CAMERA)[0][:, CAMERA]


def descend(
    likelihood: ManhattanLikelihood,
    begin: np.ndarray,
    free: slice | np.ndarray,
    kind: np.ndarray | None = None,
    steps: int = 40,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Runs Levenberg-Marquardt from all starts at once; mixture weights are updated at every step (EM).

    Args:
        free: the unknowns that may change: for all starts, or [S, 10] for each.
        kind: [S] index of each motion's kind in the prior; the first by default.

    Returns:
        Unknowns [S, 10], energies [S], Hessians [S, 10, 10].
    """
    at = begin.copy()
    may_change = np.zeros(begin.shape, bool)
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
        free_now = may_change[going]
        matrix = np.where(free_now[:, :, None] & free_now[:, None, :], hessian[going], np.eye(UNKNOWNS))
        matrix[:, _DIAGONAL, _DIAGONAL] *= 1 + damping[going, None]
        step = -np.linalg.solve(matrix, (gradient[going] * free_now)[..., None])[..., 0]
        tried = at[going] + np.clip(step, -_SEARCH.longest_step, _SEARCH.longest_step)
        new_energy, new_gradient, new_hessian = likelihood.expanded(tried, kind[going], camera_only)
        gain = energy[going] - new_energy
        better = gain > 0
        moved = going[better]
        at[moved] = tried[better]
        energy[moved] = new_energy[better]
        gradient[moved] = new_gradient[better]
        hessian[moved] = new_hessian[better]
        damping[going] *= np.where(better, 0.2, 8.0)
        arrived = (better & (gain < _SEARCH.least_gain)) | (damping[going] > 1e4)
        going = going[~arrived]
        if not len(going):
            break
    return at, energy, hessian


def poses(likelihood: ManhattanLikelihood, motion: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """Returns [cameras, 10] unknowns: the cameras of a grid, rolled by this much more [rad], that best fit a motion."""
    expected = likelihood.prior.mean
    tilts = _TILTS if likelihood.known.tilt is None else [expected[TILT]]
    yaw, tilt, log_focal = (a.ravel() for a in np.meshgrid(_YAWS, tilts, _LOG_FOCALS))
    grid = np.zeros((len(yaw), UNKNOWNS))
    grid[:, MOTION] = motion
    grid[:, YAW], grid[:, TILT] = yaw, tilt
    grid[:, ROLL] = expected[ROLL] + roll
    grid[:, LOG_FOCAL] = expected[LOG_FOCAL] + log_focal
    kept: list[int] = []
    for k in np.argsort(likelihood.energy(grid), kind="stable"):
        apart = [(yaw[k] - yaw[j] + math.pi / 4) % (math.pi / 2) - math.pi / 4 for j in kept]
        if all(abs(angle) > _SEARCH.other_yaw for angle in apart):
            kept.append(int(k))
        if len(kept) == _SEARCH.cameras:
            break
    return grid[kept]


def _distinct(hypotheses: np.ndarray, energy: np.ndarray) -> list[int]:
    """Returns one index per distinct optimum, the best first: several starts may lead to the same one."""
    kept: list[int] = []
    for k in np.argsort(energy, kind="stable"):
        if all(displacement(hypotheses[k, MOTION] - hypotheses[j, MOTION]) > _SEARCH.same for j in kept):
            kept.append(int(k))
    return kept
