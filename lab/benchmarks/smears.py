"""Measures how often the direction found in smeared photos is right, and what undoing the motion gains (smear.py).

    python lab/benchmarks/smears.py PHOTOS LOGS [--photos 140] [--seed 5]

Photos are distorted by drawn motions and by recorded shake (LOGS: a folder), with the blur that belongs to them. Where
smears are found, either direction is compared with the truth: the tables of docs/research/own-model-folders.md. Errors
are in px of 256 rows.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from unshutter.motion.verdict import LIKELY
from unshutter.single.candidates import candidates_by_smear, candidates_of
from unshutter.single.likelihood import segments_of, unusable
from unshutter.single.methods import SegmentManhattan
from unshutter.single.register import load
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error
from unshutter_lab.evaluation.pair_cases import logs_in, photos_in
from unshutter_lab.evaluation.synthetic import Suite, SyntheticCase

SUITES = (
    *(Suite(f"256 px 1/{n} s", exposure_s=1 / n, of_pictures=False) for n in (30, 60)),
    *(Suite(f"native size 1/{n} s", rows=None, exposure_s=1 / n, of_pictures=False) for n in (30, 60, 125)),
    *(Suite(f"50 ms {rows}", rows=rows, readout_s=0.05, exposure_s=1 / 30, of_pictures=False) for rows in (256, None)),
)
BINS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
WORSE_PX = 0.5


@dataclass(frozen=True)
class Smeared:
    """A photo in which smears were found: stated probability of the likelier direction, and errors [px]."""

    stated: float
    error: float  # along the likelier direction
    other: float  # along the other
    alone: float  # of what right angles alone decide
    nothing: float


def main() -> None:
    """Prints the two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("logs", type=Path)
    parser.add_argument("--photos", type=int, default=140, dest="count")
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    logs, estimator, found, count = logs_in(given.logs), load("segment-manhattan"), [], 0
    assert isinstance(estimator, SegmentManhattan)
    for path in photos_in(given.photos, given.count, given.seed):
        for suite in SUITES:
            count += 1
            found += _judged(SyntheticCase(suite, "", path.name, path, 0, given.seed, logs), estimator)
    print(f"smears in {len(found)} of {count}\n\n| stated | photos | mean | right |\n|---|---|---|---|")
    for low, high in pairwise(BINS):
        of = [each for each in found if low <= each.stated < high]
        right = np.mean([each.error < each.nothing for each in of]) if of else np.nan
        print(f"| {low} to {high} | {len(of)} | {np.mean([each.stated for each in of]):.2f} | {right:.2f} |")
    nothing, best = np.mean([(each.nothing, min(each.error, each.other)) for each in found], axis=0)
    print(f"\nnothing {nothing:.2f}, in the true direction {best:.2f}\n")
    print("| rule | changed | mean | worse |\n|---|---|---|---|")
    rules = {"likelier": 0.5, "likely": LIKELY}
    for name, least in rules.items():
        after = np.array([each.error if each.stated >= least else each.nothing for each in found])
        print(_row(name, after, found))
    print(_row("right angles alone", np.array([each.alone for each in found]), found))


def _judged(case: SyntheticCase, estimator: SegmentManhattan) -> Iterator[Smeared]:
    exam = case.exam()
    view = exam.view
    segments, size = segments_of(view)
    if unusable(segments, view.height, view.width):
        return
    posterior, answer = estimator.weigh(view, segments, size)
    candidates = candidates_by_smear(posterior, view, estimator.name)
    if candidates is None:
        return
    first, second = (each for each in candidates if each.kind != "still")
    alone = candidates_of(posterior, view, estimator.name, answer)[0].motion
    errors = [motion_error(motion, exam.truth).epe for motion in (first.motion, second.motion, alone)]
    yield Smeared(first.probability or 0.0, *errors, epe_of_nothing(exam.truth))


def _row(name: str, after: np.ndarray, found: list[Smeared]) -> str:
    nothing = np.array([each.nothing for each in found])
    changed, worse = int((after != nothing).sum()), int((after > nothing + WORSE_PX).sum())
    return f"| {name} | {changed} | {after.mean():.2f} | {worse} |"


if __name__ == "__main__":
    main()
