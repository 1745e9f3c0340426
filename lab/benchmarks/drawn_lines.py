"""Measures how well lines that a person draws straighten photos (docs/guide/by-hand.md).

    python lab/benchmarks/drawn_lines.py FOLDER... [--photos 40] [--declined]

Distorted photos (suite `native`), with `--declined` only those that `unshutter rectify` leaves unchanged though more
than a pixel is wrong. The drawn lines are simulated from the truth: the longest upright edges of the undistorted photo,
apart from each other, and the level edge that faces the camera most; where the motion puts them, as chords of at least
a third of the picture's rows, each end off by half a pixel. Photos that show no such edges are passed over.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from unshutter.api import motion_of_lines
from unshutter.motion import Motion, RowMotion
from unshutter.motion.verdict import judge
from unshutter.options import Undo
from unshutter.photo import Photo
from unshutter.single.drawn_lines import DrawnLine
from unshutter.single.estimator import View
from unshutter.single.likelihood import AngleResiduals, EndPoints, VanishingPoints, likelihood_of, segments_of
from unshutter.single.methods import find_candidates
from unshutter.single.prior import CAMERA, LOG_FOCAL, ROLL, TILT, UNKNOWNS, YAW
from unshutter.single.register import load
from unshutter.single.search import descend
from unshutter_lab.evaluation.exam import Exam
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.evaluation.synthetic import Suite, SyntheticCase

_DRAWS = 2  # motions of each photo
_OFF_PX = 0.5  # standard deviation of each end of a drawn line
_COLUMNS = (
    "unchanged",
    *(
        f"{lines}{what}"
        for lines in ("1 upright", "2 upright", "2 upright, 1 level")
        for what in ("", ": left [degrees]", ": not met")
    ),
)
_SHORTEST, _APART, _EDGE = 0.35, 0.25, 0.12  # of a drawn line, between two, of an edge that is level [rows]
_ALONG = 0.012  # sine between an edge and the direction that it runs in
_LEAST_GAIN = -0.1  # of the lines over chance; below it, the camera is not known


def main() -> None:
    """Prints a row for each photo, the medians, and the largest of each column."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--photos", type=int, default=40)
    parser.add_argument("--declined", action="store_true")
    arguments = parser.parse_args()
    rows = []
    print(f"| photo | {' | '.join(_COLUMNS)} |\n|{'---|' * (len(_COLUMNS) + 1)}")
    for name, exam in _exams(arguments.folders, arguments.declined):
        row = _row(exam, len(rows))
        if row is not None:
            rows.append(row)
            print(f"| {name} | {' | '.join(f'{each:.2f}' for each in row)} |", flush=True)
        if len(rows) == arguments.photos:
            break
    for name, of in ((f"median of {len(rows)}", np.median), ("largest", np.max)):
        print(f"| **{name}** | {' | '.join(f'{each:.2f}' for each in of(rows, axis=0))} |")


def _exams(folders: list[Path], declined: bool) -> Iterator[tuple[str, Exam]]:
    """Distorted photos of each folder in turn."""
    estimator, suite = load(), Suite("native", rows=None)
    files = [sorted(path for path in folder.glob("*") if path.suffix.lower() in (".jpg", ".png")) for folder in folders]
    for draw in range(_DRAWS):
        for k in range(max(map(len, files))):
            for folder, paths in zip(folders, files, strict=True):
                if k >= len(paths):
                    continue
                exam = SyntheticCase(suite, folder.name, paths[k].name, paths[k], draw, 0).exam()
                if declined:
                    finding = find_candidates(estimator, exam.view)[0].finding
                    if judge(finding, Undo()).changes or _error(None, exam.truth) < 1:
                        continue
                yield f"{folder.name} {paths[k].stem} {draw + 1}", exam


def _error(motion: Motion | None, truth: Motion) -> float:
    """EPE [px of 256]; None: of the unchanged photo."""
    return motion_error(motion or RowMotion.zero(truth.height, truth.width), truth).epe


def _row(exam: Exam, seed: int) -> tuple[float, ...] | None:
    """Returns the columns for a photo; None where it shows no such edges."""
    edges = _edges(View(Photo.from_array(exam.gs), exam.view.camera, exam.view.guessed_focal_px))
    if edges is None:
        return None
    rng = np.random.default_rng(seed)
    upright, level = ([_drawn(each, kind, exam.truth, rng) for each in edges[kind]] for kind in ("upright", "level"))
    row = [_error(None, exam.truth)]
    for lines in (upright[:1], upright[:2], [*upright[:2], level[0]]):
        answer = motion_of_lines(exam.photo, lines, exam.view.camera)
        left = [abs(angle) for angle, trouble in zip(answer.left_deg, answer.troubles, strict=True) if trouble is None]
        row += [_error(answer.finding.motion, exam.truth), max(left, default=0.0), sum(map(bool, answer.troubles))]
    return tuple(row)


def _edges(view: View) -> dict[str, list[np.ndarray]] | None:
    """[2, 2] ends [px] of upright and level edges of an undistorted photo, the most telling first."""
    segments, size = segments_of(view)
    if len(segments) < 12:
        return None
    likelihood = likelihood_of(view, segments, size)
    yaw, tilt = (a.ravel() for a in np.meshgrid(np.arange(9) * (math.pi / 18), np.radians([-10, 0, 10, 25])))
    begin = np.zeros((len(yaw), UNKNOWNS))
    begin[:, YAW], begin[:, TILT], begin[:, LOG_FOCAL] = yaw, tilt, likelihood.prior.mean[LOG_FOCAL]
    cameras, energy, _ = descend(likelihood, begin, CAMERA)
    camera = cameras[np.argmin(energy)][None]
    if float(likelihood.lines_gain(camera)[0]) < _LEAST_GAIN:
        return None
    sine = np.abs(AngleResiduals((EndPoints(segments[:, :2]), EndPoints(segments[:, 2:])), camera).sine[0])
    x, y, z = (component[0, :, 0] for component in VanishingPoints(camera).v)
    middle, length = (segments[:, :2] + segments[:, 2:]) / 2, np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    direction = sine.argmin(axis=0)
    way = np.stack([x[direction] - z[direction] * middle[:, 0], y[direction] - z[direction] * middle[:, 1]], axis=1)
    way /= np.hypot(*way.T)[:, None]
    slope = np.abs((np.arctan2(way[:, 1], way[:, 0]) - camera[0, ROLL] + math.pi / 2) % math.pi - math.pi / 2)
    fits = sine.min(axis=0) < _ALONG
    upright = _apart(middle, np.flatnonzero(fits & (direction == 0))[np.argsort(-length[fits & (direction == 0)])])
    level = np.flatnonzero(fits & (direction > 0) & (length > _EDGE))
    level = _apart(middle, level[np.argsort(slope[level] + 0.01 * np.minimum(0.3 / length[level], 3))])
    if len(upright) < 2 or not level:
        return None
    half = np.maximum(length, _SHORTEST)[:, None] / 2
    ends = np.stack([middle - half * way, middle + half * way], axis=1) * view.height
    ends += [(view.width - 1) / 2, (view.height - 1) / 2]
    return {"upright": [ends[k] for k in upright], "level": [ends[k] for k in level]}


def _apart(middle: np.ndarray, ranked: np.ndarray) -> list[int]:
    kept: list[int] = []
    for k in ranked:
        if all(np.hypot(*(middle[k] - middle[j])) > _APART for j in kept):
            kept.append(int(k))
    return kept


def _drawn(ends: np.ndarray, kind: str, motion: Motion, rng: np.random.Generator) -> DrawnLine:
    """The chord of an edge as the rolling shutter shows it, within the picture, turned a little."""
    middle, last = ends.mean(axis=0), np.array([motion.width - 1, motion.height - 1])
    for share in np.linspace(1, 0.1, 19):
        seen = np.stack(motion.gs_to_rs(*(middle + share * (ends - middle)).T), axis=1)
        if (seen >= 0).all() and (seen <= last).all():
            break
    seen = seen + rng.normal(0, _OFF_PX, seen.shape)
    return DrawnLine(kind, tuple(map(tuple, seen.tolist())))  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
