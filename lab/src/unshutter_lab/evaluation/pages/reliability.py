"""How reliable confidences are: whether as many answers are right as they say, and what dropping the least sure gains.

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
ENOUGH = 20  # pictures in a bin whose gap counts
LEFT = "left unchanged"  # what stands for the kind of motion of a picture that is not moved
_DECLINED = -1.0  # trust in a picture that was declined: below every confidence
_Z = 1.959964  # standard deviations to either side that hold 95 % of a normal distribution
_AREA = 1.5  # of a dot in the diagram, for each picture [square points]
_SMALLEST_DOT = 6.0


@dataclass(frozen=True)
class Bin:
    """Pictures with about the same confidence.

    Attributes:
        low, high: the confidences that belong here, 0 ... 1; the lower bound does, the upper one only if it is 1.
        count: pictures.
        weight: share of the weight of all pictures with a confidence.
        stated: mean confidence.
        right: share of the pictures whose answer is right (metrics.is_right).
        interval: [2], between which the probability of being right lies with 95 %.
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
        """Share of right answers beyond what was stated; negative where too much was promised."""
        return self.right - self.stated


@dataclass(frozen=True)
class Judged:
    """How an estimator did on some pictures, and how far it trusted itself.

    Attributes:
        epe: [N] errors [px at 256 rows].
        right: [N] whether the answers are right (metrics.is_right).
        trust: [N] confidences; -1 where it declined or failed, which is trusted least.
        kind: [N] the likeliest kind of motion by the answer, LEFT where the picture is not moved; empty where the
            estimator knows no kinds.
        weight: [N] how much each picture counts.
    """

    epe: np.ndarray
    right: np.ndarray
    trust: np.ndarray
    kind: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, records: list[Record]) -> Judged:
        """From the records of one estimator, each counting the same."""
        stated = [record.get("confidence") for record in records]
        trust = np.array([_DECLINED if confidence is None else confidence for confidence in stated])
        kind = np.array(
            [record.get("kind", "") and (LEFT if record["left_alone"] else record["kind"]) for record in records]
        )
        epe = values(records, "epe")
        return cls(epe, is_right(epe, values(records, "epe_nothing")), trust, kind, np.ones(len(records)))

    def pooled_with(self, other: Judged) -> Judged:
        """Both together, each counting as a half, however many pictures it has."""
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
        """The pictures with a confidence, by the likeliest kind of motion; none where the estimator knows no kinds."""
        answered = self.answered
        return {str(kind): answered._chosen(answered.kind == kind) for kind in np.unique(answered.kind) if kind}

    @property
    def stated(self) -> float:
        """Mean confidence of the pictures, each of which has one."""
        return float(np.average(self.trust, weights=self.weight))

    @property
    def right_share(self) -> float:
        """Share of the pictures whose answer is right."""
        return float(np.average(self.right, weights=self.weight))

    def _chosen(self, chosen: np.ndarray) -> Judged:
        return Judged(*(each[chosen] for each in (self.epe, self.right, self.trust, self.kind, self.weight)))

    @property
    def mean(self) -> float:
        """Mean EPE of all."""
        return float(np.average(self.epe, weights=self.weight))

    def mean_without(self, share: float) -> float:
        """Mean EPE when the share (0 ... 1) of the pictures that are trusted least is dropped."""
        return mean_between(self.epe, self.trust, self.weight, share, 1)

    def best_without(self, share: float) -> float:
        """Mean EPE when those with the largest errors are dropped first: no order can do better."""
        return mean_between(self.epe, -self.epe, self.weight, share, 1)

    def bins(self) -> list[Bin]:
        """The pictures in ten bins by the confidence stated, empty ones left out, in ascending order.

        Pictures that were declined state nothing and are in none.
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
    """Expected calibration error: mean difference of stated and true share over the pictures; NaN without any."""
    return sum(each.weight * abs(each.gap) for each in bins) if bins else float("nan")


def widest(bins: list[Bin]) -> Bin | None:
    """The bin with the largest gap, either way, of those with ENOUGH pictures; None where no bin has."""
    return max((each for each in bins if each.count >= ENOUGH), key=lambda each: abs(each.gap), default=None)


def effective_size(weight: np.ndarray) -> float:
    """How many pictures of equal weight tell as much as these [N] (Kish, Survey Sampling, 1965)."""
    return float(weight.sum() ** 2 / (weight**2).sum())


def wilson_interval(share: float, size: float) -> tuple[float, float]:
    """Between which bounds a probability lies with 95 %, given the share of so many trials in which it came true.

    Wilson's score interval (JASA 22(158), 1927): unlike the standard error, it does not vanish at shares of 0 and 1.
    """
    spread = _Z**2 / size
    middle = (share + spread / 2) / (1 + spread)
    half = float(np.sqrt(share * (1 - share) * spread + spread**2 / 4)) / (1 + spread)
    return max(middle - half, 0.0), min(middle + half, 1.0)


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
    """Draws a reliability diagram, the share of right answers against the confidence, as a PNG.

    Args:
        panels: title -> estimator -> its pictures.
        looks: (estimator, colour, dashes) of each.
        path: of the file.

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
    """A dot for each bin, its area the number of pictures, with its interval."""
    stated, right = [each.stated for each in bins], [each.right for each in bins]
    axis.plot(stated, right, color=colour, ls=dashes, lw=1.0, marker=".", ms=3, label=name)
    axis.vlines(stated, *np.reshape([each.interval for each in bins], (-1, 2)).T, color=colour, lw=0.8, alpha=0.6)
    areas = [max(_AREA * each.count, _SMALLEST_DOT) for each in bins]
    axis.scatter(stated, right, areas, color=colour, alpha=0.5, linewidths=0)
