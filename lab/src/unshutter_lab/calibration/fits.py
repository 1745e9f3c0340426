"""Fits the odds of motion and the confidence to the results of the search; needs scikit-learn.

A forest of boosted trees, and logistic regressions. They are fitted in one thread, so that sums do not depend on the
number of threads, and numbers are rounded as in the file.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from unshutter.errors import UnshutterError
from unshutter.single.candidates import CAUTION
from unshutter_lab.calibration.cases import CROP, FRAME, WHOLE
from unshutter_lab.evaluation.case import Record
from unshutter_lab.evaluation.metrics import is_right

WEIGHT_OF_ORDINARY = 4  # weight of real photos for the forest, because they are few
MOST_AT_STAKE = 8.0  # px of 256 rows: a case is weighted by the gain or loss of undoing its motion, up to this
FOLDS = 4  # for cross-validation over photos
_STILL_PX = 0.5  # photos with a smaller displacement count as still
# features of the confidence, from odds.confidence_figures
RECTIFIED, LEFT = ("apart", "size", "lines_gain", "weight", "odds"), ("odds", "answer", "error")
RECTIFIED_ALONE, LEFT_ALONE = ("error", "odds"), ("error", "odds")
_ODDS = (-4.0, 6.0)  # limits within which odds affect the confidence
_FAINT = 0.05  # px: least weight of a case


@dataclass(frozen=True)
class Cases:
    """Photos with a decision to make."""

    suite: np.ndarray
    photo: np.ndarray
    error: np.ndarray
    nothing: np.ndarray
    figures: dict[str, np.ndarray]
    confidence_figures: dict[str, np.ndarray]

    @classmethod
    def of(cls, records: list[Record], search: str) -> Cases:
        """Returns the cases among the records that were not declined."""
        chosen = [(record, record[search]) for record in records if record[search]]
        if not chosen:
            raise UnshutterError("no photo shows right angles: calibrate needs photos of buildings")

        def columns(name: str) -> dict[str, np.ndarray]:
            return {key: np.array([found[name][key] for _, found in chosen], float) for key in chosen[0][1][name]}

        suite, photo = (np.array([record[name] for record, _ in chosen], str) for name in ("suite", "photo"))
        error = np.array([found["error"] for _, found in chosen])
        nothing = np.array([record["nothing"] for record, _ in chosen])
        cases = cls(suite, photo, error, nothing, columns("figures"), columns("confidence_figures"))
        for fold in range(FOLDS):
            if len(set(cases.helps[cases.folds != fold])) < 2:
                raise UnshutterError(
                    f"too few photos to calibrate with: {len(set(photo))} in {len(suite)} cases, all of one kind"
                )
        return cases

    @property
    def helps(self) -> np.ndarray:
        """[N] whether undoing the motion is better than leaving it."""
        return self.error < self.nothing

    @property
    def at_stake(self) -> np.ndarray:
        """[N] gain or loss from undoing the motion: the weight of each case for the odds."""
        return np.minimum(np.abs(self.error - self.nothing), MOST_AT_STAKE) + _FAINT

    @property
    def weight(self) -> np.ndarray:
        """[N] weight of each case for the forest."""
        return self.at_stake * np.where(np.isin(self.suite, (WHOLE, CROP, FRAME)), WEIGHT_OF_ORDINARY, 1)

    @property
    def share(self) -> np.ndarray:
        """[N] weight of each case for the confidence: half for photos with motion, half for those without."""
        still = self.nothing < _STILL_PX
        return np.where(still, 0.5 / max(still.sum(), 1), 0.5 / max((~still).sum(), 1)) * len(still)

    @property
    def folds(self) -> np.ndarray:
        """[N] the fold of each photo."""
        return np.array([hashlib.sha256(name.encode()).digest()[0] % FOLDS for name in self.photo])

    @property
    def table(self) -> np.ndarray:
        """[N, figures] features of the odds."""
        return np.stack(list(self.figures.values()), axis=1)


@dataclass(frozen=True)
class Fit:
    """Odds and confidence for one kind of search."""

    odds: dict[str, Any]  # fields of the forest, or of the regression without the network
    rectified: dict[str, Any]  # fields of the confidence's regressions
    left: dict[str, Any]
    report: str  # their accuracy on photos not used for fitting


def fit_with_network(cases: Cases) -> Fit:
    """Fits a forest for the odds, and the confidence."""

    def fitted(chosen: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
        forest = _forest(cases, chosen)
        return forest_fields(forest, tuple(cases.figures)), forest.decision_function(cases.table)

    return _fit(cases, fitted, RECTIFIED, LEFT, "With the network")


def fit_without_network(cases: Cases) -> Fit:
    """Fits a logistic regression for the odds, and the confidence."""

    def fitted(chosen: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
        fields = _regression(cases.figures, ("evidence",), cases.helps, cases.at_stake, chosen)
        return fields, _log_odds(fields, cases.figures)

    return _fit(cases, fitted, RECTIFIED_ALONE, LEFT_ALONE, "Without the network")


def _fit(
    cases: Cases,
    fitted: Callable[[np.ndarray], tuple[dict[str, Any], np.ndarray]],
    rectified: tuple[str, ...],
    left: tuple[str, ...],
    title: str,
) -> Fit:
    """Fits the odds to all cases, and the confidence to the odds of those that a fit had not seen.

    Args:
        cases: the photos.
        fitted: chosen cases [N] -> fields of a fit to them, and its odds [N] for all cases.
        rectified, left: features of the confidence.
        title: of the report.
    """
    with threadpool_limits(1):
        unseen = np.zeros(len(cases.error))
        for fold in range(FOLDS):
            asked = cases.folds == fold
            if asked.any():
                unseen[asked] = fitted(~asked)[1][asked] - CAUTION
        odds, _ = fitted(np.ones(len(unseen), bool))
        of_rectified, of_left, report = _confidence(cases, unseen, rectified, left)
    return Fit(odds, of_rectified, of_left, f"{title}:\n{_table(cases, unseen)}\n{report}")


def _forest(cases: Cases, chosen: np.ndarray) -> HistGradientBoostingClassifier:
    settings: dict[str, Any] = {"max_depth": 3, "max_iter": 200, "learning_rate": 0.05, "min_samples_leaf": 80}
    trees = HistGradientBoostingClassifier(**settings, early_stopping=False, random_state=0)  # type: ignore[arg-type]
    return trees.fit(cases.table[chosen], cases.helps[chosen], sample_weight=cases.weight[chosen])


def forest_fields(trees: HistGradientBoostingClassifier, names: tuple[str, ...]) -> dict[str, Any]:
    """Returns the fields of a fitted forest, as read by :meth:`Forest.of`."""
    nodes = [tree[0].nodes for tree in trees._predictors]
    most = max(len(each) for each in nodes)

    def column(of: Any) -> list[list[float]]:
        return [[rounded(x) for x in of(each)] + [0.0] * (most - len(each)) for each in nodes]

    def whole(of: Any) -> list[list[int]]:
        return [[int(x) for x in each] for each in column(of)]

    leaf, own = (lambda n: n["is_leaf"].astype(bool)), (lambda n: np.arange(len(n)))
    return {
        "features": list(names),
        "baseline": rounded(trees._baseline_prediction.ravel()[0]),
        "depth": max(int(each["depth"].max()) for each in nodes),
        "feature": whole(lambda n: np.where(leaf(n), 0, n["feature_idx"])),
        "threshold": column(lambda n: np.where(leaf(n), 0, n["num_threshold"])),
        "left": whole(lambda n: np.where(leaf(n), own(n), n["left"])),
        "right": whole(lambda n: np.where(leaf(n), own(n), n["right"])),
        "value": column(lambda n: np.where(leaf(n), n["value"], 0)),
    }


def _regression(
    figures: dict[str, np.ndarray], names: tuple[str, ...], right: np.ndarray, weight: np.ndarray, chosen: np.ndarray
) -> dict[str, Any]:
    """Returns the fields of a regression; with the constant alone if all chosen cases agree."""
    if len(set(right[chosen])) < 2:
        count, rights = chosen.sum(), right[chosen].sum()
        constant = rounded(math.log((rights + 0.5) / (count - rights + 0.5)))
        return {"constant": constant, "slopes": dict.fromkeys(names, 0.0)}
    columns = np.stack([figures[name] for name in names], axis=1)[chosen]
    scaler: Any = StandardScaler().fit(columns)
    fitted: Any = LogisticRegression(max_iter=3000)
    fitted.fit(scaler.transform(columns), right[chosen], sample_weight=weight[chosen])
    slopes = fitted.coef_[0] / scaler.scale_
    constant = rounded(fitted.intercept_[0] - slopes @ scaler.mean_)
    return {"constant": constant, "slopes": {name: rounded(slope) for name, slope in zip(names, slopes, strict=True)}}


def _log_odds(fields: dict[str, Any], figures: dict[str, np.ndarray]) -> np.ndarray:
    return fields["constant"] + sum(slope * figures[name] for name, slope in fields["slopes"].items())


def _confidence(
    cases: Cases, odds: np.ndarray, rectified: tuple[str, ...], left: tuple[str, ...]
) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Returns the regressions, and a report of the share of correct answers on photos not used for fitting."""
    figures = cases.confidence_figures | {"odds": np.clip(odds, *_ODDS)}
    right = is_right(np.where(odds > 0, cases.error, cases.nothing), cases.nothing)
    stated, fits = np.zeros(len(odds)), []
    for names, of in ((rectified, odds > 0), (left, odds <= 0)):
        for fold in range(FOLDS):
            asked = of & (cases.folds == fold)
            fitted = _regression(figures, names, right, cases.share, of & (cases.folds != fold))
            stated[asked] = 1 / (1 + np.exp(-_log_odds(fitted, figures)[asked]))
        fits.append(_regression(figures, names, right, cases.share, of))
    return fits[0], fits[1], "\n".join(_reliability(cases, stated, right))


def _reliability(cases: Cases, stated: np.ndarray, right: np.ndarray) -> list[str]:
    """Returns one line per tenth of the confidence and per suite: stated confidence and share of correct answers."""
    tenths = (stated * 10).astype(int)
    groups = [(f"confidence .{low}", tenths == low, cases.share) for low in range(10)]
    groups += [(suite, cases.suite == suite, np.ones(len(stated))) for suite in np.unique(cases.suite)]
    return [
        f"{name:22} {of.sum():5d} cases: confidence {np.average(stated[of], weights=weight[of]):.2f}, "
        f"right {np.average(right[of], weights=weight[of]):.2f}"
        for name, of, weight in groups
        if of.any()
    ]


def _table(cases: Cases, odds: np.ndarray) -> str:
    """Returns one line per suite: error under the odds' decisions, and the share of better and worse results."""
    left = np.where(odds > 0, cases.error, cases.nothing)
    lines = [f"{'suite':22} cases  median  (all undone, nothing)  better  worse by > 1 px, > 3 px"]
    for suite in np.unique(cases.suite):
        of = cases.suite == suite
        worse = (left - cases.nothing)[of]
        medians = [np.median(x[of]) for x in (left, cases.error, cases.nothing)]
        lines.append(
            f"{suite:22} {of.sum():5d} {medians[0]:7.2f}  ({medians[1]:.2f}, {medians[2]:.2f})"
            f"  {np.mean(worse < 0):9.0%} {np.mean(worse > 1):9.1%} {np.mean(worse > 3):9.1%}"
        )
    return "\n".join(lines)


def rounded(number: float) -> float:
    """Rounds to six digits, as in the file."""
    return float(f"{number:.6g}")
