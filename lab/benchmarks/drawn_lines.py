"""How well photos that the program declines are straightened by lines that a person draws (docs/guide/by-hand.md).

    python lab/benchmarks/drawn_lines.py FOLDER... [--photos 20]

Distorted photos (suite `native`) that `unshutter rectify` leaves unchanged, though more than a pixel is wrong. The
drawn lines are simulated from the truth: the longest upright edges of the undistorted photo, apart from each other, and
the level edge that faces the camera most; where the motion puts them, as chords of at least a third of the picture's
rows, off by up to 0.3 degrees. Photos that show no such edges are passed over.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from unshutter.api import motion_of_lines
from unshutter.motion import Motion, RowMotion
from unshutter.motion.verdict import Verdict
from unshutter.options import Undo
from unshutter.photo import Photo
from unshutter.single.drawn_lines import DrawnLine
from unshutter.single.estimator import View
from unshutter.single.likelihood import AngleResiduals, EndPoints, VanishingPoints, likelihood_of, segments_of
from unshutter.single.methods import chosen, find_candidates
from unshutter.single.prior import CAMERA, LOG_FOCAL, ROLL, TILT, UNKNOWNS, YAW
from unshutter.single.register import load
from unshutter.single.search import descend
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.evaluation.synthetic import Exam, Suite, SyntheticCase

_DRAWS = 2  # motions of each photo
_OFF = math.radians(0.3)  # of a drawn line, at most
_SHORTEST, _APART, _EDGE = 0.35, 0.25, 0.12  # of a drawn line, between two, of an edge that is level [rows]
_ALONG = 0.012  # sine between an edge and the direction that it runs in
_LEAST_GAIN = -0.1  # of the lines over chance; below it, the camera is not known


def main() -> None:
    """Prints a row for each photo, and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--photos", type=int, default=20)
    arguments = parser.parse_args()
    errors = []
    print("| photo | unchanged | 2 upright, 1 level | 4 upright, 2 level |\n|---|---|---|---|")
    for name, exam in _declined(arguments.folders):
        row = _row(exam, len(errors))
        if row is not None:
            errors.append(row)
            print(f"| {name} | {' | '.join(f'{each:.2f}' for each in row)} |", flush=True)
        if len(errors) == arguments.photos:
            break
    print(f"| **median of {len(errors)}** | {' | '.join(f'{each:.2f}' for each in np.median(errors, axis=0))} |")


def _declined(folders: list[Path]) -> Iterator[tuple[str, Exam]]:
    """Distorted photos that are left unchanged, of each folder in turn."""
    estimator, suite = load(), Suite("native", rows=None)
    files = [sorted(path for path in folder.glob("*") if path.suffix.lower() in (".jpg", ".png")) for folder in folders]
    for draw in range(_DRAWS):
        for k in range(max(map(len, files))):
            for folder, paths in zip(folders, files, strict=True):
                if k >= len(paths):
                    continue
                exam = SyntheticCase(suite, folder.name, paths[k].name, paths[k], draw, 0).exam()
                motion = chosen(find_candidates(estimator, exam.view), None)
                if not Verdict.of(motion, Undo()).changes and _unchanged(exam) > 1:
                    yield f"{folder.name} {paths[k].stem} {draw + 1}", exam


def _unchanged(exam: Exam) -> float:
    return motion_error(RowMotion.zero(exam.truth.height, exam.truth.width), exam.truth).epe


def _row(exam: Exam, seed: int) -> tuple[float, ...] | None:
    """EPE [px of 256] unchanged, with few lines and with more; None where the photo shows no such edges."""
    edges = _edges(View(Photo.from_array(exam.gs), exam.view.camera, exam.view.guessed_focal_px))
    if edges is None:
        return None
    rng = np.random.default_rng(seed)
    upright, level = ([_drawn(each, kind, exam.truth, rng) for each in edges[kind]] for kind in ("upright", "level"))
    motions = (
        motion_of_lines(exam.photo, lines, exam.view.camera)
        for lines in ([*upright[:2], level[0]], [*upright[:4], *level[:2]])
    )
    return _unchanged(exam), *(motion_error(motion, exam.truth).epe for motion in motions)


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
    angle = rng.uniform(-_OFF, _OFF)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    seen = seen.mean(axis=0) + (seen - seen.mean(axis=0)) @ turn.T
    return DrawnLine(kind, tuple(map(tuple, seen.tolist())))  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
