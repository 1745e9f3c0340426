"""How reliable confidences are: what dropping the least confident pictures gains, stated against true errors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.estimators.right_angles.search import HALF_TRUSTED
from unshutter.evaluation.cases.case import Record
from unshutter.evaluation.pages.plots import finish_figure, new_figure, save_figure
from unshutter.evaluation.results import values

_DECLINED = -1.0  # trust in a picture that was declined: below every confidence
_LEAST = 1e-5  # smallest confidence that records, with five digits, keep apart from 0
_BINS = 10
_FEWEST = 5  # pictures to a dot of the plot
_TICKS = (0, 1, 3, 10, 30, 100)


def stated_error(confidence: np.ndarray) -> np.ndarray:
    """The expected error [px at 256 rows, root mean square] that a confidence (0 ... 1) states.

    Inverts confidence = 1 / (1 + (error / 3 px)^2), by which all estimators that state one make it
    (``Posterior.confidence`` of estimators/right_angles/search.py).
    """
    return HALF_TRUSTED * np.sqrt(1 / np.maximum(confidence, _LEAST) - 1)


@dataclass(frozen=True)
class Judged:
    """How an estimator did on some pictures, and how far it trusted itself.

    Attributes:
        epe: [N] errors [px at 256 rows].
        trust: [N] confidences; -1 where it declined or failed, which is trusted least.
        weight: [N] how much each picture counts.
    """

    epe: np.ndarray
    trust: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, records: list[Record]) -> Judged:
        """From the records of one estimator, each counting the same."""
        said = [record.get("confidence") for record in records]
        trust = np.array([_DECLINED if confidence is None else confidence for confidence in said])
        return cls(values(records, "epe"), trust, np.ones(len(records)))

    def beside(self, other: Judged) -> Judged:
        """Both together, each counting as a half, however many pictures it has."""
        weight = [judged.weight / judged.weight.sum() / 2 for judged in (self, other)]
        pairs = ((self.epe, other.epe), (self.trust, other.trust), weight)
        return Judged(*(np.concatenate(pair) for pair in pairs))

    @property
    def declined(self) -> float:
        """Share of the pictures without a confidence."""
        return float(self.weight[self.trust == _DECLINED].sum() / self.weight.sum())

    @property
    def answered(self) -> Judged:
        """The pictures with a confidence."""
        kept = self.trust != _DECLINED
        return Judged(self.epe[kept], self.trust[kept], self.weight[kept])

    @property
    def mean(self) -> float:
        """Mean EPE of all."""
        return float(np.average(self.epe, weights=self.weight))

    def mean_without(self, share: float) -> float:
        """Mean EPE when the share (0 ... 1) of the pictures that are trusted least is dropped."""
        return mean_between(self.epe, self.trust, self.weight, share, 1)

    def best_without(self, share: float) -> float:
        """The same when the pictures with the largest errors are dropped: no order can do better."""
        return mean_between(self.epe, -self.epe, self.weight, share, 1)

    def bins(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean stated and mean true error of equally many pictures each, from the most to the least trusted.

        Pictures that were declined state nothing and are left out.
        """
        answered = self.answered
        count = min(_BINS, len(answered.epe) // _FEWEST)
        error = stated_error(answered.trust)
        edges = list(pairwise(np.linspace(0, 1, count + 1))) if count else []
        means = [
            [mean_between(figure, error, answered.weight, low, high) for low, high in edges]
            for figure in (error, answered.epe)
        ]
        return np.array(means[0]), np.array(means[1])


def mean_between(figure: np.ndarray, order: np.ndarray, weight: np.ndarray, low: float, high: float) -> float:
    """Weighted mean of a figure over the pictures between two shares of all, in ascending order of another figure.

    Pictures that are equal in the order share their places evenly: a border among them cuts a part off each. So the
    result depends neither on the order of the files nor on rounding.

    Args:
        figure, order, weight: [N].
        low, high: 0 ... 1.
    """
    _, tied = np.unique(order, return_inverse=True)
    size = np.bincount(tied, weight) / weight.sum()
    end = np.cumsum(size)
    inside = np.minimum(end, high) - np.maximum(end - size, low)
    return float(np.average(figure, weights=weight * (np.maximum(inside, 0) / size)[tied]))


def draw_reliability(panels: dict[str, dict[str, Judged]], looks: list[tuple[str, Any, str]], path: Path) -> None:
    """Draws measured against stated errors as a PNG.

    Args:
        panels: title -> estimator -> its pictures.
        looks: (estimator, colour, dashes) of each.
        path: of the file.

    Raises:
        UnshutterError: the file cannot be written.
    """
    figure, axes = new_figure(len(panels), 3.4)
    largest = 3.0
    for axis, (title, judged) in zip(axes.flat, panels.items(), strict=True):
        for name, colour, dashes in looks:
            if name in judged:
                stated, measured = judged[name].bins()
                axis.plot(stated, measured, color=colour, ls=dashes, lw=1.0, marker="o", ms=4, label=name)
                largest = max([largest, *stated, *measured])
        axis.axline((0, 0), (1, 1), color="0.7", lw=0.8, zorder=0)
        axis.set(title=title, xlabel="error that the confidence states [px]", aspect="equal")
    for axis in axes.flat:
        axis.set_xscale("symlog", linthresh=1)
        axis.set_yscale("symlog", linthresh=1)
        for set_ticks in (axis.set_xticks, axis.set_yticks):
            set_ticks(_TICKS, [f"{tick}" for tick in _TICKS])
        axis.set(xlim=(0, 1.2 * largest), ylim=(0, 1.2 * largest))  # after the ticks, which would widen them
    finish_figure(figure, axes, len(panels), "mean EPE measured [px]")
    save_figure(figure, path)
