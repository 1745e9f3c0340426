import numpy as np
import pytest

from support.covering import covering, thorough
from support.gradients import check_jacobian
from support.line_scenes import (
    FOCAL,
    HEIGHT,
    QUADRATIC,
    WIDTH,
    U,
    check_exact,
    motion_of,
    seen_curves,
    share_left,
    turning,
)
from unshutter.motion import RotationMotion
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.methods.curves import forward_differences
from unshutter_lab.methods.rengarajan2016 import DEGREE, Costs, fit_rotations, polynomial_rotations


def bow_motion(curves: np.ndarray) -> RotationMotion:
    found = fit_rotations(curves, HEIGHT, WIDTH, FOCAL)
    assert found is not None
    return motion_of(polynomial_rotations(found, U))


@pytest.mark.parametrize(
    ("degrees", "seed"), covering([((0, 5, 0),), QUADRATIC, ((-1, -3, 2), (1, 6, -4), (1, -2, 2))], [0, 1])
)
def test_bows_are_straightened_exactly(degrees, seed: int) -> None:
    truth = turning(*degrees)
    check_exact(bow_motion(seen_curves(truth, seed)), truth)


@pytest.mark.parametrize(
    ("noise", "clutter", "left"), [thorough(0.3, 0.0, 0.15), thorough(0.3, 0.4, 0.2), (1.0, 0.4, 0.35)]
)
def test_bows_with_noise_and_clutter(noise: float, clutter: float, left: float) -> None:
    truth = turning(*QUADRATIC)
    for seed in range(3):
        assert share_left(bow_motion(seen_curves(truth, seed, noise=noise, clutter=clutter)), truth) < left


def test_bows_leave_still_scenes_still() -> None:
    found = bow_motion(seen_curves(turning((0, 0, 0)), 0, noise=0.3, clutter=0.4))
    assert motion_error(found, found.scaled(0)).epe < 1


def test_the_gradient_of_the_cost() -> None:
    """Of the residuals' Jacobian and the loss's weights, as least squares uses them."""
    costs = Costs(seen_curves(turning(*QUADRATIC), 0, count=20, noise=0.3), HEIGHT, WIDTH, FOCAL)
    residuals, loss = costs.residuals, costs.loss
    at = np.random.default_rng(0).normal(0, 0.02, DEGREE * 3)
    r = residuals(at)
    gradient = 2 * (loss(r)[1] * r) @ forward_differences(residuals, at, r, np.full(len(at), 1e-7))
    check_jacobian(lambda x: loss(residuals(x))[0].sum(), at, gradient, rtol=1e-3, atol=0.1)
