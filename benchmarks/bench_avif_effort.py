"""What libvips's effort is worth when AVIF is written: time, size and PSNR at quality 80,
a table for docs/research/files.md.

    python benchmarks/bench_avif_effort.py PHOTO...

Time is that of all processors together, which other programs disturb less than waiting. Chroma and bits are those of
the photo.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pyvips

from unshutter.photo import Photo

EFFORTS = (2, 1, 0)


def main(paths: list[str]) -> None:
    print("| photo | megapixels | bits | " + " | ".join(f"effort {effort}" for effort in EFFORTS) + " |")
    print("|---" * (3 + len(EFFORTS)) + "|")
    for path in map(Path, paths):
        photo = Photo.open(path)
        bits = 8 if photo.pixels.dtype == np.uint8 else photo._coding.bits
        cells = [measured(photo, bits, effort) for effort in EFFORTS]
        print("|", " | ".join([path.suffix[1:], f"{photo.height * photo.width / 1e6:.0f}", str(bits), *cells]), "|")


def measured(photo: Photo, bits: int, effort: int) -> str:
    start = time.process_time()
    data = photo.image.heifsave_buffer(
        compression="av1",
        Q=80,
        effort=effort,
        bitdepth=bits,
        subsample_mode="on" if photo._coding.subsampled else "off",
    )
    seconds = time.process_time() - start
    again = pyvips.Image.heifload_buffer(data).numpy()  # 10 bits are the upper ones of 16, as in Photo.pixels
    error = np.mean((again.astype(float) - photo.pixels) ** 2) / np.iinfo(again.dtype).max ** 2
    return f"{seconds:.1f} s, {len(data) / 1000:.0f} kB, {-10 * np.log10(error):.1f} dB"


if __name__ == "__main__":
    main(sys.argv[1:])
