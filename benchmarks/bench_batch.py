"""Throughput of ``unshutter rectify FOLDER -o FOLDER`` by the number of worker processes.

    python benchmarks/bench_batch.py [--jobs 1 2] [--photos 48] [--megapixels 12] [--runs 3]

The photo is the shipped one, enlarged, so many times over. Each number of jobs has its turn in each run, after one
warm-up; efficiency is throughput beside so many times that of one worker process in the same run, since machines are
noisy. The one worker, whose threads would make use of a second processor now and then, is kept on one (Linux).
Measured twice: the whole process, with the second or so in which workers start, and the stretch from the time at
which every worker has finished its first photo, as in a long batch. ``none`` is the command without ``--jobs``: one
process that uses all processors. Beside it stands what the machine gives to programs that share nothing: as many
processes that compress random bytes, each on its own processor, beside one of them.
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
from functools import partial
from pathlib import Path

ORIGINAL = Path(__file__).parent.parent / "examples" / "demo.jpg"  # one that is changed, rather than copied
QUALITY = 92


def throughput(photos: Path, out: Path, jobs: int | None) -> tuple[float, float]:
    """(photos per second of the whole process, photos per second once all workers are at work)."""
    options = [] if jobs is None else ["--jobs", str(jobs)]
    command = [sys.executable, "-m", "unshutter", "rectify", str(photos), "-o", str(out), *options]
    start = time.perf_counter()
    pin = partial(os.sched_setaffinity, 0, {0}) if jobs == 1 and hasattr(os, "sched_setaffinity") else None
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=pin)
    assert process.stderr
    done = [time.perf_counter() for line in process.stderr if " -> " in line]
    if process.wait():
        sys.exit(f"{command} failed")
    process.stderr.close()
    seconds = time.perf_counter() - start
    first = max(jobs or 1, 1)  # photos that came while workers started
    return len(done) / seconds, (len(done) - first) / (done[-1] - done[first - 1])


CONTROL = """
import os, sys, time, zlib
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {int(sys.argv[1])})
data, count, start = os.urandom(1 << 16), 0, time.perf_counter()
while time.perf_counter() - start < 3:
    count += len(zlib.compress(data, 1)) > 0
print(count)
"""


def control(jobs: int) -> int:
    """How often so many processes that share nothing do a small piece of work in three seconds, in all."""
    commands = [[sys.executable, "-c", CONTROL, str(k)] for k in range(jobs)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for command in commands]
    return sum(int(process.communicate()[0]) for process in started)


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} … {max(values):.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, nargs="+", default=[os.cpu_count() or 1])
    parser.add_argument("--photos", type=int, default=48)
    parser.add_argument("--megapixels", type=float, default=12)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path, help="also write every measurement here")
    given = parser.parse_args()
    import pyvips

    counts: list[int | None] = [1, *(n for n in given.jobs if n != 1), None]
    measured: dict[int | None, list[tuple[float, float]]] = {count: [] for count in counts}
    controls: dict[int, list[float]] = {count: [] for count in counts if count is not None}
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder) / "photos"
        photos.mkdir()
        original = pyvips.Image.new_from_file(str(ORIGINAL))
        scale = (given.megapixels * 1e6 / (original.width * original.height)) ** 0.5
        data = original.resize(scale).jpegsave_buffer(Q=QUALITY)
        for k in range(given.photos):
            (photos / f"{k:04}.jpg").write_bytes(data)
        throughput(photos, Path(folder) / "warm-up", counts[1])
        for run in range(given.runs):
            for count in counts:
                measured[count].append(throughput(photos, Path(folder) / f"out-{run}-{count}", count))
            alone = control(1)
            for count in controls:
                controls[count].append(control(count) / (count * alone))

    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    print(f"Commit {commit}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, ")
    print(f"{given.photos} JPEGs of {given.megapixels:g} MP, {given.runs} runs after a warm-up: median (least … most)")
    print("\n| jobs | photos per second | once all work | efficiency | once all work | the machine's |")
    print("|---|---|---|---|---|---|")
    for count in counts:
        cells = [spread([m[i] for m in measured[count]]) for i in (0, 1)]
        for i in (0, 1):
            pairs = zip(measured[count], measured[1], strict=True)
            cells.append(spread([m[i] / (one[i] * count) for m, one in pairs]) if count else "")
        cells.append(spread(controls[count]) if count else "")
        print(f"| {count or 'none'} | {' | '.join(cells)} |")
    if given.json:
        given.json.write_text(json.dumps({str(count): values for count, values in measured.items()}))


if __name__ == "__main__":
    main()
