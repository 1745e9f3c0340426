"""Measures what the photos of a burst gain from one another, by photos per second.

    python lab/benchmarks/clip_bursts.py PHOTO LOG.npz ... [--photos 5] [--readout-ms 20] [--alone]

Each burst is the photo around a camera that turns as the log says, read out in a time that ``rectify`` is not told: it
takes that of phones, 20 ms. Intervals of up to half a second are allowed here, to show where the gain ends. Reported,
over all photos of all bursts: the mean distance of rows from where they belong [px of 256 rows], as taken, in bursts,
and with ``--alone`` each by itself; and the shares of photos that are better and worse by more than 0.3 px.
"""

from __future__ import annotations

import argparse
import tempfile
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from unshutter.cli import main as unshutter
from unshutter.motion.finding import Finding
from unshutter.photo import Photo
from unshutter.reasons import MotionSource
from unshutter.run import bursts
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, FOCAL, NOISE = 360, 480, 430.0, 2.0
RATES = (30, 20, 15, 10, 8, 5, 4, 3)  # photos a second
START, EXIF = datetime(2024, 5, 6, 7, 8, 9, 123_000), 0x8769
LARGE = 0.3  # px


def write(folder: Path, frames: list[np.ndarray], rate: float) -> None:
    folder.mkdir()
    for k, frame in enumerate(frames):
        tags, at = Image.Exif(), START + timedelta(seconds=k / rate)
        tags.update({0x010F: "Apple", 0x0110: "iPhone 12"})
        time = {0x9003: at.strftime("%Y:%m:%d %H:%M:%S"), 0x9291: f"{at:%f}"[:3]}
        tags.get_ifd(EXIF).update({0x829A: IFDRational(1, 200), **time})
        Image.fromarray(frame).save(folder / f"{k}.jpg", quality=92, exif=tags)


def errors(folder: Path, out: Path, camera: RotatingCamera, *flags: str) -> list[float]:
    """Error of the motion found of each photo [px of 256 rows]; NaN for one that was judged by itself in a burst."""
    words = ["rectify", str(folder), "-o", str(out), "--save-motion", str(out), "--focal-px", str(FOCAL), *flags]
    assert unshutter(words) == 0
    findings = [Finding.load(out / f"{k}.json") for k in range(camera.frames)]
    by_burst = [found.source is MotionSource.NEIGHBOURS for found in findings]
    errors = [motion_error(found.motion, camera.motion(k)).epe for k, found in enumerate(findings)]
    return [error if flags or used else np.nan for error, used in zip(errors, by_burst, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--photos", type=int, default=5)
    parser.add_argument("--readout-ms", type=float, default=20.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rates", type=int, nargs="+", default=RATES)
    parser.add_argument("--alone", action="store_true")
    given = parser.parse_args()
    bursts._LONGEST_S = bursts._LONGEST_OF_TWO_S = 0.501
    pixels = Photo.open(given.photo).to_array()[..., :3]
    size = {"height": HEIGHT, "width": WIDTH, "focal_px": FOCAL}
    print("| photos a second | as taken | in a burst | alone | found | better | worse |\n|---|---|---|---|---|---|---|")
    for rate in given.rates:
        rows = []
        for number, log in enumerate(map(RotationLog.load_steady, given.logs)):
            for seed in range(given.seeds):
                ratio = given.readout_ms / 1000 * rate
                generator = np.random.default_rng(100 * number + seed)
                camera = RotatingCamera.drawn(generator, log, given.photos, fps=rate, readout_ratio=ratio, **size)
                with tempfile.TemporaryDirectory() as name:
                    folder = Path(name) / "in"
                    write(folder, list(camera.rendered(pixels, NOISE, seed)), rate)
                    still = [
                        motion_error(camera.motion(k).scaled(0), camera.motion(k)).epe for k in range(given.photos)
                    ]
                    together = errors(folder, Path(name) / "burst", camera)
                    alone = errors(folder, Path(name) / "alone", camera, "--each-alone") if given.alone else still
                rows += zip(still, together, alone, strict=True)
        before, after, alone = np.array(rows).T
        used = np.isfinite(after)
        better, worse = (np.mean(sign * (before - after)[used] > LARGE) for sign in (1, -1))
        figures = f"{before[used].mean():.2f} | {after[used].mean():.2f} | {alone[used].mean():.2f}"
        print(f"| {rate} | {figures} | {used.mean():.2f} | {better:.2f} | {worse:.2f} |", flush=True)


if __name__ == "__main__":
    main()
