"""Fits the distributions of motions, drawn and recorded, and of the network's errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.estimators.right_angles.beliefs import NORMAL, MotionKind
from unshutter.estimators.right_angles.calibration import NetworkErrors
from unshutter.estimators.right_angles.posterior import bend, displacement
from unshutter.motion import Motion
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import draw_from_trajectory, draw_quadratic

FREEDOM = 3.0  # few: occasionally a hand moves much faster, or a network errs much more
USUAL_PX = 25.0  # of 256 rows: larger estimates of the network have larger errors
READOUTS_S = (0.02, 0.05, 0.1)  # of recorded motions: phones, cameras with electronic shutters
SHARES = {"quadratic": 0.2, "hand": 0.6, "pan": 0.2}  # priors, chosen on validation photos
_DRAWS = 2000  # of quadratic motions
_WINDOWS = 150  # per log and readout time
_EVEN = 0.15  # largest share of a pan's displacement that remains after removing its best shear
_ROWS, _FOCAL_PX = 256, 256.0
_LEAST_CUBIC = 0.01  # least cubic coefficient of drawn quadratics, so that their distribution has a density
_MEDIAN_OF_NORMAL = 0.6745  # of the absolute value, in standard deviations
_MOST_STEPS = 1000
_ARRIVED = 1e-10  # relative change of a step


def fit_motion_kinds(logs: Sequence[Path], seed: int) -> tuple[MotionKind, ...]:
    """Fits the priors of motions: benchmarks' quadratics, and recorded hand motion.

    Shake: all windows of the logs. Pans: windows that are little more than a shear; the shape of their distribution
    is that of all such windows together, its scale that of the median one.

    Args:
        logs: recorded camera rotations.
        seed: seed of the draws.

    Raises:
        UnshutterError: the logs hold too few motions.
    """
    rng = np.random.default_rng(seed)
    drawn = np.array([coefficients_of(draw_quadratic(rng).crop) for _ in range(_DRAWS)])
    quadratic = drawn.T @ drawn / len(drawn) + np.diag([0, 0, _LEAST_CUBIC**2] * 2)
    recorded = _windows(logs, rng)
    sizes = np.array([displacement(motion) for motion in recorded])
    even = np.array([bend(motion) for motion in recorded]) < _EVEN * sizes
    if even.sum() < 2 * recorded.shape[1]:
        raise UnshutterError(f"the recorded motions hold {even.sum()} even pans: too few to tell how hands move")
    shape = recorded[even].T @ recorded[even] / (sizes[even] ** 2).sum()
    pan = shape * (np.median(sizes[even]) / _MEDIAN_OF_NORMAL) ** 2
    scales = {"quadratic": (quadratic, NORMAL), "hand": (student_scale(recorded), FREEDOM), "pan": (pan, NORMAL)}
    return tuple(MotionKind(name, scale, freedom, SHARES[name]) for name, (scale, freedom) in scales.items())


def fit_network_errors(errors: np.ndarray, sizes_px: np.ndarray) -> NetworkErrors:
    """Returns the maximum-likelihood scales and correlations of the network's errors.

    Args:
        errors: [N, 6] estimates minus true coefficients.
        sizes_px: [N] root mean square displacement of each estimate [px of 256 rows].
    """
    scale = student_scale(errors / np.sqrt(1 + (sizes_px / USUAL_PX) ** 2)[:, None])
    return NetworkErrors(FREEDOM, *scales_and_correlations(scale), USUAL_PX)


def student_scale(values: np.ndarray) -> np.ndarray:
    """Returns the maximum-likelihood [D, D] scale matrix of Student's t around zero, for values [N, D]."""
    scale = values.T @ values / len(values)
    for _ in range(_MOST_STEPS):  # expectation maximisation
        squares = np.einsum("ni,ij,nj->n", values, np.linalg.inv(scale), values)
        weights = (FREEDOM + scale.shape[0]) / (FREEDOM + squares)
        before, scale = scale, (weights[:, None] * values).T @ values / len(values)
        if np.abs(scale - before).max() <= _ARRIVED * np.abs(scale).max():
            break
    return scale


def scales_and_correlations(scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Splits a scale matrix as in the file, so that cases are searched with the shipped precision."""
    scales = np.sqrt(np.diag(scale))
    correlations = np.round(scale / np.outer(scales, scales), 3)
    return np.array([float(f"{each:.4g}") for each in scales]), correlations


def coefficients_of(motion: Motion) -> np.ndarray:
    """[6] of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad], from a least-squares fit."""
    u = (np.arange(motion.height) + 0.5) / motion.height
    powers = np.stack([u, u**2, u**3], axis=1)
    tx, rz = (np.linalg.lstsq(powers - powers[0], a, rcond=None)[0] for a in (motion.tx_px, motion.rz_rad))
    return np.concatenate([tx / motion.height, rz])


def _windows(logs: Sequence[Path], rng: np.random.Generator) -> np.ndarray:
    """[N, 6] motions in windows of the logs, equally many per log and readout time."""
    canvas = _ROWS + 2  # little more than the rows used
    found = [
        coefficients_of(draw_from_trajectory(rng, log, readout_s, _FOCAL_PX, _ROWS, canvas).crop)
        for log in map(RotationLog.load, logs)
        for readout_s in READOUTS_S
        for _ in range(_WINDOWS)
    ]
    return np.array(found)
