"""Whether a confidence is worth anything: figures worked out by hand."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from unshutter.photo import Photo
from unshutter_lab.evaluation.case import Record
from unshutter_lab.evaluation.reliability import (
    Judged,
    draw_reliability,
    effective_size,
    mean_gap,
    widest,
    wilson_interval,
)


def judged(epe: Sequence[float], confidence: Sequence[float | None], order: Sequence[int] | None = None) -> Judged:
    """Of records in the order given."""
    records: list[Record] = [
        {"epe": e, "epe_nothing": 1.0, "epe_best": 0.5, "confidence": c} for e, c in zip(epe, confidence, strict=True)
    ]
    return Judged.of(pd.DataFrame([records[k] for k in order or range(len(records))]))


def test_the_least_confident_are_dropped() -> None:
    right = judged([1, 2, 3, 4, 10], [0.9, 0.8, 0.7, 0.6, 0.1])
    assert (right.mean, right.mean_without(0.2), right.best_without(0.2)) == pytest.approx((4, 2.5, 2.5))
    wrong = judged([1, 2, 3, 4, 10], [0.1, 0.8, 0.7, 0.6, 0.9])
    assert (wrong.mean, wrong.mean_without(0.2), wrong.best_without(0.2)) == pytest.approx((4, 4.75, 2.5))


def test_a_share_that_is_no_whole_number_of_pictures_takes_a_part_of_one() -> None:
    """A fifth of four is 0.8 of the worst: 0.2 of its 10 px stay, over 3.2 pictures."""
    assert judged([10, 1, 1, 1], [0.1, 0.7, 0.8, 0.9]).mean_without(0.2) == pytest.approx(5 / 3.2)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 3, 2, 1, 0), (1, 4, 0, 2, 3)])
def test_the_order_of_equal_confidences_has_no_say(order: tuple[int, ...]) -> None:
    """One of five goes: half of each of the two that are trusted equally little."""
    some = judged([10, 0, 3, 3, 3], [0.1, 0.1, 0.5, 0.5, 0.5], order)
    assert some.mean_without(0.2) == pytest.approx((5 + 9) / 4)
    assert some.best_without(0.2) == pytest.approx(9 / 4)
    every = judged([10, 0, 3, 3, 3], [1.0] * 5, order)
    assert every.mean_without(0.2) == pytest.approx(every.mean)


def test_who_declines_is_trusted_least() -> None:
    some = judged([9, 1, 1, 1, 8], [None, 0.9, 0.9, 0.9, 0.001])
    assert some.mean_without(0.2) == pytest.approx(11 / 4)
    assert some.declined == pytest.approx(0.2)
    assert some.answered.mean_without(0.25) == pytest.approx(1)
    assert not len(judged([1, 2], [None, None]).answered)


def test_two_kinds_of_pictures_count_alike_however_many_there_are() -> None:
    """Weights of a quarter and an eighth: 0.05 of the first is left."""
    both = judged([8, 4], [0.2, 0.6]).pooled_with(judged([0, 0, 0, 0], [0.9, 0.9, 0.9, None]))
    assert both.mean == pytest.approx(3)
    assert both.declined == pytest.approx(1 / 8)
    assert both.best_without(0.2) == pytest.approx((0.05 * 8 + 0.25 * 4) / 0.8)
    assert both.mean_without(0.2) == pytest.approx((0.175 * 8 + 0.25 * 4) / 0.8)


@pytest.mark.parametrize("step", [1, 2, 4])  # through the seven pictures
def test_ten_bins_of_stated_against_true_shares(step: int) -> None:
    """What is left at its 1 px has a better candidate, a confidence of 0.8 starts a bin, one of 1 ends the last."""
    order = [k * step % 7 for k in range(7)]
    some = judged([0.5, 1.0, 0.2, 3.0, 0.9, 50, 0.1], [0.8, 0.83, 0.89, 0.79, 1.0, None, 0.9], order)
    bins = some.bins()
    assert [(each.low, each.high, each.count) for each in bins] == [(0.7, 0.8, 1), (0.8, 0.9, 3), (0.9, 1.0, 2)]
    np.testing.assert_allclose([each.stated for each in bins], [0.79, 0.84, 0.95])
    np.testing.assert_allclose([each.right for each in bins], [0, 2 / 3, 1])
    np.testing.assert_allclose([each.gap for each in bins], [-0.79, 2 / 3 - 0.84, 0.05])
    np.testing.assert_allclose([each.weight for each in bins], [1 / 6, 3 / 6, 2 / 6])
    assert mean_gap(bins) == pytest.approx(0.79 / 6 + (0.84 - 2 / 3) / 2 + 0.05 / 3)


def test_right_is_what_is_closer_to_the_truth_than_the_photo() -> None:
    """Better, worse, and left unchanged with no candidate that is better, and with one."""
    answers = [(3.0, 3.0), (5.0, 4.0), (4.0, 4.0), (4.0, 2.0)]
    records = [{"epe": epe, "epe_nothing": 4.0, "epe_best": best, "confidence": 0.6} for epe, best in answers]
    (only,) = Judged.of(pd.DataFrame(records)).bins()
    assert (only.count, only.right) == (4, pytest.approx(2 / 4))


def test_in_a_bin_both_kinds_of_pictures_have_their_weight() -> None:
    """One of two distorted pictures is in the bin (a quarter), two of four others (an eighth each)."""
    both = judged([8, 4], [0.41, 0.6]).pooled_with(judged([0, 0, 0, 0], [0.45, 0.47, 0.9, None]))
    first = both.bins()[0]
    assert (first.count, first.low) == (3, 0.4)
    assert first.stated == pytest.approx((2 * 0.41 + 0.45 + 0.47) / 4)
    assert first.right == pytest.approx(0.5)
    assert first.weight == pytest.approx((1 / 2) / (7 / 8))  # of what was answered
    np.testing.assert_allclose(first.interval, wilson_interval(0.5, 16 / 6))  # (2 + 1 + 1)^2 / (4 + 1 + 1)


def test_the_largest_gap_is_of_a_bin_with_enough_pictures() -> None:
    """20 promise 0.5 and 12 of them are right, 25 promise 0.9 and 20 are; 19 promise 0.1 and all are."""
    epe = [0.0] * 12 + [5.0] * 8 + [0.0] * 20 + [5.0] * 5 + [0.0] * 19
    some = judged(epe, [0.5] * 20 + [0.9] * 25 + [0.1] * 19)
    worst = widest(some.bins())
    assert worst is not None and (worst.low, worst.count) == (0.5, 20)
    assert worst.gap == pytest.approx(0.1)
    worst = widest(judged([*epe, 5.0, 5.0], [0.5] * 20 + [0.9] * 25 + [0.1] * 19 + [0.9] * 2).bins())
    assert worst is not None and worst.gap == pytest.approx(20 / 27 - 0.9)
    assert widest(judged([1.0] * 19, [0.5] * 19).bins()) is None


def test_who_states_nothing_has_no_bins() -> None:
    silent = judged([1, 2], [None, None])
    assert silent.bins() == [] and widest([]) is None and np.isnan(mean_gap([]))


def test_intervals_hold_the_probability_in_95_of_100_cases() -> None:
    """Wilson's bounds are the probabilities that lie 1.96 standard deviations from the share that came out."""
    for share, size in ((0.3, 10.0), (0.5, 2.7), (0.98, 400.0)):
        for bound in wilson_interval(share, size):
            assert abs(share - bound) == pytest.approx(1.959964 * np.sqrt(bound * (1 - bound) / size))
    rng = np.random.default_rng(0)
    drawn = rng.binomial(400, 0.8, 2000) / 400
    bounds = [wilson_interval(float(share), 400) for share in drawn]
    assert np.mean([low <= 0.8 <= high for low, high in bounds]) == pytest.approx(0.95, abs=0.02)


def test_bounds_of_none_and_of_all() -> None:
    """0 of n leaves up to z^2 / (n + z^2)."""
    assert wilson_interval(0.0, 20) == pytest.approx((0, 3.841459 / 23.841459), abs=1e-6)
    assert wilson_interval(1.0, 20) == pytest.approx((20 / 23.841459, 1), abs=1e-6)


def test_unequal_weights_tell_as_much_as_fewer_equal_ones() -> None:
    assert effective_size(np.full(7, 0.3)) == pytest.approx(7)
    assert effective_size(np.array([3.0, 1.0])) == pytest.approx(1.6)


def test_the_plot_is_drawn_even_where_one_panel_has_no_dots(tmp_path: Path) -> None:
    many = judged(list(np.linspace(0, 20, 40)), list(np.linspace(1, 0.01, 40)))
    panels = {"many": {"a": many}, "none": {"a": judged([1.0], [None])}}
    draw_reliability(panels, [("a", "tab:blue", "-"), ("b", "tab:orange", "-")], tmp_path / "plot.png")
    assert Photo.open(tmp_path / "plot.png").width > 500
