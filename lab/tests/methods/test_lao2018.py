import numpy as np
import pytest

from support.covering import covering, thorough
from support.gradients import check_jacobian
from support.line_scenes import (
    FOCAL,
    HEIGHT,
    WIDTH,
    U,
    check_drawn_picture,
    check_exact,
    check_nothing_is_done_without_lines,
    motion_of,
    seen_curves,
    share_left,
    turning,
)
from unshutter.motion import RotationMotion
from unshutter_lab.methods.lao2018 import _loss, fit_velocity


def uniform_motion(curves: np.ndarray) -> RotationMotion:
    found = fit_velocity(curves, HEIGHT, WIDTH, FOCAL)
    assert found is not None
    return motion_of(U[:, None] * found)


@pytest.mark.parametrize(("degrees", "clutter"), covering([(2, 5, 6), (-3, -4, 4), (0, 0, -8)], [0.0, 0.4]))
def test_the_velocity_is_found_exactly(degrees: tuple[float, float, float], clutter: float) -> None:
    truth = turning(degrees)
    check_exact(uniform_motion(seen_curves(truth, 0, clutter=clutter)), truth)


def test_four_curves_are_enough_for_the_velocity() -> None:
    truth = turning((1, 2, 5))
    check_exact(uniform_motion(seen_curves(truth, 3, count=4)), truth)


def test_the_velocity_with_noise_and_clutter() -> None:
    """What lines show well (z) stays right; what they hardly show (x, y) is held back, not made up."""
    for seed in range(3):
        truth = turning((1, 2, 6))
        found = uniform_motion(seen_curves(truth, seed, noise=0.3, clutter=0.4))
        assert abs(np.degrees(found.rotations - truth.rotations)[-1, 2]) < 1
        assert share_left(found, truth) < 1


def test_weights_are_the_slope_of_the_cost() -> None:
    r = np.array([0.5, -2.0, 3.0, 0.5, -2.0, 3.0])  # of the motion, then of distances
    check_jacobian(lambda x: _loss(x)[0], r, np.diag(2 * _loss(r)[1] * r))
    assert _loss(r)[0][2] == 9 > _loss(r)[0][5]  # only distances have outliers


@pytest.mark.parametrize(("degrees", "left"), [(((0, 0, 7),), 0.15), thorough(((0, 0, -5),), 0.15)])
def test_a_drawn_picture_goes_through_the_detector(degrees, left: float) -> None:
    check_drawn_picture("lao2018", degrees, left)


def test_without_lines_nothing_is_done_and_said_why() -> None:
    check_nothing_is_done_without_lines("lao2018")
