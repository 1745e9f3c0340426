"""Fits what odds.py knows to the cases of odds_cases.py; needs scikit-learn.

    python benchmarks/fit_odds.py CASES.jsonl [--check OTHERS.jsonl ...] [--write] [--caution 0.8]

Prints how the forest does on cases that it has not seen: each photo's by a forest fitted without that photo, and those
of ``--check`` by the one that is written (with ``--write``) to src/unshutter/weights/odds.json. Then it prints the
numbers of the logistic regressions for the confidence, which stand in odds.py.
"""

from __future__ import annotations

import argparse
import json
import math
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

WEIGHTS = Path(__file__).parent.parent / "src/unshutter/weights/odds.json"
PEOPLES = 4  # times as much as others count photos that people took, which are few
MOST_AT_STAKE = 8.0  # px of 256 rows: a case counts by what undoing its motion gains or loses, up to this
FOLDS = 4
AS_THEY_ARE = ["whole", "crop"]  # suites of photos that people took


@dataclass(frozen=True)
class Cases:
    """Cases with something to decide.

    Attributes:
        suite, photo: [N] of each.
        error, nothing: [N] mean displacement that is left when the motion found is undone, and when nothing is
            [px of 256 rows].
        names: of what the forest looks at: the figures of odds.py.
        found: [N, names] the figures.
    """

    suite: np.ndarray
    photo: np.ndarray
    error: np.ndarray
    nothing: np.ndarray
    names: tuple[str, ...]
    found: np.ndarray

    @classmethod
    def read(cls, paths: list[Path]) -> Cases:
        """The cases of some files; those in which nothing was found are left out."""
        lines = [json.loads(line) for path in paths for line in path.open()]
        lines = [line for line in lines if line["figures"]]
        columns = {name: np.array([line[name] for line in lines]) for name in ("suite", "photo", "error", "nothing")}
        names = tuple(lines[0]["figures"])
        return cls(
            **columns, names=names, found=np.array([[line["figures"][name] for name in names] for line in lines])
        )

    @property
    def at_stake(self) -> np.ndarray:
        """[N] how much each counts: what undoing its motion gains or loses."""
        stake = np.minimum(np.abs(self.error - self.nothing), MOST_AT_STAKE) + 0.05
        return stake * np.where(np.isin(self.suite, AS_THEY_ARE), PEOPLES, 1)

    @property
    def folds(self) -> np.ndarray:
        """[N] the fold of each photo."""
        return np.array([zlib.crc32(name.encode()) % FOLDS for name in self.photo])


def forest(cases: Cases, chosen: np.ndarray) -> HistGradientBoostingClassifier:
    """Fitted to the chosen cases: whether undoing the motion is better than leaving it."""
    trees = HistGradientBoostingClassifier(
        max_depth=3, max_iter=200, learning_rate=0.05, min_samples_leaf=80, random_state=0
    )
    helps = cases.error < cases.nothing
    return trees.fit(cases.found[chosen], helps[chosen], sample_weight=cases.at_stake[chosen])


def odds_of(trees: HistGradientBoostingClassifier, found: np.ndarray) -> np.ndarray:
    """[N] logarithm of the odds."""
    return np.asarray(trees.decision_function(found))


def table(cases: Cases, odds: np.ndarray) -> str:
    """A line for each suite: what is left where the odds decide, and how often that is better or worse than nothing."""
    left = np.where(odds > 0, cases.error, cases.nothing)
    lines = [f"{'suite':22} cases  median  (all undone, nothing)  better  worse by > 1 px, > 3 px"]
    for suite in sorted(set(cases.suite)):
        of = cases.suite == suite
        worse = left[of] - cases.nothing[of]
        medians = [np.median(x[of]) for x in (left, cases.error, cases.nothing)]
        shares = [np.mean(x) for x in (worse < 0, worse > 1, worse > 3)]
        lines.append(
            f"{suite:22} {of.sum():5d} {medians[0]:7.2f}  ({medians[1]:.2f}, {medians[2]:.2f})"
            f"  {shares[0]:9.0%} {shares[1]:9.1%} {shares[2]:9.1%}"
        )
    return "\n".join(lines)


def as_json(trees: HistGradientBoostingClassifier, names: tuple[str, ...]) -> dict[str, object]:
    """The forest as odds.py reads it."""
    nodes = [tree[0].nodes for tree in trees._predictors]
    most = max(len(each) for each in nodes)

    def column(of: object) -> list[list[float]]:
        return [[float(f"{x:.6g}") for x in of(each)] + [0.0] * (most - len(each)) for each in nodes]

    def whole(of: object) -> list[list[int]]:
        return [[int(x) for x in each] for each in column(of)]

    leaf, own = (lambda n: n["is_leaf"].astype(bool)), (lambda n: np.arange(len(n)))
    return {
        "features": list(names),
        "baseline": float(f"{trees._baseline_prediction.ravel()[0]:.6g}"),
        "depth": max(int(each["depth"].max()) for each in nodes),
        "feature": whole(lambda n: np.where(leaf(n), 0, n["feature_idx"])),
        "threshold": column(lambda n: np.where(leaf(n), 0, n["num_threshold"])),
        "left": whole(lambda n: np.where(leaf(n), own(n), n["left"])),
        "right": whole(lambda n: np.where(leaf(n), own(n), n["right"])),
        "value": column(lambda n: np.where(leaf(n), n["value"], 0)),
    }


def confidence(cases: Cases, odds: np.ndarray) -> str:
    """The regressions for P(error < 1 px), and how well they are calibrated on photos that they have not seen."""
    named = {name: cases.found[:, k] for k, name in enumerate(cases.names)}
    far = np.log(named["disagreement"] / np.hypot(1, named["answer_size"] / 25) + 0.3)
    columns = {
        "apart": far,
        "size": np.log(named["size"] + 0.3),
        "lines_gain": named["lines_gain"],
        "weight": np.log(named["weight"]),
        "odds": np.clip(odds, -4, 6),
        "answer": np.log(named["answer_size"] + 0.3),
        "error": np.log(named["error"] + 0.1),
    }
    right = np.where(odds > 0, cases.error, cases.nothing) < 1
    still = np.char.startswith(cases.suite.astype(str), "still") | np.isin(cases.suite, AS_THEY_ARE)
    weight = np.where(still, 0.5 / still.sum(), 0.5 / (~still).sum()) * len(still)
    said, lines = np.zeros(len(odds)), []
    for name, wanted, of in (
        ("moved", ["apart", "size", "lines_gain", "weight", "odds"], odds > 0),
        ("left", ["odds", "answer", "error"], odds <= 0),
    ):
        x = np.stack([columns[each] for each in wanted], axis=1)
        for fold in range(FOLDS):
            seen = of & (cases.folds != fold)
            asked = of & (cases.folds == fold)
            said[asked] = _regression(x[seen], right[seen], weight[seen]).predict_proba(x[asked])[:, 1]
        whole = _regression(x[of], right[of], weight[of])
        slopes = whole[-1].coef_[0] / whole[0].scale_
        constant = whole[-1].intercept_[0] - slopes @ whole[0].mean_
        lines.append(
            f"{name}: {constant:.3f} " + " ".join(f"{a:+.3f} {b}" for a, b in zip(slopes, wanted, strict=True))
        )
    for low in range(10):
        of = (said * 10).astype(int) == low
        if of.any():
            stated, true = (np.average(each[of], weights=weight[of]) for each in (said, right))
            lines.append(f"  confidence {stated:.2f}: right {true:.2f} ({of.sum()} cases)")
    return "\n".join(lines)


def _regression(x: np.ndarray, right: np.ndarray, weight: np.ndarray):
    model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=3000))
    return model.fit(x, right, logisticregression__sample_weight=weight)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path, nargs="+")
    parser.add_argument("--check", type=Path, nargs="+", default=[])
    parser.add_argument("--caution", type=float, default=0.8, help="odds from which on a motion is undone")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    cases, caution = Cases.read(given.cases), math.log(given.caution)
    unseen = np.zeros(len(cases.error))
    for fold in range(FOLDS):
        asked = cases.folds == fold
        unseen[asked] = odds_of(forest(cases, ~asked), cases.found[asked]) - caution
    print(f"{len(cases.error)} cases, each judged by a forest that has not seen its photo:\n{table(cases, unseen)}")
    whole = forest(cases, np.ones(len(cases.error), bool))
    for path in given.check:
        others = Cases.read([path])
        print(f"\n{path.name}:\n{table(others, odds_of(whole, others.found) - caution)}")
    print(f"\n{confidence(cases, unseen)}")
    if given.write:
        WEIGHTS.write_text(json.dumps(as_json(whole, cases.names), separators=(",", ":")), encoding="utf-8")


if __name__ == "__main__":
    main()
