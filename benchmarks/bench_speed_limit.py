"""What it takes to say how fast a camera can have moved, by a photo's sharpness (single/sharpness.py).

    python benchmarks/bench_speed_limit.py [PHOTO] [--megapixels 12] [--rounds 15]

Processor time of one thread, the photo decoded already; median (least ... most).
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import cv2

from unshutter.photo import Photo
from unshutter.photo.readout_times import PHONE
from unshutter.single.sharpness import EdgeWidths, speed_limit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo", type=Path, nargs="?", default=Path("examples/demo.jpg"))
    parser.add_argument("--megapixels", type=float, default=12)
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    pixels = Photo.open(given.photo).pixels
    factor = (given.megapixels * 1e6 / (pixels.shape[0] * pixels.shape[1])) ** 0.5
    pixels = cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    taken = [_time(pixels) for _ in range(given.rounds + 2)][2:]  # two to warm up
    spread = f"{statistics.median(taken):.1f} ({min(taken):.1f} ... {max(taken):.1f}) ms"
    print(f"{pixels.shape[1]}x{pixels.shape[0]} px: {spread}")


def _time(pixels) -> float:
    start = time.process_time()
    speed_limit(lambda: EdgeWidths.of(pixels), 1 / 60, PHONE, merged=False)
    return 1000 * (time.process_time() - start)


if __name__ == "__main__":
    main()
