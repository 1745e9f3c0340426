"""Errors of the network's answers: Student's t distribution, fitted to photos with known motions."""

from __future__ import annotations

import numpy as np

from unshutter.estimators.right_angles.calibration import NetworkErrors

FREEDOM = 3.0  # few, so that strong evidence overrules the network
USUAL_PX = 25.0  # of 256 rows: the larger the network's answer, the more it errs
_MOST_STEPS = 1000
_ARRIVED = 1e-10  # relative change of a step


def fit_network_errors(errors: np.ndarray, sizes_px: np.ndarray) -> NetworkErrors:
    """The scales and correlations under which the errors are likeliest.

    Args:
        errors: [N, 6] answers less true coefficients.
        sizes_px: [N] root mean square displacement of each answer [px of 256 rows].
    """
    standard = errors / np.sqrt(1 + (sizes_px / USUAL_PX) ** 2)[:, None]
    scale = standard.T @ standard / len(standard)
    for _ in range(_MOST_STEPS):  # expectation and maximisation
        squares = np.einsum("ni,ij,nj->n", standard, np.linalg.inv(scale), standard)
        weights = (FREEDOM + scale.shape[0]) / (FREEDOM + squares)
        before, scale = scale, (weights[:, None] * standard).T @ standard / len(standard)
        if np.abs(scale - before).max() <= _ARRIVED * np.abs(scale).max():
            break
    scales = np.sqrt(np.diag(scale))
    # as the file has them, so that all cases are searched with the scales that are shipped
    correlations = np.round(scale / np.outer(scales, scales), 3)
    return NetworkErrors(FREEDOM, np.array([float(f"{each:.4g}") for each in scales]), correlations, USUAL_PX)
