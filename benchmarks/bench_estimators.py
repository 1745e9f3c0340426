"""Run time and peak memory of every estimator beside each other, on photos of three sizes.

    python benchmarks/bench_estimators.py [--estimators all] [--rounds 5] [--megapixels 0.065,2,12]

Every figure comes from fresh processes that read a JPEG, build the estimator and estimate twice. The second estimate,
of pixels already decoded, is the cost of the method itself; the process less that is what a single photo takes, with
Python, libraries, network and decoding, but no warp. The processes of a
round run one after the other, so that a busy machine slows all of them; a first round warms the caches and is not
counted. The photo is the shipped one, scaled. Prints Markdown: median (least ... most).
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

ORIGINAL = Path(__file__).parent.parent / "examples" / "original" / "basilica.webp"
JOB = """
import sys, time, unshutter
from unshutter.photo import Photo
photo, estimator = Photo.open(sys.argv[1]), unshutter.load(sys.argv[2])
unshutter.estimate(photo, estimator=estimator)
start = time.perf_counter()
unshutter.estimate(photo, estimator=estimator)
print(time.perf_counter() - start)
"""


def run(photo: str, estimator: str) -> tuple[float, float, float]:
    """(seconds of one estimate, seconds of the process without it, peak MB)."""
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-c", JOB, photo, estimator], stdout=subprocess.PIPE, text=True)
    out = process.stdout.read() if process.stdout else ""
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = status
    if process.stdout:
        process.stdout.close()
    if status:
        sys.exit(f"{estimator} failed on {photo}")
    return float(out), seconds - float(out), usage.ru_maxrss / 1000


def measure(estimators: list[str], megapixels: list[float], rounds: int) -> dict[tuple[str, float], list]:
    """(estimator, megapixels) -> what :func:`run` gave in each round."""
    import pyvips

    found: dict[tuple[str, float], list] = {(name, size): [] for name in estimators for size in megapixels}
    with tempfile.TemporaryDirectory() as folder:
        original = pyvips.Image.new_from_file(str(ORIGINAL))
        for size in megapixels:
            scale = (size * 1e6 / (original.width * original.height)) ** 0.5
            original.resize(scale).jpegsave(f"{folder}/{size}.jpg", Q=92)
        for count in range(rounds + 1):
            for name, size in found:
                result = run(f"{folder}/{size}.jpg", name)
                if count:
                    found[name, size].append(result)
    return found


def deviation(values: list[float]) -> float:
    """By which share of the median the farthest value differs from it."""
    middle = statistics.median(values)
    return max(max(values) - middle, middle - min(values)) / middle


def main() -> None:
    from unshutter.single.register import names as all_names

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--estimators", default="all")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--megapixels", default="0.065,2,12")
    parser.add_argument("-o", "--output", type=Path, help="also write every figure as JSON")
    given = parser.parse_args()
    names = all_names() if given.estimators == "all" else given.estimators.split(",")
    sizes = [float(size) for size in given.megapixels.split(",")]
    found = measure(names, sizes, given.rounds)
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    farthest = max(deviation([whole for _, whole, _ in runs]) for runs in found.values())
    print(f"Commit {commit}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}.")
    print(f"Photos of {' / '.join(f'{size:g}' for size in sizes)} MP. Medians of {given.rounds} rounds after a")
    print(f"warm-up, from which no process differs by more than {farthest:.0%}.\n")
    print("| estimator | estimate alone [s] | process for one photo [s] | peak memory [MB] |\n|---|---|---|---|")
    for name in names:
        medians = [[statistics.median(each) for each in zip(*found[name, size], strict=True)] for size in sizes]
        columns = zip(zip(*medians, strict=True), ("{:.3f}", "{:.3f}", "{:.0f}"), strict=True)
        cells = [" / ".join(form.format(value) for value in values) for values, form in columns]
        print(f"| {name} | {' | '.join(cells)} |")
    if given.output:
        flat = [{"estimator": name, "megapixels": size, "runs": runs} for (name, size), runs in found.items()]
        given.output.write_text(json.dumps({"commit": commit, "results": flat}, indent=1))


if __name__ == "__main__":
    main()
