"""How long a photo with a neighbour takes, by the camera's motion and by the dense one; and the parts of the latter.

    python benchmarks/bench_frames.py [--rounds 7]

A drawn wall that moves; 640x480 and 4000x3000 px, pixels in memory to pixels in memory, the least and the median of
several rounds, and the least processor time, which says more where other work runs beside it. The second picture of a
pair costs less, since the flow is known.
"""

import argparse
import os
import time
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does: its idle threads spin

import cv2
import numpy as np

from unshutter.frames.frame import SequenceOptions
from unshutter.frames.frame_motion import Timing
from unshutter.frames.neighbours import copy_side, link, render_moment
from unshutter.options import Clock, FrameModel, Undo
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.rectification.sequences import rectify_between

SIZES = ((480, 640), (3000, 4000))
RATIO = 0.8


def frames(height: int, width: int) -> list[np.ndarray]:
    """Two frames of a wall that moves sideways by a thirtieth of the width."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(0, 255, (height // 8, width // 6, 3), np.uint8), (2 * width, height))
    shift, row = width / 30, np.arange(height, dtype=np.float32)[:, None] / height
    col = np.broadcast_to(np.arange(width, dtype=np.float32), (height, width))
    rows = np.broadcast_to(np.arange(height, dtype=np.float32)[:, None], (height, width))
    maps = [(col + width / 2 - shift * (k + RATIO * row)).astype(np.float32) for k in (0, 1)]
    return [cv2.remap(wall, each, rows, cv2.INTER_LINEAR) for each in maps]


def timed(what, rounds: int) -> str:
    """The times of several rounds, after one that does not count."""
    what()
    taken, worked = [], []
    for _ in range(rounds):
        start, work = time.perf_counter(), time.process_time()
        what()
        taken.append(1000 * (time.perf_counter() - start))
        worked.append(1000 * (time.process_time() - work))
    return f"{min(taken):.0f} ms (median {np.median(taken):.0f}), processors {min(worked):.0f} ms"


def main() -> None:
    """Measures and prints."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--rounds", type=int, default=7)
    rounds = arguments.parse_args().rounds
    for size in SIZES:
        measure(*size, rounds)


def measure(height: int, width: int, rounds: int) -> None:
    """Prints the times of one size."""
    pixels = frames(height, width)
    small = [Photo.from_array(each).grey(copy_side(height, width)) for each in pixels]
    known = link(*small)

    def whole(model: FrameModel | None) -> None:
        how = SequenceOptions(Clock(RATIO), Undo("first", edges="keep"), ScanDirection.TOP_TO_BOTTOM, model=model)
        rectify_between(Photo.from_array(pixels[0]), None, Photo.from_array(pixels[1]), how)

    print(f"{width}x{height}")
    for model in ("camera", "dense", None):
        print(f"  {model or 'chosen':8}", timed(partial(whole, model), rounds))
    print("  flow    ", timed(lambda: link(*small), rounds))
    given = dict(enumerate(pixels)), {1: known}, Timing(RATIO, height)
    print("  picture ", timed(lambda: render_moment(*given, 0.0), rounds), flush=True)


if __name__ == "__main__":
    main()
