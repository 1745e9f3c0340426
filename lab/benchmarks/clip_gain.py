"""What ``unshutter video`` gains on clips with a known truth, with the readout time given and found.

    python lab/benchmarks/clip_gain.py PHOTO LOG.npz [--seeds 1 5] [--readout-ms 20] [--frame 1920x1080]

Each clip is the photo seen by a camera that turns as the log says (``unshutter synthesize --video``). Told, before and
after: PSNR of the luma against the true global-shutter clip [dB, without a border of 6 %]; |R_F|, the matches of
consecutive frames that agree with one fundamental matrix; and the wobble: how far corners that are followed from frame
to frame lie from the one homography that a turning global shutter would have [px of the clip, root mean square of the
middle 90 %].
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import av
import cv2
import numpy as np

from unshutter.frames.tracks import follow
from unshutter_lab.evaluation.clip_cases import agreeing_matches

EVERY = 10  # frames; between them |R_F| is not measured


def luma(path: Path):
    with av.open(str(path)) as clip:
        for frame in clip.decode(video=0):
            yield frame.to_ndarray(format="gray")


def psnr(path: Path, truth: Path) -> float:
    found = []
    for one, other in zip(luma(path), luma(truth), strict=True):
        border = int(0.06 * one.shape[0])
        inner = slice(border, -border)
        found.append(10 * np.log10(255**2 / np.square(one[inner, inner].astype(float) - other[inner, inner]).mean()))
    return float(np.mean(found))


def consecutive(path: Path) -> tuple[float, float]:
    """(|R_F|, wobble [px])."""
    inliers, wobble, before = [], [], None
    for k, frame in enumerate(luma(path)):
        if before is not None:
            tracks = follow(before, frame)
            if len(tracks) > 20:
                plane, _ = cv2.findHomography(tracks.start, tracks.end, cv2.USAC_ACCURATE, 3.0)
                off = tracks.end - cv2.perspectiveTransform(tracks.start[None], plane)[0]
                squares = np.sort(np.square(off).sum(axis=1))
                wobble.append(squares[: int(0.9 * len(squares))].mean())
            if k % EVERY == 1:
                pair = [(each[..., None], np.ones(each.shape, bool)) for each in (before, frame)]
                inliers.append(agreeing_matches(*pair, seed=0)[0])
        before = frame
    return float(np.mean(inliers)), float(np.sqrt(np.mean(wobble)))


def unshutter(*words: object) -> tuple[bool, str]:
    """(whether it went well, what it said)."""
    command = [sys.executable, "-m", "unshutter", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.returncode == 0, done.stderr.splitlines()[0] if done.stderr else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo")
    parser.add_argument("log")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--readout-ms", default="20")
    parser.add_argument("--frame", default="1920x1080")
    parser.add_argument("--focal-px", default="1600")
    given = parser.parse_args()
    print("| clip | PSNR, dB | \\|R_F\\| | wobble, px |\n|---|---|---|---|")
    for seed in given.seeds:
        with tempfile.TemporaryDirectory() as name:
            made = Path(name) / "made"
            how = ("--motion", "trajectory", "--trajectory", given.log, "--readout-ms", given.readout_ms)
            size = ("--focal-px", given.focal_px, "--frame", given.frame, "--seed", seed)
            well, said = unshutter("synthesize", given.photo, "-o", made, "--video", *how, *size)
            if not well:
                sys.exit(said)
            results = {"input": made / "rs.mp4"}
            for kind, flags in (("given", ("--readout-ms", given.readout_ms)), ("found", ())):
                results[kind] = Path(name) / f"{kind}.mp4"
                flags = (*flags, "--preset", "veryfast")
                well, said = unshutter("video", made / "rs.mp4", "-o", results[kind], *flags)
                print(f"{Path(given.log).stem}, seed {seed}, {kind}: {said}", file=sys.stderr)
                if not well:
                    del results[kind]
            results["truth"] = made / "gs.mp4"
            for kind, path in results.items():
                quality = "" if kind == "truth" else f"{psnr(path, made / 'gs.mp4'):.1f}"
                matches, wobble = consecutive(path)
                print(f"| {Path(given.log).stem}, {seed}, {kind} | {quality} | {matches:.0f} | {wobble:.2f} |")


if __name__ == "__main__":
    main()
