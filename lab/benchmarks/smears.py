"""What the length of smears adds to right angles: photos with drawn motion and the blur that goes with it.

    python lab/benchmarks/smears.py PHOTOS [--cases 90] [--seed 31] [--phone]

Each case is a photo of the folder that moves by 2 to 12 % of its height to the side, a little bent and turned, exposed
for 1/30, 1/60 or 1/125 s, with noise, as a JPEG. The readout takes 30 ms, and that is known; with --phone it takes
about 20 ms, and what is known is what is usual for phones. Reported are the cases in which smears are used: errors
(EPE, px of 256 rows) of what is undone by right angles alone, with the smears, and of doing nothing.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from unshutter.motion import Motion, RowMotion
from unshutter.motion.rectified import judged
from unshutter.options import Camera, Undo
from unshutter.photo import Photo
from unshutter.photo.exposure import PHONE
from unshutter.readout_time import ReadoutTime
from unshutter.single import methods
from unshutter.single.estimator import View
from unshutter.single.methods import find_motion
from unshutter.single.register import load
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.row_motions import distorted

KNOWN = ReadoutTime.of_ms(30, "given")
EXPOSURES_S = (1 / 30, 1 / 60, 1 / 125)


@dataclass(frozen=True)
class TimedView(View):
    """A photo of which this is known of the readout time."""

    time: ReadoutTime = KNOWN

    def readout_s(self) -> ReadoutTime:
        """What is known."""
        return self.time


def drawn(rng: np.random.Generator, height: int, width: int) -> RowMotion:
    across = rng.uniform(0.02, 0.12) * height * rng.choice([-1, 1])
    share = np.linspace(0, 1, height)
    return RowMotion(width, across * share + rng.normal(0, 0.015) * height * share**2, rng.normal(0, 0.006) * share)


def undone_error(motion: Motion, truth: Motion) -> float:
    changes = judged(motion, Undo(), truth.height, truth.width)[1].changes
    return motion_error(motion if changes else RowMotion.zero(truth.height, truth.width), truth).epe


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("photos", type=Path)
    parser.add_argument("--cases", type=int, default=90)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--phone", action="store_true")
    wanted = parser.parse_args()
    photos = sorted(wanted.photos.rglob("*.jpg"))
    rng, estimator, with_smears = np.random.default_rng(wanted.seed), load("segment-manhattan"), []
    by_smear = methods.candidates_by_smear
    for case in range(wanted.cases):
        pixels = np.ascontiguousarray(cv2.imread(str(photos[rng.integers(len(photos))]))[..., ::-1])
        truth, exposure_s = drawn(rng, *pixels.shape[:2]), EXPOSURES_S[case % 3]
        readout_s = 0.02 * np.exp(rng.normal(0, 0.35)) if wanted.phone else KNOWN.typical_s
        blurred = distorted(pixels, truth, exposure_s / readout_s * truth.height)
        noisy = np.clip(blurred + rng.normal(0, 1.5, blurred.shape), 0, 255).astype(np.uint8)
        data = cv2.imencode(".jpg", noisy[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
        view = TimedView(Photo.from_bytes(data), Camera(exposure_s=exposure_s), time=PHONE if wanted.phone else KNOWN)
        used = []
        with patch.object(methods, "candidates_by_smear", lambda *a, used=used: used.append(by_smear(*a)) or used[-1]):
            motion = find_motion(estimator, view)
        if used and used[-1] is not None:
            with patch.object(methods, "candidates_by_smear", lambda *_: None):
                alone = find_motion(estimator, view)
            zero = RowMotion.zero(truth.height, truth.width)
            with_smears.append([undone_error(each, truth) for each in (alone, motion, zero)])
            print("right angles {:.2f}, with smears {:.2f}, nothing done {:.2f}".format(*with_smears[-1]))
    errors = np.array(with_smears)
    names = zip(("right angles", "with smears", "nothing done"), errors.T, strict=True)
    told = "; ".join(f"{name} median {np.median(each):.2f}, mean {each.mean():.2f}" for name, each in names)
    worse = int((errors[:, 1] > errors[:, 2] + 0.3).sum())
    print(f"smears used in {len(errors)} of {wanted.cases}: {told}; worse than nothing in {worse}")


if __name__ == "__main__":
    main()
