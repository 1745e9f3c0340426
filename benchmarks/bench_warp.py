"""Whole-process time and peak memory of the warp, against libvips doing as little as possible.

    python benchmarks/bench_warp.py                                    # 12 megapixels, 7 rounds
    python benchmarks/bench_warp.py --megapixels 100 --rounds 2        # what a large picture needs

Every job is a fresh Python process that reads a drawn JPEG, does one thing and writes a JPEG. ``identity``
is the yardstick: decode, bicubic mapim with the identity map, encode, and nothing of unshutter imported.
The jobs of a round run one after the other, so that a busy machine slows all of them; ratios are taken
within a round. CPU seconds (of all threads) hardly depend on the machine's other work. A first round warms
the caches and is not counted.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

READ = "import sys, pyvips; image = pyvips.Image.new_from_file(sys.argv[1])"
WARP = """
from unshutter.photo import Photo
photo = Photo.open(sys.argv[1])
photo.with_pixels(straighten(photo.pixels, motion, '{edges}')[0]).save(sys.argv[2], quality=92, overwrite=True)
"""
WRITE = "out.jpegsave(sys.argv[2], Q=92)"
SHAKE = """
from unshutter.motion import Motion, RowMotion
from unshutter.motion.warp import straighten
unit = image.width / 100
motion = RowMotion.from_polynomials([0, 3 * unit, -2 * unit], [0, 0.02, -0.01], image.height, image.width)
"""
JITTER = """
import numpy
jitter = numpy.random.default_rng(0).normal(0, 0.1, image.height)  # px on every row: no grid fits
motion = RowMotion(image.width, motion.tx_px + jitter, motion.rz_rad)
"""
IDENTITY = """
index = pyvips.Image.xyz(image.width, image.height)
out = image.mapim(index, interpolate=pyvips.Interpolate.new("bicubic"))
"""
JOBS = {
    "identity": [READ, IDENTITY, WRITE],
    "decode and encode only": [READ, "out = image", WRITE],
    "rectify, edges keep": [READ, SHAKE, WARP.format(edges="keep")],
    "rectify, edges crop": [READ, SHAKE, WARP.format(edges="crop")],
    "rectify, edges fill": [READ, SHAKE, WARP.format(edges="fill")],
    "rectify, jitter on every row": [READ, SHAKE, JITTER, WARP.format(edges="keep")],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megapixels", type=float, default=12)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path, help="write the raw figures to this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        photo = draw_photo(Path(folder) / "photo.jpg", options.megapixels)
        result = Path(folder) / "out.jpg"
        rounds = [{name: run(job, photo, result) for name, job in JOBS.items()} for _ in range(options.rounds + 1)][1:]
    about = {"megapixels": options.megapixels, **machine()}
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    print(f"{'job':<29} {'seconds':>19} {'of identity':>19} {'CPU seconds':>19} {'of identity':>19} {'peak MB':>8}")
    for name in JOBS:
        columns = []
        for figure in ("seconds", "cpu_seconds"):
            columns.append(spread([r[name][figure] for r in rounds]))
            columns.append(spread([r[name][figure] / r["identity"][figure] for r in rounds]))
        peak = max(r[name]["peak_mb"] for r in rounds)
        print(f"{name:<29} {' '.join(f'{column:>19}' for column in columns)} {peak:>8.0f}")
    if options.json:
        options.json.write_text(json.dumps({**about, "rounds": rounds}, indent=1) + "\n")


def draw_photo(path: Path, megapixels: float) -> Path:
    """A 4:3 JPEG with edges and video grain, so that decoding and encoding cost what a photo's do."""
    import pyvips

    height = round((megapixels * 1e6 * 3 / 4) ** 0.5)
    width = round(height * 4 / 3)
    waves = pyvips.Image.sines(width, height, hfreq=40, vfreq=25, uchar=False).linear([60], [128])
    tiles = ((pyvips.Image.xyz(width, height) % 199) > 150).bandand().ifthenelse(70, 0)
    grain = pyvips.Image.gaussnoise(width, height, sigma=6)
    drawn = (waves + tiles + grain).bandjoin([waves + grain, waves - tiles + grain])
    drawn.cast("uchar").copy(interpretation="srgb").jpegsave(str(path), Q=92)
    return path


def run(job: list[str], photo: Path, result: Path) -> dict[str, float]:
    """Seconds by the clock and of CPU, and peak resident memory [MB], of one process."""
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-c", "\n".join(job), str(photo), str(result)])
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"a job failed: {job}")
    unit = 1e6 if sys.platform == "darwin" else 1e3
    cpu_seconds = usage.ru_utime + usage.ru_stime
    return {"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_mb": usage.ru_maxrss / unit}


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f}...{max(values):.2f})"


def machine() -> dict[str, str]:
    import pyvips

    git = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    )
    return {
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}",
        "machine": platform.machine(),
        "libvips": ".".join(str(pyvips.version(part)) for part in range(3)),
        "commit": git.stdout.strip() or "unknown",
    }


if __name__ == "__main__":
    main()
