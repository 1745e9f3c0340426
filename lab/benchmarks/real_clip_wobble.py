"""How much real clips wobble before and after ``unshutter video``, and after FFmpeg's ``deshake`` and vid.stab.

    PYTHONPATH=benchmarks python lab/benchmarks/real_clip_wobble.py CLIP... [--end 5] [--others] [--keep FOLDER]

For each clip: its readout ratio by regression (``unshutter.video.readout_regression``), with tracks of its own: corners
of frames of at most 960 px, followed forwards and back, of which most agree with an affine motion; then, in pixels of
the clip, skew and stretch from frame to frame at the first and last rows, apart from what depth adds (a constant, and
what follows the speed): root mean square, 95th percentile and largest. And sharpness: variance of the Laplacian of the
result, divided by that of a copy that is encoded in the same way. Clips that wobble more afterwards are marked.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from shutil import which

import av
import cv2
import numpy as np

from unshutter.frames.tracks import Tracks
from unshutter.video.frame_steps import StepSizes
from unshutter.video.readout_regression import PairMotion, Run, regression, runs_of

LONG_SIDE, CORNERS, RETURNS_PX = 960, 700, 0.25
BORDER = 8  # px
RANSAC_PX, AGREEING = 2.5, 0.3
HEAD = (
    "| clip | ratio (t) | found | rms, px: before, after | 95 % | largest | sharpness | result |\n"
    "|---|---|---|---|---|---|---|---|"
)
OTHERS = {"deshake": "deshake", "vid.stab": "vidstabtransform=smoothing=15:input={}"}


def frames_of(path: Path, end_s: float) -> Iterator[tuple[float, np.ndarray]]:
    """Yields the time [s] of each frame, and the frame in grey."""
    with av.open(str(path), metadata_errors="ignore") as film:
        stream = film.streams.video[0]
        rate = float(stream.average_rate or 30)
        for number, frame in enumerate(film.decode(stream)):
            if number >= end_s * rate:
                return
            yield frame.time if frame.time is not None else number / rate, frame.to_ndarray(format="gray")


def followed(before: np.ndarray, after: np.ndarray) -> Tracks | None:
    """Returns the corners of a frame that are found in the next one and back, and agree with most of the others."""
    corners = cv2.goodFeaturesToTrack(before, CORNERS, 0.005, 9, blockSize=5)
    if corners is None:
        return None
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.003)
    settings = {"winSize": (17, 17), "maxLevel": 4, "criteria": until, "minEigThreshold": 1e-3}
    there, good, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, corners.copy(), **settings)
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, there.copy(), **settings)
    height, width = before.shape
    end = there[:, 0].astype(np.float64)
    kept = (good[:, 0] > 0) & (good_back[:, 0] > 0) & (np.hypot(*(back - corners)[:, 0].T) < RETURNS_PX)
    kept &= (end > BORDER).all(axis=1) & (end < [width - BORDER - 1, height - BORDER - 1]).all(axis=1)
    start, end = corners[kept, 0].astype(np.float64), end[kept]
    if len(start) < 40:
        return None
    agreeing = cv2.estimateAffine2D(start, end, ransacReprojThreshold=RANSAC_PX, maxIters=500)[1]
    chosen = agreeing[:, 0] > 0
    if chosen.sum() < max(40, AGREEING * len(start)):
        return None
    return Tracks(start[chosen], end[chosen], height, width, len(corners))


def measured(path: Path, end_s: float) -> tuple[list[Run], float, float]:
    """Returns the runs of a clip, pixels of the clip for each of theirs, and its sharpness."""
    pairs: list[tuple[PairMotion | None, float]] = []
    times: list[float] = []
    sharpness: list[float] = []
    last: np.ndarray | None = None
    scale, aspect = 1.0, 1.0
    for time_s, grey in frames_of(path, end_s):
        shrink = min(1.0, LONG_SIDE / max(grey.shape))
        scale, aspect = 1 / shrink, grey.shape[0] / grey.shape[1]
        small = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA) if shrink < 1 else grey
        small = np.ascontiguousarray(small)
        if last is not None:
            if np.mean(cv2.absdiff(small, last) > 2) < 0.002:  # a copy of the frame before it
                continue
            tracks = followed(last, small)
            pairs.append((None if tracks is None else PairMotion.of(tracks), 1.0))
        if len(times) % 15 == 0:
            sharpness.append(float(cv2.Laplacian(grey[8:-8, 8:-8].astype(np.float32), cv2.CV_32F).var()))
        times.append(time_s)
        last = small
    gaps = np.diff(times)
    if len(gaps) and (gaps > 0).all():
        usual = float(np.median(gaps))
        pairs = [(pair, float(gap) / usual) for (pair, _), gap in zip(pairs, gaps, strict=True)]
    return runs_of(pairs, aspect), scale, float(np.median(sharpness))


def sizes_of(runs: list[Run], scale: float) -> StepSizes:
    """Returns how large the steps from frame to frame are [px of the clip]."""
    shapes = np.concatenate([run.shapes[run.used] for run in runs]) * scale
    return StepSizes.of(shapes, np.concatenate([run.shifts[run.used] for run in runs]) * scale)


def unshutter(source: Path, output: Path, end_s: float) -> tuple[str, str]:
    """Straightens a clip; returns the readout ratio that was found, and what the program says of the clip."""
    words = [sys.executable, "-m", "unshutter", "video", str(source), "-o", str(output), "--end", str(end_s)]
    done = subprocess.run([*words, "--overwrite"], capture_output=True, text=True, check=True)
    lines = done.stderr.replace("\r", "\n").splitlines()
    found = [line for line in lines if "readout time" in line]
    said = [line for line in lines if "->" in line]
    return (found[0].partition("readout time ")[2] if found else ""), said[-1].partition(": ")[2] if said else ""


def others(source: Path, folder: Path, end_s: float) -> Iterator[tuple[str, Path]]:
    """Yields what FFmpeg's stabilisers make of a clip, where FFmpeg has them."""
    if which("ffmpeg") is None:
        return
    for name, graph in OTHERS.items():
        out, transforms = folder / f"{source.stem}-{name}.mp4", folder / f"{source.stem}.trf"
        begin = ["ffmpeg", "-v", "error", "-y", "-t", str(end_s), "-i", str(source)]
        if name == "vid.stab":
            subprocess.run([*begin, "-vf", f"vidstabdetect=result={transforms}", "-f", "null", "-"], check=False)
        done = subprocess.run([*begin, "-vf", graph.format(transforms), "-crf", "18", str(out)], check=False)
        if done.returncode == 0:
            yield name, out


def row(name: str, before: tuple[list[Run], float, float], after: tuple[list[Run], float, float], *said: str) -> str:
    """Returns a line of the table."""
    was, now = sizes_of(*before[:2]), sizes_of(*after[:2])
    figures = [f"{a:.2f}, {b:.2f}" for a, b in zip(vars(was).values(), vars(now).values(), strict=True)]
    worse = now.rms > 1.05 * was.rms or now.largest > 1.1 * was.largest
    ratio, found, result = said
    cells = [name, ratio, found, *figures, f"{after[2] / before[2]:.2f}", ("**worse** " if worse else "") + result]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="+", type=Path)
    parser.add_argument("--end", type=float, default=5.0, help="seconds of each clip")
    parser.add_argument("--others", action="store_true", help="also FFmpeg's deshake and vid.stab")
    parser.add_argument("--keep", type=Path, help="folder for the results")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print(HEAD)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        for clip in options.clip:
            before = measured(clip, options.end)
            shown = regression(before[0])
            ratio = "" if shown is None else f"{shown.rows.ratio:.3f} ({shown.t:.0f})"
            output = folder / f"{clip.stem}{clip.suffix}"
            found, said = unshutter(clip, output, options.end)
            print(row(clip.stem, before, measured(output, options.end), ratio, found, said), flush=True)
            for name, other in others(clip, folder, options.end) if options.others else ():
                print(row(f"{clip.stem}, {name}", before, measured(other, options.end), "", "", ""), flush=True)


if __name__ == "__main__":
    main()
