"""Cases for the odds of right angles: what the search finds of photos with known motions and of photos without any.

    python benchmarks/odds_cases.py OUT.jsonl --moved DIR [DIR ...] --as-they-are DIR [DIR ...] [--photos N] [--jobs N]

Photos of ``--moved`` get motions (and none) put in; those of ``--as-they-are`` are taken whole, and as crops that were
rolled by some degrees. One line is written for each case, with what odds.py looks at and what undoing the motion does.
A file that is there is gone on with. fit_odds.py fits what odds.py knows to it.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.estimators.base import View
from unshutter.estimators.lines.segments import unusable
from unshutter.estimators.methods.segment_manhattan import SegmentManhattan
from unshutter.estimators.register import method
from unshutter.estimators.right_angles.odds import figures
from unshutter.estimators.right_angles.search import displacement
from unshutter.estimators.right_angles.view import LARGEST, LEAST_GAIN, segments_of
from unshutter.motion import Motion, RowMotion
from unshutter.photo import Photo
from unshutter_lab.evaluation.cases.case import in_8_bits
from unshutter_lab.evaluation.cases.folders import logs_in, photos_in
from unshutter_lab.evaluation.cases.synthetic import Suite, SyntheticCase
from unshutter_lab.evaluation.metrics import motion_error

MOVED = [
    Suite("256 px", of_pictures=False),
    Suite("native size", rows=None, of_pictures=False),
    Suite("portrait", turned=1, orientation=6, of_pictures=False),
    Suite("50 ms", readout_s=0.05, of_pictures=False),
    Suite("20 ms", readout_s=0.02, of_pictures=False),
]
STILL = [
    Suite("still 256 px", still=True),
    Suite("still native size", rows=None, still=True),
    Suite("still portrait", still=True, turned=1, orientation=6),
]
CROPS = 8  # of each photo that is taken as it is
_LONGEST_SIDE = 900  # of a crop [px]


class Recording(SegmentManhattan):
    """segment-manhattan without its judgement: every motion is given, and what it was found from is kept."""

    figures: dict[str, float] | None = None

    def estimate(self, view: View) -> Motion:
        """The posterior's mean, whatever speaks against it."""
        self.figures = None
        segments, size = segments_of(view)
        if unusable(segments, view.height, view.width):
            return view.no_motion(self.name, "unusable")
        posterior, answer = self.weigh(view, segments, size)
        if posterior.lines_gain < LEAST_GAIN or displacement(posterior.motion) > LARGEST:
            return view.no_motion(self.name, "declined")
        self.figures = figures(posterior, answer)
        return view.cubic_motion(posterior.motion.reshape(2, 3), self.name, 1.0)


@cache
def _estimator() -> Recording:
    known = method("segment-manhattan")
    estimator = Recording(known, known.weights)
    estimator.prepare()
    return estimator


def moved(case: SyntheticCase) -> dict[str, object] | None:
    """What is found of a photo with a known motion (or none)."""
    try:
        (record,) = case.judge(["segment-manhattan"], lambda _: _estimator())
    except UnshutterError:
        return None
    return _line(case.key, case.suite.name, case.photo, record["epe"], record["epe_nothing"])


def as_it_is(task: tuple[str, str, Path]) -> dict[str, object] | None:
    """What is found of a photo in which nothing moved."""
    suite, name, path = task
    try:
        view = View(Photo.open(path))
        error = motion_error(_estimator().estimate(view), RowMotion.zero(view.height, view.width)).epe
    except UnshutterError:
        return None
    return _line(f"{suite}|{path.stem}", suite, name, error, 0.0)


def _line(key: str, suite: str, photo: str, error: float, nothing: float) -> dict[str, object]:
    found = _estimator().figures
    return {"key": key, "suite": suite, "photo": photo, "error": error, "nothing": nothing, "figures": found}


def crops_of(photo: Path, into: Path) -> list[Path]:
    """Parts of a photo as another camera may have seen them, held a little askew: PNG files."""
    opened = Photo.open(photo)
    pixels = np.broadcast_to(in_8_bits(opened), (opened.height, opened.width, 3))
    rng = np.random.default_rng(sum(photo.name.encode()))
    rows, columns = pixels.shape[:2]
    made = []
    for k in range(CROPS):
        share, roll_deg = rng.uniform(0.55, 0.85), rng.normal(0, 3)
        height, width = int(rows * share), int(columns * share)
        scale = min(1, _LONGEST_SIDE / max(height, width))
        middle = [columns / 2 + rng.uniform(-0.3, 0.3) * (columns - width)]
        middle += [rows / 2 + rng.uniform(-0.3, 0.3) * (rows - height)]
        size = (int(width * scale), int(height * scale))
        matrix = cv2.getRotationMatrix2D((middle[0], middle[1]), roll_deg, scale)
        matrix[:, 2] += np.array(size) / 2 - middle
        small = cv2.GaussianBlur(pixels, (0, 0), 0.5 / scale) if scale < 1 else pixels
        crop = cv2.warpAffine(small, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        crop = crop[:, ::-1] if rng.random() < 0.5 else crop
        path = into / f"{photo.stem}_{k}.png"
        replace(Photo.from_array(np.ascontiguousarray(crop)), orientation=opened.orientation).save(path)
        made.append(path)
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--moved", type=Path, nargs="+", default=[])
    parser.add_argument("--as-they-are", type=Path, nargs="+", default=[])
    parser.add_argument("--photos", type=int, help="at most so many of each folder of --moved")
    parser.add_argument("--logs", type=Path, help="folder of recorded motions", required=True)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    done = {json.loads(line)["key"] for line in given.out.open()} if given.out.exists() else set()
    with tempfile.TemporaryDirectory() as crops, given.out.open("a") as out:
        cases = [case for folder in given.moved for case in _moved(folder, given.photos, logs_in(given.logs))]
        tasks = [task for folder in given.as_they_are for task in _as_they_are(folder, Path(crops))]
        with multiprocessing.get_context("spawn").Pool(given.jobs) as pool:
            for work, todo in ((as_it_is, tasks), (moved, cases)):
                left = [each for each in todo if _key(each) not in done]
                for line in pool.imap(work, left, chunksize=4):  # type: ignore[arg-type]
                    if line:
                        out.write(json.dumps(line) + "\n")
                        out.flush()


def _key(task: SyntheticCase | tuple[str, str, Path]) -> str:
    return task.key if isinstance(task, SyntheticCase) else f"{task[0]}|{task[2].stem}"


def _moved(folder: Path, photos: int | None, logs: tuple[Path, ...]) -> list[SyntheticCase]:
    return [
        SyntheticCase(suite, folder.name, path.name, path, 0, 0, logs)
        for path in photos_in(folder, photos, 0)
        for suite in (*MOVED, *STILL)
    ]


def _as_they_are(folder: Path, into: Path) -> list[tuple[str, str, Path]]:
    return [
        task
        for path in photos_in(folder, None, 0)
        for task in (("whole", path.name, path), *(("crop", path.name, crop) for crop in crops_of(path, into)))
    ]


if __name__ == "__main__":
    main()
