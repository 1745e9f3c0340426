"""The median and the small least-squares problems of robust fits, against NumPy's."""

import numpy as np
import pytest

from unshutter.motion.robust import median, weighted_least_squares

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("size", [1, 2, 7, 8])
def test_medians_are_numpys(size):
    values = RNG.normal(size=(3, size))
    np.testing.assert_array_equal(median(values), np.median(values, axis=-1))
    padded = np.concatenate([values, np.full((3, 4), np.inf)], axis=1)
    np.testing.assert_array_equal(median(padded, np.full(3, size)), np.median(values, axis=-1))


def test_small_problems_are_solved_all_at_once():
    rows = RNG.normal(size=(4, 30, 3))
    values = RNG.normal(size=(4, 30))
    weights = RNG.uniform(size=(4, 30))
    for case, found in enumerate(weighted_least_squares(rows, values, weights)):
        root = np.sqrt(weights[case])
        expected = np.linalg.lstsq(rows[case] * root[:, None], values[case] * root, rcond=None)[0]
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_unknowns_that_rows_do_not_determine_are_small():
    rows = np.stack([np.ones(20), np.zeros(20), np.ones(20)], axis=1)  # the second counts nowhere, the third twice
    first, second, third = weighted_least_squares(rows, np.full(20, 6.0), np.ones(20))
    assert first + third == pytest.approx(6.0)
    assert second == 0
