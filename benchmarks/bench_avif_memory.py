"""Memory that `unshutter rectify` takes to read large HEICs and to write AVIF: the table of docs/guide/scale.md.

    python benchmarks/bench_avif_memory.py [--megapixels 50]

For Linux. Needs pillow-heif, which takes minutes to write a HEIC of that size. The picture is drawn, and its rows move
by up to 60 px.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pillow_heif

from unshutter import RowMotion

CASES = (("jpg", 8, "jpg"), ("jpg", 8, "avif"), ("heic", 10, "jpg"), ("heic", 10, "avif"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megapixels", type=float, default=50)
    height = round((parser.parse_args().megapixels * 1e6 / 1.5) ** 0.5 / 2) * 2
    width = height * 3 // 2
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        draw(folder, height, width)
        RowMotion.from_polynomials([0, 60], [0, 0], height, width).save(folder / "motion.json")
        print(f"| {height * width / 1e6:.0f} MP, one photo | memory | a megapixel, beyond 200 MB |\n|---|---|---|")
        for given, bits, made in CASES:
            peak = peak_mb(folder, f"in.{given}", f"out-{given}.{made}")
            more = (peak - 200) / (height * width / 1e6)
            print(f"| {given.upper()} of {bits} bits to {made.upper()} | {peak:.0f} MB | {more:.0f} MB |", flush=True)


def draw(folder: Path, height: int, width: int) -> None:
    """Soft colours and straight lines, as a HEIC of 10 bits and a JPEG of 8, both with 4:2:0."""
    random = np.random.default_rng(0).random((height // 24, width // 24, 3)).astype(np.float32)
    picture = cv2.resize(random, (width, height), interpolation=cv2.INTER_CUBIC) / 2 + 0.25
    picture[:, np.arange(width) % 700 < 12] = 0.1
    pixels = np.round(np.clip(picture, 0, 1) * 65535).astype(np.uint16)
    heic = pillow_heif.from_bytes(mode="RGB;16", size=(width, height), data=pixels.tobytes())
    heic.save(folder / "in.heic", quality=60, chroma=420)
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    cv2.imwrite(str(folder / "in.jpg"), (pixels >> 8).astype(np.uint8), sampling)


def peak_mb(folder: Path, given: str, made: str) -> float:
    """Peak of resident memory of one run in a process of its own [MB]."""
    words = ["rectify", given, "-o", made, "--motion", "motion.json"]
    code = "import sys; from unshutter.cli import main; code = main(sys.argv[1:]);"
    code += "print(open('/proc/self/status').read()); sys.exit(code)"  # getrusage would count this process in
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=folder, capture_output=True, text=True, check=True)
    return int(re.findall(r"VmHWM:\s+(\d+) kB", done.stdout)[0]) / 1e3


if __name__ == "__main__":
    main()
