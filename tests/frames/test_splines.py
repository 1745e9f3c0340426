"""Splines: a basis that sums to one and draws straight lines, and a solver that agrees with NumPy's."""

import numpy as np
import pytest

from unshutter.frames.smoothing import basis, log_determinant, roughness, solve_banded


def test_splines_sum_to_one_and_hold_straight_lines():
    at = np.linspace(0, 5, 41)
    values = basis(at, 8)
    assert values.sum(axis=1) == pytest.approx(1)
    assert values @ (2.0 * np.arange(8) + 1) == pytest.approx(2 * at + 3)  # their middles lie one interval later


def test_only_what_bends_is_rough():
    straight, bent = np.arange(9.0), np.arange(9.0) ** 2
    assert straight @ roughness(9) @ straight == pytest.approx(0)
    assert bent @ roughness(9) @ bent == pytest.approx(7 * 4)


@pytest.mark.parametrize("size", [5, 6, 17])
def test_banded_systems_are_solved(size):
    rng = np.random.default_rng(size)
    factor = np.tril(np.triu(rng.normal(size=(size, size)), -2)) + 3 * np.eye(size)
    matrix, right = factor @ factor.T, rng.normal(size=size)
    solution, left = solve_banded(matrix, np.stack([right, 2 * right], axis=1), block=3)
    expected = np.linalg.solve(matrix, right)
    assert solution == pytest.approx(np.stack([expected, 2 * expected], axis=1))
    assert log_determinant(left) == pytest.approx(np.linalg.slogdet(matrix)[1])


def test_a_system_that_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        log_determinant(solve_banded(-np.eye(4), np.ones((4, 1)), block=2)[1])
