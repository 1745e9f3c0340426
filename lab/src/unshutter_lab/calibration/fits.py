"""Fits the forests that state the expected benefit of a motion (unshutter/single/prospects.py) to search results.

Needs scikit-learn. Two forests of boosted trees for each kind of search. They are fitted in one thread, so that sums do
not depend on the number of threads, and numbers are rounded as in the file.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingClassifier, HistGradientBoostingRegressor
from sklearn.linear_model import LogisticRegression
from threadpoolctl import threadpool_limits

from unshutter.errors import UnshutterError
from unshutter.single.prior import BenefitCalibration
from unshutter.single.prospects import FAINT_PX, HARM, LOST, ExpectedBenefit
from unshutter_lab.calibration.cases import CROP, FRAME, WHOLE
from unshutter_lab.evaluation.case import Record

WEIGHT_OF_ORDINARY = 12  # weight of real photos, because they are few
FOLDS = 4  # for cross-validation over photos
STILL_PX = 0.5  # photos with a smaller displacement count as still
HARMS = (0.6, 0.8, 1.0, 1.2, 1.8, 2.4, 4.0)  # of the report's curve
_TREES = {"max_depth": 6, "max_iter": 100, "learning_rate": 0.12, "min_samples_leaf": 60}
_TREES_OF_ERROR = {"max_depth": 4, "max_iter": 60, "learning_rate": 0.12, "min_samples_leaf": 60}
_FIXED: dict[str, Any] = {"early_stopping": False, "random_state": 0}


@dataclass(frozen=True)
class Cases:
    """Motions that might be undone, several of each photo."""

    table: pd.DataFrame  # suite, photo, case (number of the picture), error, nothing [px of 256 rows]
    features: pd.DataFrame  # of prospects.features

    @classmethod
    def of(cls, records: list[Record], search: str) -> Cases:
        """Returns the cases of the records that were not declined."""
        about = ("suite", "photo", "nothing")
        rows = [
            {**{name: record[name] for name in about}, "case": case, **motion}
            for case, record in enumerate(records)
            for motion in record[search]
        ]
        if not rows:
            raise UnshutterError("no photo shows right angles: calibrate needs photos of buildings")
        table = pd.DataFrame(rows)
        cases = cls(table.drop(columns="features"), pd.DataFrame(list(table["features"]), dtype=float))
        for fold in range(FOLDS):
            if len(set(cases.helps[cases.folds != fold])) < 2:
                count = table["photo"].nunique()
                raise UnshutterError(
                    f"too few photos to calibrate with: {count} in {len(records)} cases, all of one kind"
                )
        return cases

    @property
    def helps(self) -> np.ndarray:
        """[N] whether undoing the motion is better than leaving it."""
        return (self.table["error"] < self.table["nothing"]).to_numpy()

    @property
    def still(self) -> np.ndarray:
        """[N] whether the photo hardly moved."""
        return (self.table["nothing"] < STILL_PX).to_numpy()

    @property
    def weight(self) -> np.ndarray:
        """[N] weight of each case: half for photos with motion, half for those without."""
        each = np.where(self.table["suite"].isin((WHOLE, CROP, FRAME)), WEIGHT_OF_ORDINARY, 1.0)
        total = {still: max(each[self.still == still].sum(), 1.0) for still in (True, False)}
        return each * np.where(self.still, 0.5 / total[True], 0.5 / total[False]) * len(each)

    @property
    def folds(self) -> np.ndarray:
        """[N] the fold of each photo."""
        number = {name: hashlib.sha256(name.encode()).digest()[0] % FOLDS for name in set(self.table["photo"])}
        return np.array([number[name] for name in self.table["photo"]])


def fit(cases: Cases, title: str) -> tuple[dict[str, Any], str]:
    """Fits the forests; returns their fields in the file, and a report on photos that a fit had not seen."""
    with threadpool_limits(1):
        odds, error = np.zeros(len(cases.table)), np.zeros(len(cases.table))
        for fold in range(FOLDS):
            asked = cases.folds == fold
            if asked.any():
                forests = _forests(cases, ~asked)
                odds[asked] = forests[0].decision_function(cases.features[asked])
                error[asked] = np.maximum(np.exp(forests[1].predict(cases.features[asked])) - FAINT_PX, 0)
        # trees are too sure of photos that they have not seen: their odds are scaled to what such photos show
        scale = LogisticRegression(C=np.inf).fit(odds[:, None], cases.helps, sample_weight=cases.weight)
        better = scale.predict_proba(odds[:, None])[:, 1]
        forests = _forests(cases, np.ones(len(cases.table), bool))
    names = tuple(cases.features.columns)
    slope, constant = float(scale.coef_[0, 0]), float(scale.intercept_[0])
    fields: dict[str, Any] = {
        "better": forest_fields(forests[0], names, slope, constant),
        "error": forest_fields(forests[1], names),
        "moved": _moved(cases, slope * odds + constant),
    }
    BenefitCalibration.read(fields)  # as it will be read
    lines = [f"{title}: log odds times {slope:.3f} plus {constant:.3f}"]
    return fields, "\n".join([*lines, *_curve(cases, better, error), *_reliability(cases, better)])


def _moved(cases: Cases, odds: np.ndarray) -> list[float]:
    """Fits the log odds that a camera moved, by the largest log odds [N] that undoing one of its motions helps."""
    best = cases.table.assign(odds=odds, moved=~cases.still, weight=cases.weight)
    best = best.sort_values("odds").groupby("case", sort=False).tail(1)
    line = LogisticRegression(C=np.inf).fit(best[["odds"]].to_numpy(), best["moved"], sample_weight=best["weight"])
    return [round(float(line.coef_[0, 0]), 3), round(float(line.intercept_[0]), 3)]


def _forests(cases: Cases, chosen: np.ndarray) -> tuple[HistGradientBoostingClassifier, HistGradientBoostingRegressor]:
    """Fits the probability that undoing helps, and the log of the error where it does."""
    features, weight, helped = cases.features, cases.weight, chosen & cases.helps
    better = HistGradientBoostingClassifier(**_TREES, **_FIXED)
    better.fit(features[chosen], cases.helps[chosen], sample_weight=weight[chosen])
    error = HistGradientBoostingRegressor(**_TREES_OF_ERROR, **_FIXED)
    error.fit(features[helped], np.log(cases.table["error"][helped] + FAINT_PX), sample_weight=weight[helped])
    return better, error


def forest_fields(trees: Any, names: tuple[str, ...], slope: float = 1.0, constant: float = 0.0) -> dict[str, Any]:
    """Returns the fields of a fitted forest, scaled and shifted, as read by :meth:`Forest.read`."""
    nodes = [tree[0].nodes for tree in trees._predictors]
    most = max(len(each) for each in nodes)

    def column(of: Any, padding: float) -> list[list[float]]:
        return [[float(f"{x:.6g}") for x in of(each)] + [padding] * (most - len(each)) for each in nodes]

    def whole(of: Any, padding: int) -> list[list[int]]:
        return [[int(x) for x in each] for each in column(of, padding)]

    def leaf(of: Any) -> np.ndarray:
        return of["is_leaf"].astype(bool)

    return {
        "features": list(names),
        "baseline": float(f"{slope * float(np.ravel(trees._baseline_prediction)[0]) + constant:.6g}"),
        "depth": max(int(each["depth"].max()) for each in nodes),
        "feature": whole(lambda n: np.where(leaf(n), -1, n["feature_idx"].astype(int)), -1),
        "right": whole(lambda n: np.where(leaf(n), 0, n["right"]), 0),
        "number": column(lambda n: np.where(leaf(n), slope * n["value"], n["num_threshold"]), 0.0),
    }


def _curve(cases: Cases, better: np.ndarray, error: np.ndarray) -> list[str]:
    """Returns what is decided at several weights of harm: the error afterwards, and the share that comes out worse."""
    table, size = cases.table, cases.features["own_size"].to_numpy()
    helps = cases.helps
    lost = (table["error"] - table["nothing"])[~helps] / size[~helps]
    lines = [f"of the motion, {np.median(lost):.2f} (median) is lost where undoing it harms ({LOST} is assumed)"]
    lines.append(f"{'suite':22} {'harm':>5} cases  nothing  decided (mean)  changed  worse by > .5, > 1 px")
    for harm in HARMS:
        benefit = [ExpectedBenefit(p, e, s).weighed(harm) for p, e, s in zip(better, error, size, strict=True)]
        best = table.assign(benefit=benefit).sort_values("benefit").groupby("case", sort=False).tail(1)
        after = np.where(best["benefit"] > 0, best["error"], best["nothing"])
        for suite in np.unique(best["suite"]) if harm == HARM else ():
            lines.append(_line(suite, harm, best, after, (best["suite"] == suite).to_numpy()))
        still = (best["nothing"] < STILL_PX).to_numpy()
        lines += [_line("all still", harm, best, after, still), _line("all moved", harm, best, after, ~still)]
    return lines


def _line(name: str, harm: float, best: pd.DataFrame, after: np.ndarray, of: np.ndarray) -> str:
    before, left = best["nothing"].to_numpy()[of], after[of]
    changed, worse = np.mean(best["benefit"][of] > 0), left - before
    means = f"{before.mean():8.2f} {np.median(left):8.2f} ({left.mean():.2f})"
    shares = f"{changed:8.0%} {np.mean(worse > 0.5):9.1%} {np.mean(worse > 1):9.1%}"
    return f"{name:22} {harm:5.1f} {of.sum():5d} {means} {shares}"


def _reliability(cases: Cases, better: np.ndarray) -> list[str]:
    """Returns one line per tenth of the probability: as stated, and the share of motions that helped."""
    tenths, weight = np.minimum((better * 10).astype(int), 9), cases.weight
    return [
        f"stated .{tenth}: {of.sum():5d} motions, {np.average(better[of], weights=weight[of]):.2f} stated, "
        f"{np.average(cases.helps[of], weights=weight[of]):.2f} helped"
        for tenth in range(10)
        if (of := tenths == tenth).any()
    ]
