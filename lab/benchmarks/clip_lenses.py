"""Measures what ``unshutter video`` gains on clips of wide lenses, with readout time and lens given or found.

    python lab/benchmarks/clip_lenses.py PHOTO LOG.npz ... [--frames 60] [--before FOLDER] [--only 1 2]

Each clip is the photo around a camera that turns as the log says, seen through a lens of 90 to 150 degrees (from
corner to corner); the photo is as this lens shows it. Its twin has the same focal length, but no distortion. Reported:
PSNR of luma against the true global-shutter clip [dB, without a border of 6 %]; the readout ratio; and the error of the
lens at the corner: where the true direction of a corner is seen, as a share of its distance from the middle.
``--before`` names the ``src`` folder of another version: what that does with the same clip.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unshutter.motion.lens import Lens
from unshutter.photo import Photo
from unshutter_lab.evaluation.clip_wobble import grey_frames
from unshutter_lab.evaluation.metrics import psnr
from unshutter_lab.synthesis.clip import write_video
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, FPS, NOISE = 360, 640, 30.0, 2.0


@dataclass(frozen=True)
class Case:
    """A lens, a readout time and a recorded shake."""

    degrees: float  # field of view from corner to corner
    k: tuple[float, float, float, float]
    ratio: float
    log: int
    seed: int

    @property
    def lens(self) -> Lens:
        """The lens."""
        shape = Lens(1.0, self.k)
        return replace(
            shape, focal=float(np.hypot(1, WIDTH / HEIGHT) / 2 / shape.distance(np.radians(self.degrees / 2)))
        )


# the coefficients are like those of action cameras, drones and phones in Gyroflow's collection
CASES = (
    Case(90, (0.25, 0.07, 0.01, 0.0), 0.5, 0, 1),
    Case(95, (0.10, 0.02, 0.0, 0.0), 0.8, 1, 2),
    Case(104, (0.04, 0.01, -0.006, 0.002), 0.3, 0, 3),
    Case(115, (0.17, -0.02, 0.01, 0.0), 0.6, 2, 4),
    Case(122, (0.05, 0.012, -0.01, 0.003), 0.9, 0, 5),
    Case(133, (0.03, 0.01, -0.01, 0.002), 0.5, 1, 6),
    Case(140, (0.0, 0.0, 0.0, 0.0), 0.7, 2, 7),
    Case(150, (-0.03, 0.005, -0.002, 0.0), 0.4, 0, 8),
)


def rectified(clip: Path, out: Path, source: str | None, *flags: str) -> dict:
    """The record of a run, with the output in ``out``."""
    log = out.with_suffix(".jsonl")
    command = [sys.executable, "-m", "unshutter", "video", str(clip), "-o", str(out), "--json-log", str(log)]
    command += ["--edges", "fill", *flags]  # the truth is not enlarged
    paths = {} if source is None else {"PYTHONPATH": source}
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **paths})
    if done.returncode:
        sys.exit(done.stderr)
    print(out.stem, done.stderr.splitlines()[0] if done.stderr else "", file=sys.stderr)
    return json.loads(log.read_text().splitlines()[-1])


def mean_psnr(path: Path, truth: Path) -> float:
    """Returns the mean PSNR of luma [dB], without a border of 6 %."""
    border = round(0.06 * HEIGHT)
    inner = np.zeros((HEIGHT, WIDTH), bool)
    inner[border:-border, border:-border] = True
    pairs = zip(grey_frames(path), grey_frames(truth), strict=True)
    return float(np.mean([psnr(one, other, inner) for (_, one), (_, other) in pairs]))


def lens_error(found: dict | None, truth: Lens) -> float:
    """Returns where the lens found sees the corner's true direction, as a share of its true distance."""
    if not found:
        return np.nan
    corner = np.hypot(1, WIDTH / HEIGHT) / 2
    lens = Lens.of_json(found)
    return float(lens.distance(truth.angle(corner / truth.focal)) * lens.focal / corner - 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--before")
    parser.add_argument("--keep", type=Path, help="keep the clips in this folder, and use those that it has")
    parser.add_argument("--only", type=int, nargs="+", default=range(1, len(CASES) + 1))
    parser.add_argument("--ways", nargs="+", default=["twin", "before", "given", "ratio", "found"])
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for number in given.only:
            report(number, CASES[number - 1], given, given.keep or Path(name))


def report(number: int, case: Case, given: argparse.Namespace, folder: Path) -> None:
    pixels = Photo.open(given.photo).to_array()[..., :3]
    log = RotationLog.load_steady(given.logs[case.log % len(given.logs)])
    focal = case.lens.focal * HEIGHT
    size = {"height": HEIGHT, "width": WIDTH, "focal_px": focal, "readout_ratio": case.ratio}
    made = {}
    straight = RotatingCamera.drawn(np.random.default_rng(case.seed), log, given.frames, fps=FPS, **size)
    for kind, camera in (("wide", replace(straight, lens=case.lens)), ("twin", straight)):
        for shutter in ("rs", "gs"):
            made[kind, shutter] = folder / f"{number}-{kind}-{shutter}.mp4"
            if not made[kind, shutter].exists():
                frames = camera.rendered(pixels, NOISE, case.seed, global_shutter=shutter == "gs")
                write_video(str(made[kind, shutter]), frames, camera, crf=16, sound=False)
    lens_file = folder / f"{number}.json"
    matrix = [[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]]
    lens = {"calib_dimension": {"w": WIDTH, "h": HEIGHT}, "fisheye_params": {"camera_matrix": matrix}}
    lens["fisheye_params"]["distortion_coeffs"] = list(case.k)
    lens_file.write_text(json.dumps(lens))
    ratio, lens_of = ("--readout-ratio", str(case.ratio)), ("--lens", str(lens_file))
    ways = {
        "twin": ("twin", None, ratio),
        "twin found": ("twin", None, ()),
        "before": ("wide", given.before, ()),
        "before, ratio": ("wide", given.before, ratio),
        "given": ("wide", None, (*ratio, *lens_of)),
        "lens": ("wide", None, lens_of),
        "ratio": ("wide", None, ratio),
        "found": ("wide", None, ()),
    }
    for way in given.ways:
        kind, source, flags = ways[way]
        out = folder / f"{number}-{way.replace(', ', '-').replace(' ', '-')}.mp4"
        done = rectified(made[kind, "rs"], out, source, "--overwrite", *flags)
        before, after = (mean_psnr(path, made[kind, "gs"]) for path in (made[kind, "rs"], out))
        off = lens_error(done.get("lens"), case.lens)
        ratio_said = f"{done['readout_ratio']:.3f} ({case.ratio})"
        print(f"| {number} | {case.degrees} | {way} | {before:.1f} | {after:.1f} | {after - before:+.2f} | ", end="")
        print(f"{ratio_said} | {100 * off:+.2f} % | {done['rectified']} |", flush=True)


if __name__ == "__main__":
    main()
