"""Whether a confidence is worth anything: figures worked out by hand."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from unshutter.estimators.right_angles.search import Posterior
from unshutter.evaluation.cases.case import Record
from unshutter.evaluation.pages.reliability import Judged, draw_reliability, stated_error
from unshutter.photo import Photo


def judged(epe: Sequence[float], confidence: Sequence[float | None], order: Sequence[int] | None = None) -> Judged:
    """Of records in the order given."""
    records: list[Record] = [{"epe": e, "confidence": c} for e, c in zip(epe, confidence, strict=True)]
    return Judged.of([records[k] for k in order or range(len(records))])


def test_a_confidence_states_the_error_that_it_was_made_from() -> None:
    for size in (1e-9, 1e-5, 1e-3, 0.1):
        posterior = Posterior(np.zeros(6), np.diag([size, size, 0, size, 0, 0]), 0.0, 0.0)
        assert stated_error(np.array(posterior.confidence)) == pytest.approx(posterior.expected_error * 256)
    np.testing.assert_allclose(stated_error(np.array([1.0, 0.5, 0.1])), [0, 3, 9])
    assert np.isfinite(stated_error(np.array(0.0)))


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
    assert not len(judged([1, 2], [None, None]).answered.epe)


def test_two_kinds_of_pictures_count_alike_however_many_there_are() -> None:
    """Weights of a quarter and an eighth: 0.05 of the first is left."""
    both = judged([8, 4], [0.2, 0.6]).beside(judged([0, 0, 0, 0], [0.9, 0.9, 0.9, None]))
    assert both.mean == pytest.approx(3)
    assert both.declined == pytest.approx(1 / 8)
    assert both.best_without(0.2) == pytest.approx((0.05 * 8 + 0.25 * 4) / 0.8)
    assert both.mean_without(0.2) == pytest.approx((0.175 * 8 + 0.25 * 4) / 0.8)


@pytest.mark.parametrize("step", [1, 3, 7])  # through the eleven pictures
def test_dots_of_the_plot(step: int) -> None:
    """Six state 3 px, four 9 px: the second dot has one of the six, with their mean error of 2 px."""
    order = [k * step % 11 for k in range(11)]
    some = judged([1, 3, 1, 3, 1, 3, 6, 8, 6, 8, 50], [0.5] * 6 + [0.1] * 4 + [None], order)
    stated, measured = some.bins()
    np.testing.assert_allclose(stated, [3, (3 + 4 * 9) / 5])
    np.testing.assert_allclose(measured, [2, (2 + 28) / 5])


def test_there_are_at_most_ten_dots_and_none_of_too_few_pictures() -> None:
    assert len(judged([1.0] * 400, list(np.linspace(0.1, 0.9, 400))).bins()[0]) == 10
    assert len(judged([1.0] * 4, [0.5] * 4).bins()[0]) == 0


def test_the_plot_is_drawn_even_where_one_panel_has_no_dots(tmp_path: Path) -> None:
    many = judged(list(np.linspace(0, 20, 40)), list(np.linspace(1, 0.01, 40)))
    panels = {"many": {"a": many}, "few": {"a": judged([1.0], [0.5])}}
    draw_reliability(panels, [("a", "tab:blue", "-"), ("b", "tab:orange", "-")], tmp_path / "plot.png")
    assert Photo.open(tmp_path / "plot.png").width > 500
