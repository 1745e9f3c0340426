"""Skew and stretch that depth adds, as unknowns: eliminated pair by pair, they give what one large system gives."""

import numpy as np
import pytest

from unshutter.frames.parallax import PairShapes

PAIRS, MOST, LOCAL, UNKNOWNS, SPREAD, REMAINDER = 6, 30, 3, 4, 0.05, 0.01


def test_elimination_gives_the_solution_of_the_whole_system():
    rng = np.random.default_rng(0)
    at = rng.uniform(-1, 1, (PAIRS, MOST, 2))
    jacobian = rng.normal(size=(PAIRS, MOST, 2, UNKNOWNS))
    moved = rng.normal(size=(PAIRS, MOST, 2))
    spline = rng.normal(size=(PAIRS, MOST, LOCAL))
    weights = rng.uniform(size=(PAIRS, MOST))
    shapes = PairShapes.of(at, jacobian, rng.normal(size=(PAIRS, 2)), np.arange(PAIRS) + 0.5)
    found = shapes.eliminated(weights, spline, SPREAD, moved)
    size = LOCAL * UNKNOWNS
    prior = np.eye(size * PAIRS)  # each pair has coefficients of its own
    places = np.arange(size * PAIRS).reshape(PAIRS, size)
    matrix, right, whole = prior.copy(), np.zeros(size * PAIRS), []
    for k in range(PAIRS):
        rows = (spline[k][:, None, :, None] * jacobian[k][:, :, None, :]).reshape(2 * MOST, size)
        weight = np.repeat(weights[k], 2)
        matrix[np.ix_(places[k], places[k])] += rows.T @ (weight[:, None] * rows) - found.normal()[k]
        right[places[k]] += rows.T @ (weight * moved[k].ravel()) - found.right()[k]
        x, y = at[k].T
        depth = np.stack([np.stack([y, -x], -1), np.stack([x, y], -1)], -2).reshape(2 * MOST, 2) / 2
        whole.append((rows, depth, weight))
    solution = found.solved(matrix, right, places, size)
    columns = shapes.follows.shape[1]
    total = size * PAIRS + 2 * PAIRS + 2 * columns  # coefficients, remainders, b
    large = np.zeros((total, total))
    large[: size * PAIRS, : size * PAIRS] = prior
    large[-2 * columns :, -2 * columns :] = found.prior
    side = np.zeros(total)
    for k, (rows, depth, weight) in enumerate(whole):
        row = np.zeros((2 * MOST, total))
        row[:, places[k]] = rows
        row[:, size * PAIRS + 2 * k : size * PAIRS + 2 * k + 2] = depth
        row[:, -2 * columns :] = depth @ np.kron(shapes.follows[k], np.eye(2))
        large += row.T @ (weight[:, None] * row)
        side += row.T @ (weight * moved[k].ravel())
        remainder = slice(size * PAIRS + 2 * k, size * PAIRS + 2 * k + 2)
        large[remainder, remainder] += np.eye(2) / REMAINDER**2
    expected = np.linalg.solve(large, side)
    assert solution.unknowns == pytest.approx(expected[: size * PAIRS])
    assert solution.shapes is not None
    followed = shapes.follows @ expected[-2 * columns :].reshape(-1, 2)
    assert solution.shapes == pytest.approx(followed + expected[size * PAIRS : -2 * columns].reshape(-1, 2))
