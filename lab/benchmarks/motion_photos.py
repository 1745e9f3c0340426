"""Measures how well the video in a motion photo reveals the photo's motion; rendered from recorded hands.

    python lab/benchmarks/motion_photos.py PHOTOS LOG.npz ... [--cases 40] [--seed 0]

Each case is a photo of the folder, seen by a camera that turns as a log says from a random moment on: a still of 900
rows and a video of 640x360 px, 60 frames at 30 a second, with readout times (video 10 to 30 ms, still 13 to 43 ms)
and fields of view of their own, as a JPEG with an MP4 behind it. Reported for videos as they are, for those that
were stabilised (frame by frame, or row by row) and for cameras that stood still: errors (EPE, px of 256 rows), answers.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.motion_photo import motion_by_embedded_video
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import judge
from unshutter.options import Camera, Undo
from unshutter.photo import Photo
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.clip import Stabilisation, SyntheticMotionPhoto
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, VIDEO_HEIGHT, VIDEO_WIDTH, FRAMES, FPS = 900, 1200, 360, 640, 60, 30.0
JITTER_S = 0.03  # by which logs of motion capture are smoothed
KINDS = {
    "as it is": (Stabilisation.NONE, True),
    "stabilised, rows": (Stabilisation.ROWS, True),
    "stabilised, frames": (Stabilisation.FRAMES, True),
    "stood still": (Stabilisation.NONE, False),
}


def drawn(seed: int, logs: list[RotationLog], kind: str) -> SyntheticMotionPhoto:
    rng = np.random.default_rng(seed)
    focal, crop = WIDTH * rng.uniform(0.7, 0.95), rng.uniform(0.75, 1.0)
    video = {"height": VIDEO_HEIGHT, "width": VIDEO_WIDTH, "focal_px": focal * VIDEO_WIDTH / (crop * WIDTH)}
    ratio, readout, taken = rng.uniform(0.3, 0.9), rng.uniform(0.4, 1.3), rng.uniform(0.3, 0.7) * FRAMES
    while True:
        try:
            camera = RotatingCamera.drawn(
                rng, logs[rng.integers(len(logs))], FRAMES + 2, fps=FPS, readout_ratio=ratio, **video
            )
        except UnshutterError:
            continue
        return SyntheticMotionPhoto(camera, taken, readout, HEIGHT, WIDTH, focal, *KINDS[kind])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("photos", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args()
    logs = [log.smoothed(JITTER_S) if log.from_poses else log for log in map(RotationLog.load, wanted.logs)]
    photos = sorted(path for path in wanted.photos.rglob("*") if path.suffix.lower() in (".jpg", ".png"))
    for kind in KINDS:
        errors, nothing, answers, seconds, undone = [], [], [], [], 0
        for seed in range(wanted.seed, wanted.seed + wanted.cases):
            scene = cv2.imread(str(photos[seed % len(photos)]), cv2.IMREAD_GRAYSCALE)
            scene = np.ascontiguousarray(np.rot90(scene)) if scene.shape[0] > scene.shape[1] else scene
            case = drawn(seed, logs, kind)
            photo = Photo.from_bytes(case.motion_photo(scene))
            start = time.process_time()
            evidence = motion_by_embedded_video(View(photo, Camera(focal_px=case.focal_px)))
            seconds.append(time.process_time() - start)
            truth, found = case.motion(), evidence if isinstance(evidence, Finding) else None
            motion = None if found is None else found.motion
            zero = RowMotion.zero(HEIGHT, WIDTH)
            nothing.append(motion_error(zero, truth).epe)
            undone += found is not None and judge(found.fit(HEIGHT, WIDTH), Undo()).changes
            if motion is not None and not motion.is_zero:
                errors.append(motion_error(motion, truth).epe)
                answers.append(f"moved ({motion.largest_px * 256 / HEIGHT:.1f})")
            elif motion is not None:
                errors.append(nothing[-1])
                answers.append("stood still")
            else:
                answers.append(str(evidence.code if isinstance(evidence, Reason) else "no video"))
            error = f"{errors[-1]:.3f}" if motion is not None else "-"
            print(f"  {kind} {seed}: {answers[-1]}, EPE {error}, nothing done {nothing[-1]:.2f}")
        said = {word: sum(each.startswith(word) for each in answers) for word in ("moved", "stood still", *Code)}
        print(f"{kind}:", ", ".join(f"{count} {word}" for word, count in said.items() if count), end="; ")
        print(f"{undone} undone; ", end="")
        if errors:
            print(f"EPE median {np.median(errors):.3f}, 90 % {np.quantile(errors, 0.9):.3f}, ", end="")
            print(f"below 0.5: {np.mean(np.array(errors) < 0.5):.2f} of {len(errors)}; ", end="")
        print(f"nothing done {np.median(nothing):.2f}; {np.median(seconds):.2f} s of CPU", flush=True)


if __name__ == "__main__":
    main()
