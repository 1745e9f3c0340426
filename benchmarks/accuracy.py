"""How far the estimators are from the truth, on any folders of undistorted photos.

    python benchmarks/accuracy.py PHOTOS... [--estimators a,b] [--per-photo 2] [--seed 0] [-o results.json]

Three suites for each folder, after docs/results: synthetic quadratic motions at 256 px, the same motions at the
photos' native size, and the photos as they are (do no harm). Prints Markdown; -o also writes every figure as JSON.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import unshutter
from unshutter.batch import find_photos
from unshutter.estimators import DEFAULT, View
from unshutter.metrics import motion_error
from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter.synthesis.pairs import synthesize, synthesize_native
from unshutter.synthesis.row_motions import draw_quadratic

SUITES = ("256 px", "native size", "undistorted")


def pairs(photo: Path, index: int, per_photo: int, seed: int, suite: str):
    """The (picture, true motion) of one photo in one suite; the same draws in the first two."""
    pixels = Photo.open(photo).to_array()
    for k in range(1 if suite == "undistorted" else per_photo):
        drawn = draw_quadratic(np.random.default_rng([seed, index, k]))
        if suite == "256 px":
            yield synthesize(pixels, drawn)[0], drawn.crop
        elif suite == "native size":
            rs, _, motion = synthesize_native(pixels, drawn)
            yield rs, motion
        else:
            gs = synthesize(pixels, drawn)[1]
            yield gs, Motion.zero(*gs.shape[:2])


def measure(photos: list[Path], estimator_name: str, suite: str, per_photo: int, seed: int) -> list[dict]:
    """One record a picture."""
    estimator = unshutter.load(estimator_name)
    records = []
    for index, photo in enumerate(photos):
        for k, (picture, truth) in enumerate(pairs(photo, index, per_photo, seed, suite)):
            start = time.perf_counter()
            found = estimator.estimate(View(Photo.from_array(picture)))
            seconds = time.perf_counter() - start
            error = motion_error(found, truth)
            nothing = motion_error(Motion.zero(truth.height, truth.width), truth)
            records.append(
                {
                    "photo": photo.name,
                    "draw": k,
                    "epe": error.epe,
                    "epe_nothing": nothing.epe,
                    "curvature_epe": error.curvature_epe,
                    "tx_rmse": error.tx_rmse,
                    "rz_rmse": error.rz_rmse,
                    "most_tx": float(np.abs(found.tx_px).max()) * 256 / truth.height,
                    "most_rz": float(np.degrees(np.abs(found.rz_rad).max())),
                    "declined": found.reason,
                    "seconds": seconds,
                }
            )
    return records


def table(results: dict) -> str:
    """Markdown of all results."""
    lines = []
    for suite in SUITES[:2]:
        lines += [
            f"\n### Synthetic quadratic motions, {suite}\n",
            "| photos | estimator | pictures | EPE median | mean | p90 | doing nothing | improved |"
            " EPE, shear known | t_x RMSE | r_z RMSE |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
        ]
        for (folder, estimator), suites in results.items():
            r = suites[suite]
            epe, nothing = (np.array([x[key] for x in r]) for key in ("epe", "epe_nothing"))
            curvature, tx, rz = (np.median([x[key] for x in r]) for key in ("curvature_epe", "tx_rmse", "rz_rmse"))
            lines.append(
                f"| {folder} | {estimator} | {len(r)} | **{np.median(epe):.2f}** | {epe.mean():.2f} |"
                f" {np.percentile(epe, 90):.2f} | {np.median(nothing):.2f} | {(epe < nothing).mean():.0%} |"
                f" {curvature:.2f} | {tx:.2f} px | {rz:.2f}° |"
            )
    lines += [
        "\n### Undistorted photos: do no harm\n",
        "| photos | estimator | pictures | max\\|t_x\\| median | p90 | max\\|r_z\\| median | p90 | EPE > 3 px |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (folder, estimator), suites in results.items():
        r = suites[SUITES[2]]
        tx, rz, epe = (np.array([x[key] for x in r]) for key in ("most_tx", "most_rz", "epe"))
        lines.append(
            f"| {folder} | {estimator} | {len(r)} | {np.median(tx):.2f} px | {np.percentile(tx, 90):.2f} px |"
            f" {np.median(rz):.2f}° | {np.percentile(rz, 90):.2f}° | {(epe > 3).mean():.0%} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--estimators", default=DEFAULT)
    parser.add_argument("--per-photo", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path)
    given = parser.parse_args()
    results = {}
    for folder in given.folders:
        photos, _ = find_photos([folder] if any(folder.glob("*.*")) else sorted(p for p in folder.iterdir()))
        for estimator in given.estimators.split(","):
            results[folder.name, estimator] = {
                suite: measure(photos, estimator, suite, given.per_photo, given.seed) for suite in SUITES
            }
            print(f"{folder.name} {estimator} done", file=sys.stderr)
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    print(f"Commit {commit}, {platform.machine()}, Python {platform.python_version()}, seed {given.seed}.")
    print(table(results))
    if given.output:
        flat = [{"photos": f, "estimator": e, **suites} for (f, e), suites in results.items()]
        given.output.write_text(json.dumps({"commit": commit, "seed": given.seed, "results": flat}, indent=1))


if __name__ == "__main__":
    main()
