"""Measures how upright ``rectify --upright`` makes photos of cameras held askew, with and without motion.

    python lab/benchmarks/upright.py FOLDER... [--logs FOLDER] [--sheet FILE.png]

Photos are turned by up to 5 degrees and cropped to their middle, as they are or distorted by a motion (drawn, or
recorded with a readout of 50 ms). The truth is how the camera of the undistorted photo was held, as its right angles
show; photos without any are passed over. Verticals and level lines (parallel to the picture) of the true scene are
followed through distortion and correction at 25 places: what they lean or slope afterwards [degrees], median and 90th
percentile of all photos. Without `full`, verticals are those in the middle column, because the others may converge.
*Offered* are photos that are left unchanged and said to lean. Last, how often that is said of photos that lean.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from unshutter.motion import Motion, RowMotion
from unshutter.motion.grid import gs_to_rs_map, rs_to_gs_map
from unshutter.motion.upright import Pose
from unshutter.motion.verdict import judge
from unshutter.options import Camera, Undo
from unshutter.photo import Photo
from unshutter.rectification.rectified import render
from unshutter.single.estimator import View
from unshutter.single.methods import find_candidates
from unshutter.single.register import load
from unshutter_lab.evaluation.case import in_8_bits
from unshutter_lab.synthesis.pairs import synthesize_native
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import DrawnMotion, draw_from_trajectory, draw_quadratic

_MOST_ROLL_DEG = 5.0
_ROWS, _CANVAS = 256, 356
_MOST_TILT_DEG = 25.0  # of the photos that are measured: more is left to the user
_STEP = 4.0  # px on each side of a place, along a line


def main() -> None:
    """Prints a row for each condition and kind of correction."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--logs", type=Path, help="folder of recorded motions")
    parser.add_argument("--photos", type=int, default=1000, help="at most")
    parser.add_argument("--sheet", type=Path, help="write ten results to look at: before, without, level, full")
    arguments = parser.parse_args()
    logs = sorted(arguments.logs.glob("*.npz")) if arguments.logs else []
    estimator, rows, pictures, leaning = load(), defaultdict(list), [], defaultdict(list)
    paths = sorted(path for folder in arguments.folders for path in folder.rglob("*.jpg"))[: arguments.photos]
    for number, path in enumerate(paths):
        photo = Photo.open(path)
        held = find_candidates(estimator, View(photo))[0].finding.held_at_rest
        if held is None or held.tilt_deg is None or max(abs(held.tilt_deg), 3 * abs(held.roll_deg)) > _MOST_TILT_DEG:
            continue
        for kind in ["still", "drawn", "recorded"][: 3 if logs else 2]:
            rng = np.random.default_rng([number, 0, len(kind)])
            roll = rng.uniform(-_MOST_ROLL_DEG, _MOST_ROLL_DEG)
            rs, truth = _taken(photo, roll, _motion(kind, rng, logs))
            true = replace(held, roll_deg=held.roll_deg + roll, focal=held.focal * photo.height / len(rs))
            view = View(Photo.from_array(rs), Camera(focal_px=View(photo).known_focal_px()), View(photo).focal_px())
            found, shown = find_candidates(estimator, view)[0].finding, [rs]
            offered = judge(found.fit(*rs.shape[:2]), Undo()).lean is not None
            for wish in (None, "level", "full"):
                verdict = judge(found.fit(*rs.shape[:2]), Undo(upright=wish))
                done = render(view.photo, verdict, "keep")
                errors = _left(done.motion, verdict.upright, truth, true, wish != "full")
                if wish is None and not verdict.changes:
                    leaning["leans" if errors[0] > 1 else "upright"].append(offered)
                done_with = f"{kind}, {'moved' if verdict.undoes else 'left'}"
                for name in (kind, done_with, "offered" if offered else "not offered"):
                    rows[name, wish].append(errors)
                shown.append(done.pixels)
            pictures.append((f"{path.stem} {kind} {roll:+.1f}", shown, errors))
    for (name, wish), listed in sorted(rows.items(), key=str):
        (lean, slope), (most_lean, most_slope) = np.median(listed, axis=0), np.quantile(listed, 0.9, axis=0)
        figures = f"{lean:.2f} ({most_lean:.2f}) | {slope:.2f} ({most_slope:.2f})"
        print(f"| {name} | {wish or 'without'} | {len(listed)} | {figures} |")
    for name, of in leaning.items():
        print(f"left unchanged, {name}: {len(of)}, of which {np.mean(of):.2f} are said to lean")
    if arguments.sheet:
        _save_sheet(pictures, arguments.sheet)


def _motion(kind: str, rng: np.random.Generator, logs: list[Path]) -> DrawnMotion:
    if kind == "recorded":
        log = RotationLog.load(logs[int(rng.integers(len(logs)))])
        return draw_from_trajectory(rng, log, 0.05, _ROWS, _ROWS, _CANVAS)
    drawn = draw_quadratic(rng, _ROWS, _CANVAS)
    if kind == "drawn":
        return drawn
    return DrawnMotion(RowMotion.zero(_CANVAS, _CANVAS), RowMotion.zero(_ROWS, _ROWS), {})


def _taken(photo: Photo, roll_deg: float, drawn: DrawnMotion) -> tuple[np.ndarray, Motion]:
    """Returns the picture of a camera that was turned clockwise and moved, and its true motion."""
    pixels = in_8_bits(photo)
    pixels = np.broadcast_to(pixels, (*pixels.shape[:2], 3))
    rows, columns = pixels.shape[:2]
    matrix = cv2.getRotationMatrix2D(((columns - 1) / 2, (rows - 1) / 2), roll_deg, 1)  # counter-clockwise
    turned = cv2.warpAffine(
        np.ascontiguousarray(pixels), matrix, (columns, rows), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )
    rs, gs, truth = synthesize_native(turned, drawn)
    return (gs if drawn.crop.is_zero else rs), truth


def _left(motion: Motion, upright: Pose | None, truth: Motion, held: Pose, level: bool) -> np.ndarray:
    """Returns how far verticals lean and level lines slope in the result, mean of absolute values [degrees]."""
    height, width = truth.height, truth.width
    col, row = (a.ravel() for a in np.meshgrid(*(np.linspace(0.1, 0.9, 5) * (side - 1) for side in (width, height))))
    there = rs_to_gs_map(truth, held)(col, row)
    seen, back = gs_to_rs_map(truth, held), rs_to_gs_map(motion, upright)
    angles = []
    for right, down in ((0.0, _STEP), (_STEP, 0.0)):
        ends = [back(*seen(there[0] + side * right, there[1] + side * down)) for side in (-1, 1)]
        across, along = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
        angles.append(np.degrees(np.arctan2(across, along) if down else np.arctan2(along, across)))
    middle = angles[0].reshape(5, 5)[:, 2] if level else angles[0]
    return np.array([np.abs(middle).mean(), np.abs(angles[1]).mean()])


def _save_sheet(pictures: list, path: Path) -> None:
    chosen = [pictures[k] for k in np.linspace(0, len(pictures) - 1, 10).astype(int)]
    strips = []
    for label, shown, errors in chosen:
        strip = cv2.resize(np.concatenate([np.broadcast_to(each, shown[0].shape) for each in shown], 1), (1600, 400))
        for x in range(0, 1600, 40):
            strip[:, x] = strip[:, x] // 2 + 64
        cv2.putText(strip, f"{label} {errors.round(2)}", (4, 16), 0, 0.5, (255, 0, 0), 1)
        strips.append(strip)
    for k in (0, 5):
        Photo.from_array(np.concatenate(strips[k : k + 5])).save(
            path.with_stem(f"{path.stem}{k}").with_suffix(".png"), overwrite=True
        )


if __name__ == "__main__":
    main()
