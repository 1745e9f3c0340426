"""Whole-process time and peak memory of ``unshutter rectify`` beside the least that the same libvips can do.

    python benchmarks/bench_rectify.py [--runs 7] [--photos jpeg:12 jpeg:24 jpeg:48 tiff16:12]

The floor is one Python process that imports pyvips, decodes the photo, warps it by the identity (bicubic mapim) and
encodes it alike: JPEG with the same quality, or TIFF of 16 bits without compression. (It does not wait for the disc as
unshutter does.) Both run in turn after a warm-up; ratios are taken pair by pair, since machines are noisy. The photo is
the shipped one, enlarged. Also timed: the same with a motion that is given, so that nothing is looked for; what each
further photo of a folder takes; a process that only imports the libraries and opens the network; ``unshutter
--version`` and ``import unshutter``.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ORIGINAL = Path(__file__).parent.parent / "examples" / "demo.jpg"  # one that is changed, rather than copied
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
LIBRARIES = """
import numpy, cv2, pyvips
import unshutter
unshutter.load("segment-transformer").prepare()
"""
FOLDER = 5  # photos
# Installed packages are compiled; a checkout is by its first run, unless this forbids it.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def run(command: list[str]) -> tuple[float, float]:
    """(seconds, peak MB) of a process."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=ENVIRONMENT)
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


def measure(folder: Path, format: str, megapixels: float, runs: int) -> str:
    """A line of the table."""
    suffix, save = FORMATS[format]
    photo, out, motion = folder / f"photo{suffix}", folder / f"out{suffix}", folder / "motion.json"
    make_photo(photo, format, megapixels)
    many, results = folder / "many", folder / "results"
    many.mkdir()
    for k in range(FOLDER):
        shutil.copy(photo, many / f"{k}{suffix}")
    unshutter = [sys.executable, "-m", "unshutter"]
    run([*unshutter, "estimate", str(photo), "-o", str(motion), "--overwrite"])
    one = [*unshutter, "rectify", str(photo), "-o", str(out), "--overwrite"]
    commands = {
        "one": one,
        "floor": [sys.executable, "-c", FLOOR.format(save=save), str(photo), str(out)],
        "given": [*one, "--motion", str(motion)],
        "many": [*unshutter, "rectify", str(many), "-o", str(results)],
    }
    rounds = []
    for _ in range(runs + 1):
        rounds.append({name: run(command) for name, command in commands.items()})
        shutil.rmtree(results)
    del rounds[0]  # the warm-up
    shutil.rmtree(many)
    seconds = {name: [measured[name][0] for measured in rounds] for name in commands}
    seconds["further"] = [(b - a) / (FOLDER - 1) for a, b in zip(seconds["one"], seconds["many"], strict=True)]
    peaks = [f"{statistics.median(measured[name][1] for measured in rounds):.0f}" for name in ("one", "floor")]

    def of_floor(name: str) -> str:
        return spread([a / b for a, b in zip(seconds[name], seconds["floor"], strict=True)], "").strip()

    one, floor, further = (f"{statistics.median(seconds[name]):.2f} s" for name in ("one", "floor", "further"))
    cells = [f"{megapixels:g} MP {format}", one, floor, f"**{of_floor('one')}**"]
    cells += [of_floor("given"), further, of_floor("further"), f"{' / '.join(peaks)} MB"]
    return f"| {' | '.join(cells)} |"


def make_photo(path: Path, format: str, megapixels: float) -> None:
    import pyvips

    original = pyvips.Image.new_from_file(str(ORIGINAL))
    enlarged = original.resize((megapixels * 1e6 / (original.width * original.height)) ** 0.5)
    if format == "jpeg":
        enlarged.jpegsave(str(path), Q=QUALITY)
    else:
        (enlarged.cast("ushort") * 257).cast("ushort").copy(interpretation="rgb16").tiffsave(str(path))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--photos", nargs="+", default=["jpeg:12", "jpeg:24", "jpeg:48", "tiff16:12"])
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kinds = [photo.split(":") for photo in given.photos]
        lines = [measure(Path(folder), format, float(megapixels), given.runs) for format, megapixels in kinds]
    version = [run([sys.executable, "-m", "unshutter", "--version"])[0] for _ in range(given.runs)]
    libraries = [run([sys.executable, "-c", LIBRARIES])[0] for _ in range(given.runs)]
    bare = [run([sys.executable, "-c", "pass"])[0] for _ in range(given.runs)]
    package = [run([sys.executable, "-c", "import unshutter"])[0] for _ in range(given.runs)]

    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    print(f"Commit {commit}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, ")
    print(f"{given.runs} runs after a warm-up: median (least … most)\n")
    titles = ("photo", "`unshutter rectify`", "floor", "ratio", "with a motion given", "a further photo of a folder")
    print(f"| {' | '.join(titles)} | of the floor | peak memory |")
    print("|---|---|---|---|---|---|---|---|", *lines, sep="\n")
    print(f"\nTo import the libraries and open the network: {spread(libraries)}.", end="")
    print(f"\n`unshutter --version`: {spread(version)}. `import unshutter`: {spread(package)},")
    print(f"of which a bare Python takes {statistics.median(bare):.2f} s.")


if __name__ == "__main__":
    main()
