"""Reliability of confidences: whether they match the share of correct answers, and the gain from dropping unsure ones.

docs/reference/conventions.md defines the figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from unshutter_lab.evaluation.cases.case import Record
from unshutter_lab.evaluation.metrics import is_right
from unshutter_lab.evaluation.pages.plots import finish_figure, new_figure, save_figure
from unshutter_lab.evaluation.results import values

BINS = 10
ENOUGH = 20  # fewest pictures in a bin whose gap counts
LEFT = "left unchanged"  # used as the kind of motion for pictures left unchanged
_DECLINED = -1.0  # trust in a declined picture: below any confidence
_Z = 1.959964  # half-width of the 95 % interval of a normal distribution, in standard deviations
_AREA = 1.5  # of a dot in the diagram, per picture [square points]
_SMALLEST_DOT = 6.0


@dataclass(frozen=True)
class Bin:
    """Pictures with similar confidence.

    Attributes:
        low, high: range of the confidences, 0 ... 1; includes the lower bound, and the upper one only if it is 1.
        count: number of pictures.
        weight: share of the weight of all pictures with a confidence.
        stated: mean confidence.
        right: share of the pictures with a correct answer (metrics.is_right).
        interval: [2] 95 % interval of the probability of being correct.
    """

    low: float
    high: float
    count: int
    weight: float
    stated: float
    right: float
    interval: tuple[float, float]

    @property
    def gap(self) -> float:
        """Share of correct answers minus stated confidence; negative if overconfident."""
        return self.right - self.stated


@dataclass(frozen=True)
class Judged:
    """An estimator's errors on some pictures, with its confidence.

    Attributes:
        epe: [N] errors [px at 256 rows].
        right: [N] whether the answers are correct (metrics.is_right).
        trust: [N] confidences; -1 if it declined or failed, which ranks lowest.
        kind: [N] the likeliest kind of motion according to the answer, LEFT if the picture is left unchanged; empty if
            the estimator does not report kinds.
        weight: [N] weight of each picture.
    """

    epe: np.ndarray
    right: np.ndarray
    trust: np.ndarray
    kind: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, records: list[Record]) -> Judged:
        """Collects the records of one estimator with equal weights."""
        stated = [record.get("confidence") for record in records]
        trust = np.array([_DECLINED if confidence is None else confidence for confidence in stated])
        kind = np.array(
            [record.get("kind", "") and (LEFT if record["left_alone"] else record["kind"]) for record in records]
        )
        epe = values(records, "epe")
        return cls(epe, is_right(epe, values(records, "epe_nothing")), trust, kind, np.ones(len(records)))

    def pooled_with(self, other: Judged) -> Judged:
        """Combines both with half of the weight each, however many pictures they have."""
        weight = [judged.weight / judged.weight.sum() / 2 for judged in (self, other)]
        pairs = ((self.epe, other.epe), (self.right, other.right), (self.trust, other.trust), (self.kind, other.kind))
        return Judged(*(np.concatenate(pair) for pair in (*pairs, weight)))

    @property
    def declined(self) -> float:
        """Share of the pictures without a confidence."""
        return float(self.weight[self.trust == _DECLINED].sum() / self.weight.sum())

    @property
    def answered(self) -> Judged:
        """The pictures with a confidence."""
        return self._chosen(self.trust != _DECLINED)

    def by_kind(self) -> dict[str, Judged]:
        """Returns the pictures with a confidence by likeliest kind of motion; empty if none are reported."""
        answered = self.answered
        return {str(kind): answered._chosen(answered.kind == kind) for kind in np.unique(answered.kind) if kind}

    @property
    def stated(self) -> float:
        """Mean confidence of the pictures, all of which must have one."""
        return float(np.average(self.trust, weights=self.weight))

    @property
    def right_share(self) -> float:
        """Share of the pictures with a correct answer."""
        return float(np.average(self.right, weights=self.weight))

    def _chosen(self, chosen: np.ndarray) -> Judged:
        return Judged(*(each[chosen] for each in (self.epe, self.right, self.trust, self.kind, self.weight)))

    @property
    def mean(self) -> float:
        """Mean EPE of all pictures."""
        return float(np.average(self.epe, weights=self.weight))

    def mean_without(self, share: float) -> float:
        """Returns the mean EPE after dropping the share (0 ... 1) of the pictures with the lowest confidence."""
        return mean_between(self.epe, self.trust, self.weight, share, 1)

    def best_without(self, share: float) -> float:
        """Returns the mean EPE after dropping the largest errors first: the optimum of any order."""
        return mean_between(self.epe, -self.epe, self.weight, share, 1)

    def bins(self) -> list[Bin]:
        """Returns the pictures in ten bins of stated confidence, without empty ones, in ascending order.

        Declined pictures state no confidence and are not included.
        """
        answered = self.answered
        place = np.minimum((answered.trust * BINS).astype(int), BINS - 1)
        return [answered._bin(place == k, k) for k in np.unique(place)]

    def _bin(self, inside: np.ndarray, place: int) -> Bin:
        chosen = self._chosen(inside)
        among = float(chosen.weight.sum() / self.weight.sum())
        within = wilson_interval(chosen.right_share, effective_size(chosen.weight))
        bounds = place / BINS, (place + 1) / BINS
        return Bin(*bounds, len(chosen.epe), among, chosen.stated, chosen.right_share, within)


def mean_gap(bins: list[Bin]) -> float:
    """Returns the expected calibration error: mean absolute gap over the pictures; NaN if there are none."""
    return sum(each.weight * abs(each.gap) for each in bins) if bins else float("nan")


def widest(bins: list[Bin]) -> Bin | None:
    """Returns the bin with the largest gap, of either sign, among those with ENOUGH pictures; None if there is none."""
    return max((each for each in bins if each.count >= ENOUGH), key=lambda each: abs(each.gap), default=None)


def effective_size(weight: np.ndarray) -> float:
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


def mean_between(figure: np.ndarray, order: np.ndarray, weight: np.ndarray, low: float, high: float) -> float:
    """Returns the weighted mean of a figure over the pictures between two quantiles of another figure.

    Pictures with equal order share their ranks evenly: a limit within such a tie takes a part of each. The result
    therefore depends neither on the order of the files nor on rounding.

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
    """Draws a reliability diagram, the share of correct answers against the confidence, as a PNG.

    Args:
        panels: title -> estimator -> its pictures.
        looks: (estimator, colour, dashes) of each.
        path: path of the file.

    Raises:
        UnshutterError: the file cannot be written.
    """
    figure, axes = new_figure(len(panels), 3.4)
    for axis, (title, judged) in zip(axes.flat, panels.items(), strict=True):
        axis.axline((0, 0), (1, 1), color="0.7", lw=0.8, zorder=0)
        for name, colour, dashes in looks:
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
