"""Derivatives compared with differences."""

from collections.abc import Callable

import numpy as np


def check_jacobian(
    value: Callable[[np.ndarray], np.ndarray],
    at: np.ndarray,
    jacobian: np.ndarray,
    step: float = 1e-6,
    rtol: float = 1e-5,
    atol: float = 1e-6,
) -> None:
    """Passes where a Jacobian is that of a function, by central differences.

    Args:
        value: unknowns [..., P] -> [shape], whatever it is.
        at: [..., P]; leading dimensions are hypotheses that do not know each other, and lead in the shape, too.
        jacobian: [shape, P], derivatives of the value there.
        step: by which each unknown is changed, to both sides.
        rtol, atol: how far the two may differ.
    """
    for k in range(at.shape[-1]):
        change = step * np.eye(at.shape[-1])[k]
        differences = (value(at + change) - value(at - change)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., k], differences, rtol=rtol, atol=atol, err_msg=f"unknown {k}")
