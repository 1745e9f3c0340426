import numpy as np
import pytest

from support.covering import covering
from support.line_scenes import (
    FOCAL,
    HEIGHT,
    WIDTH,
    U,
    check_exact,
    motion_of,
    seen_curves,
    share_left,
    turning,
)
from unshutter.motion import RotationMotion
from unshutter_lab.methods.lao2018 import fit_velocity


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
