"""Checks whether confidences match the share of correct answers, and what dropping unsure answers gains.

docs/reference/conventions.md defines the figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from unshutter_lab.evaluation.metrics import is_right
from unshutter_lab.evaluation.plots import finish_figure, new_figure, save_figure

BINS = 10
ENOUGH = 20  # fewest pictures in a bin whose gap counts
_DECLINED = -1.0  # trust in a declined picture: below any confidence
_Z = 1.959964  # half-width of the 95 % interval of a normal distribution, in standard deviations
_AREA = 1.5  # of a dot in the diagram, per picture [square points]
_SMALLEST_DOT = 6.0


@dataclass(frozen=True)
class Bin:
    """Pictures with similar confidence."""

    low: float
    high: float
    count: int  # number of pictures
    weight: float  # share of the weight of all pictures with a confidence
    stated: float  # mean confidence
    right: float  # share of the pictures with a correct answer (metrics.is_right)
    interval: tuple[float, float]  # [2] 95 % interval of the probability of being correct

    @property
    def gap(self) -> float:
        """Share of correct answers minus stated confidence; negative if overconfident."""
        return self.right - self.stated


@dataclass(frozen=True)
class Judged:
    """An estimator's errors on some pictures, with its confidence.

    A picture has its error ``epe`` [px at 256 rows], whether the answer is ``right`` (metrics.is_right), the confidence
    ``trust`` (-1 if it declined or failed, which ranks lowest) and a ``weight``.
    """

    pictures: Any  # pandas.DataFrame

    @classmethod
    def of(cls, records: Any) -> Judged:
        """Collects the records of one estimator (pandas.DataFrame) with equal weights."""
        known = records.reindex(columns=["epe", "epe_nothing", "epe_best", "confidence"])
        pictures = {
            "epe": known["epe"],
            "right": is_right(known["epe"], known["epe_nothing"], known["epe_best"]),
            "trust": known["confidence"].astype(float).fillna(_DECLINED),
            "weight": 1.0,
        }
        return cls(pd.DataFrame(pictures))

    def pooled_with(self, other: Judged) -> Judged:
        """Combines both with half of the weight each, however many pictures they have."""
        both = [each.pictures.assign(weight=each.weight / each.weight.sum() / 2) for each in (self, other)]
        return Judged(pd.concat(both, ignore_index=True))

    @property
    def weight(self) -> Any:
        """Weights of the pictures."""
        return self.pictures["weight"]

    def __len__(self) -> int:
        return len(self.pictures)

    @property
    def declined(self) -> float:
        """Share of the pictures without a confidence."""
        return float(self.weight[self.pictures["trust"] == _DECLINED].sum() / self.weight.sum())

    @property
    def answered(self) -> Judged:
        """The pictures with a confidence."""
        return Judged(self.pictures[self.pictures["trust"] != _DECLINED])

    def _average(self, key: str) -> float:
        return float(np.average(self.pictures[key], weights=self.weight))

    @property
    def stated(self) -> float:
        """Mean confidence of the pictures, all of which must have one."""
        return self._average("trust")

    @property
    def right_share(self) -> float:
        """Share of the pictures with a correct answer."""
        return self._average("right")

    @property
    def mean(self) -> float:
        """Mean EPE of all pictures."""
        return self._average("epe")

    def mean_without(self, share: float) -> float:
        """Returns the mean EPE after dropping the share (0 ... 1) of the pictures with the lowest confidence."""
        return mean_between(self.pictures["epe"], self.pictures["trust"], self.weight, share, 1)

    def best_without(self, share: float) -> float:
        """Returns the mean EPE after dropping the largest errors first: the optimum of any order."""
        return mean_between(self.pictures["epe"], -self.pictures["epe"], self.weight, share, 1)

    def bins(self) -> list[Bin]:
        """Returns the pictures in ten bins of stated confidence, without empty ones, in ascending order.

        Declined pictures state no confidence and are not included.
        """
        answered, bins = self.answered, []
        places: Any = (answered.pictures["trust"] * BINS).astype(int).clip(upper=BINS - 1)
        for place in places.drop_duplicates().sort_values():
            some = answered.pictures[places == place]
            chosen, right = Judged(some), Judged(some).right_share
            share = float(chosen.weight.sum() / answered.weight.sum())
            interval = wilson_interval(right, effective_size(chosen.weight))
            bins.append(Bin(place / BINS, (place + 1) / BINS, len(some), share, chosen.stated, right, interval))
        return bins


def mean_gap(bins: list[Bin]) -> float:
    """Returns the expected calibration error: mean absolute gap over the pictures; NaN if there are none."""
    return sum(each.weight * abs(each.gap) for each in bins) if bins else float("nan")


def widest(bins: list[Bin]) -> Bin | None:
    """Returns the bin with the largest gap, of either sign, among those with ENOUGH pictures; None if there is none."""
    return max((each for each in bins if each.count >= ENOUGH), key=lambda each: abs(each.gap), default=None)


def effective_size(weight: Any) -> float:
    """Returns the effective sample size of weights [N] (Kish, Survey Sampling, 1965)."""
    return float(weight.sum() ** 2 / (weight**2).sum())


def wilson_interval(share: float, size: float) -> tuple[float, float]:
    """Returns the 95 % interval of a probability, given the observed share of successes in ``size`` trials.

    Wilson's score interval (JASA 22(158), 1927): unlike the standard error, it does not vanish at shares of 0 and 1.
    """
    spread = _Z**2 / size
    middle = (share + spread / 2) / (1 + spread)
    half = float(np.sqrt(share * (1 - share) * spread + spread**2 / 4)) / (1 + spread)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def mean_between(figure: Any, order: Any, weight: Any, low: float, high: float) -> float:
    """Returns the weighted mean of a figure over the pictures between two quantiles of another figure (pandas.Series).

    Pictures with equal order share their ranks evenly: a limit within such a tie takes a part of each. The result
    therefore depends neither on the order of the files nor on rounding.
    """
    size = weight.groupby(order).sum() / weight.sum()
    inside = size.cumsum().clip(upper=high) - (size.cumsum() - size).clip(lower=low)
    return float(np.average(figure, weights=weight * order.map(inside.clip(lower=0) / size)))


def draw_reliability(panels: dict[str, dict[str, Judged]], styles: list[tuple[str, Any, str]], path: Path) -> None:
    """Draws a reliability diagram, the share of correct answers against the confidence, as a PNG."""
    figure, axes = new_figure(len(panels), 3.4)
    for axis, (title, judged) in zip(axes.flat, panels.items(), strict=True):
        axis.axline((0, 0), (1, 1), color="0.7", lw=0.8, zorder=0)
        for name, colour, dashes in styles:
            if name in judged:
                _draw_bins(axis, judged[name].bins(), name, colour, dashes)
        axis.set(title=title, xlabel="confidence (mean of a bin)", aspect="equal", xlim=(0, 1), ylim=(-0.02, 1.02))
    finish_figure(figure, axes, len(panels), "share that is right")
    save_figure(figure, path)


def _draw_bins(axis: Any, bins: list[Bin], name: str, colour: Any, dashes: str) -> None:
    """Draws a dot per bin with its interval; the area is proportional to the number of pictures."""
    stated, right = [each.stated for each in bins], [each.right for each in bins]
    axis.plot(stated, right, color=colour, ls=dashes, lw=1.0, marker=".", ms=3, label=name)
    axis.vlines(stated, *np.reshape([each.interval for each in bins], (-1, 2)).T, color=colour, lw=0.8, alpha=0.6)
    areas = [max(_AREA * each.count, _SMALLEST_DOT) for each in bins]
    axis.scatter(stated, right, areas, color=colour, alpha=0.5, linewidths=0)
