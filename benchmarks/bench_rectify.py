"""Whole-process time and peak memory of ``unshutter rectify`` beside the least that the same libvips can do.

    python benchmarks/bench_rectify.py [--runs 7] [--megapixels 12] [--format jpeg | tiff16]

The floor is one Python process that imports pyvips, decodes the photo, warps it by the identity (bicubic mapim) and
encodes it alike: JPEG with the same quality, or TIFF of 16 bits without compression. Both run in turn after a
warm-up; ratios are taken pair by pair, since machines are noisy. The photo is the shipped one, enlarged. Also timed:
a folder, ``unshutter --version`` and ``import unshutter``.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ORIGINAL = Path(__file__).parent.parent / "examples" / "original" / "basilica.webp"
FLOOR = """
import sys, pyvips
image = pyvips.Image.new_from_file(sys.argv[1])
index = pyvips.Image.xyz(image.width, image.height)
out = image.mapim(index, interpolate=pyvips.Interpolate.new("bicubic"))
out.{save}
"""
QUALITY = 92
# name: (file ending, how the floor and the photo are written)
FORMATS = {"jpeg": (".jpg", f"jpegsave(sys.argv[2], Q={QUALITY})"), "tiff16": (".tif", "tiffsave(sys.argv[2])")}


def run(command: list[str]) -> tuple[float, float]:
    """(seconds, peak MB) of a process."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        sys.exit(f"{command} failed: {process.stderr.read().decode() if process.stderr else ''}")
    if process.stderr:
        process.stderr.close()
    process.returncode = 0
    return seconds, usage.ru_maxrss / 1000


def spread(values: list[float], unit: str = "s") -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} … {max(values):.2f}) {unit}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--megapixels", type=float, default=12)
    parser.add_argument("--format", choices=FORMATS, default="jpeg")
    given = parser.parse_args()
    import pyvips

    suffix, save = FORMATS[given.format]

    with tempfile.TemporaryDirectory() as folder:
        photo, out = f"{folder}/photo{suffix}", f"{folder}/out{suffix}"
        original = pyvips.Image.new_from_file(str(ORIGINAL))
        scale = (given.megapixels * 1e6 / (original.width * original.height)) ** 0.5
        enlarged = original.resize(scale)
        if given.format == "jpeg":
            enlarged.jpegsave(photo, Q=QUALITY)
        else:
            (enlarged.cast("ushort") * 257).cast("ushort").copy(interpretation="rgb16").tiffsave(photo)
        ours = [sys.executable, "-m", "unshutter", "rectify", photo, "-o", out, "--overwrite"]
        floor = [sys.executable, "-c", FLOOR.format(save=save), photo, out]
        for command in (ours, floor):
            run(command)
        measured = [(run(ours), run(floor)) for _ in range(given.runs)]
        many = Path(folder) / "many"
        many.mkdir()
        for k in range(8):
            (many / f"{k}{suffix}").write_bytes(Path(photo).read_bytes())
        batch = [sys.executable, "-m", "unshutter", "rectify", str(many), "-o"]
        eight = [run([*batch, f"{folder}/out{k}"])[0] for k in range(max(given.runs // 2, 2))]
        version = [run([sys.executable, "-m", "unshutter", "--version"])[0] for _ in range(given.runs)]
        bare = [run([sys.executable, "-c", "pass"])[0] for _ in range(given.runs)]
        package = [run([sys.executable, "-c", "import unshutter"])[0] for _ in range(given.runs)]

    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    print(f"Commit {commit}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, ")
    print(f"{given.megapixels:g} MP {given.format}, {given.runs} runs after a warm-up: median (least … most)\n")
    print("| | whole process | peak memory |\n|---|---|---|")
    for name, k in (("`unshutter rectify`", 0), ("floor: decode, identity mapim, encode", 1)):
        seconds, memory = ([m[k][i] for m in measured] for i in (0, 1))
        print(f"| {name} | {spread(seconds)} | {statistics.median(memory):.0f} MB |")
    print(f"| ratio, pair by pair | {spread([a[0] / b[0] for a, b in measured], '')} | |")
    one = statistics.median(m[0][0] for m in measured)
    print(f"| a folder of 8 in one command | {spread(eight)} | |")
    print(f"| each photo of a folder after the first | {(statistics.median(eight) - one) / 7:.2f} s | |")
    print(f"| `unshutter --version` | {spread(version)} | |")
    print(f"| `import unshutter` (a bare Python takes {statistics.median(bare):.2f} s) | {spread(package)} | |")


if __name__ == "__main__":
    main()
