"""The equations of a spline of turns equal those of the whole design matrix."""

import numpy as np
import pytest

from unshutter.frames.camera import RotationEquations, student_weights

PAIRS, MOST, LOCAL, UNKNOWNS = 3, 20, 6, 4


@pytest.fixture
def equations():
    rng = np.random.default_rng(0)
    spline, jacobian = rng.normal(size=(PAIRS, MOST, LOCAL)), rng.normal(size=(PAIRS, MOST, 2, UNKNOWNS))
    return RotationEquations(spline, jacobian, np.ones((PAIRS, MOST)))


MOVED = np.random.default_rng(3).normal(size=(PAIRS, MOST, 2))


def design(equations):
    whole = equations.spline[:, :, None, :, None] * equations.jacobian[:, :, :, None, :]
    return whole.reshape(PAIRS, 2 * MOST, LOCAL * UNKNOWNS)


def test_normal_equations_are_those_of_the_design_matrix(equations):
    weights = np.random.default_rng(1).uniform(size=(PAIRS, MOST))
    weighted = design(equations) * np.repeat(weights, 2, axis=1)[..., None]
    matrix, right = equations.normal(weights, MOVED)
    assert matrix == pytest.approx(weighted.swapaxes(1, 2) @ design(equations))
    assert right == pytest.approx((weighted * MOVED.reshape(PAIRS, -1, 1)).sum(axis=1))


def test_distances_are_those_of_the_design_matrix(equations):
    coefficients = np.random.default_rng(2).normal(size=(PAIRS, LOCAL, UNKNOWNS))
    off = MOVED.reshape(PAIRS, -1) - (design(equations) @ coefficients.reshape(PAIRS, -1, 1))[..., 0]
    assert equations.left(coefficients, MOVED) == pytest.approx(off.reshape(PAIRS, MOST, 2))


def test_outliers_and_places_without_a_track_do_not_pull():
    squared = np.full((1, 30), 0.01)
    squared[0, 0], used = 100.0, np.ones((1, 30), bool)
    used[0, 1] = False
    weights, noise = student_weights(squared, used, np.nan)
    assert weights[0, 1] == 0 and weights[0, 0] < weights[0, 2] / 100
    assert noise == pytest.approx(np.sqrt(0.01 / 2), rel=0.3)
