"""What large archives take: photos and frames per second of a core, memory of a worker, and what a cluster adds.

    python benchmarks/scale.py [photos] [clips] [cluster] [store]

The tables of docs/guide/scale.md; about three minutes on two idle cores. Needs unshutter[dask,video]; ``store`` also
moto[server] and s3fs.

photos: shipped photos, enlarged; ``--jobs 1`` kept on one core; from the first result to the last, as in a long
batch. clips: a clip made by ``synthesize --video``, the whole process on one core. cluster: the command with work that
takes no time, or 20 ms, on eight workers of a Dask cluster on this machine: what is left is what finding, planning,
scheduling and noting down take; and the same with half of the workers killed on the way. store: photos from and to an
S3 server (moto, in a process of its own, on this machine), beside the same from and to the disc.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import os
import platform
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from unshutter.cli import main as unshutter
from unshutter.run import loop
from unshutter.run.job import Job, Outcome

EXAMPLES = Path(__file__).parent.parent / "examples"
STILL, ROLLING = EXAMPLES / "original" / "basilica.webp", EXAMPLES / "demo.jpg"
PROGRAM = [sys.executable, "-m", "unshutter"]
WORKERS = 8
Row = tuple[str, str]


@dataclass
class Took:
    """What a process took.

    Attributes:
        seconds: in all.
        between: from the first line about a result to the last.
        results: such lines.
        peak_mb: resident memory of the largest of its processes.
    """

    seconds: float
    between: float
    results: int
    peak_mb: float

    @property
    def each(self) -> float:
        """Seconds from one result to the next."""
        return self.between / (self.results - 1)


def took(words: list[str], one_core: bool = False) -> Took:
    """Runs a command of unshutter to its end."""
    pin = partial(os.sched_setaffinity, 0, {0}) if one_core else None
    start = time.perf_counter()
    process = subprocess.Popen([*PROGRAM, *words], stderr=subprocess.PIPE, text=True, preexec_fn=pin)
    assert process.stderr is not None
    lines = [(time.perf_counter(), line) for line in process.stderr]
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{words} failed: {''.join(line for _, line in lines)}")
    seconds = time.perf_counter() - start
    at = [when for when, line in lines if " -> " in line or " left unchanged" in line] or [start]
    return Took(seconds, at[-1] - at[0], len(at), usage.ru_maxrss / 1000)


def make_photos(folder: Path, count: int, megapixels: float, original: Path = ROLLING) -> Path:
    """So many copies of a shipped photo, enlarged."""
    import pyvips

    image = pyvips.Image.new_from_file(str(original))
    data = image.resize((megapixels * 1e6 / (image.width * image.height)) ** 0.5).jpegsave_buffer(Q=92)
    folder.mkdir()
    for k in range(count):
        (folder / f"{k:05}.jpg").write_bytes(data)
    return folder


def photos(folder: Path) -> Iterator[Row]:
    """Photos on one core."""
    for megapixels, count, original, fate in (
        (12, 16, ROLLING, "straightened"),
        (12, 16, STILL, "left unchanged"),
        (48, 6, ROLLING, "straightened"),
    ):
        given = make_photos(folder / f"{megapixels} {fate}", count, megapixels, original)
        run = took(["rectify", str(given), "-o", str(folder / f"out {given.name}"), "--jobs", "1"], one_core=True)
        figure = f"{1 / run.each:.2f} photos/s ({run.each:.2f} s each), {run.peak_mb:.0f} MB"
        yield f"{megapixels} MP JPEG that is {fate}, one core", figure


def clips(folder: Path) -> Iterator[Row]:
    """A clip on one core."""
    photo = make_photos(folder / "photo", 1, 12, STILL) / "00000.jpg"
    shaken = folder / "gyro.npz"
    at = np.arange(0, 8, 0.005)
    np.savez(shaken, t_s=at, gyro_rad_s=np.stack([0.3 * np.sin(f * at) for f in (7, 11, 5)], axis=1))
    motion = ["--motion", "trajectory", "--trajectory", str(shaken), "--readout-ms", "25", "--focal-px", "1500"]
    made = folder / "made"
    subprocess.run([*PROGRAM, "synthesize", str(photo), "-o", str(made), "--video", *motion], check=True)
    clip = next(made.rglob("rs.mp4"))
    for preset in ("veryfast", "medium"):
        words = ["video", str(clip), "-o", str(folder / f"{preset}.mp4"), "--preset", preset]
        run = took(words, one_core=True)
        figure = f"{150 / run.seconds:.1f} frames/s, {run.peak_mb:.0f} MB"
        yield f"1080p H.264, one core, preset {preset}", figure


def no_work(job: Job, *_: object, seconds: float = 0.0, **__: object) -> Outcome:
    """Stands for the work on a photo."""
    time.sleep(seconds)
    return Outcome()


def batch(given: Path, out: Path, work: Callable[..., Outcome], *options: str) -> float:
    """Seconds of `unshutter rectify` in this process, with other work than its own."""
    loop.do_job = work
    start = time.perf_counter()
    with contextlib.redirect_stderr(io.StringIO()) as said:
        code = unshutter(["rectify", str(given), "-o", str(out), *options])
    if code:
        sys.exit(f"the batch failed: {said.getvalue()[-500:]}")
    return time.perf_counter() - start


def cluster(folder: Path) -> Iterator[Row]:
    """What a batch takes beside the work on its photos."""
    from distributed import Client, LocalCluster

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers are killed on purpose
    few, many = (make_photos(folder / f"{count}", count, 0.01) for count in (500, 2500))
    work = partial(no_work, seconds=0.02)

    def each(name: str, *options: str) -> tuple[float, float]:
        """(seconds, kB of memory) that each photo more takes."""
        seconds, memory = [], []
        for given in (few, many):
            seconds.append(batch(given, folder / f"{name}-{given.name}", no_work, *options))
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        return (seconds[1] - seconds[0]) / 2000, (memory[1] - memory[0]) / 2000

    seconds, memory = each("here", "--jobs", "1")
    yield "no work, one worker process", f"{1000 * seconds:.2f} ms a photo; {memory:.1f} kB a photo in the program"
    how = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=WORKERS, **how) as made, Client(made) as client:
        there = ["--scheduler", made.scheduler_address]
        seconds, _ = each("dask", *there)
        yield f"no work, {WORKERS} Dask workers", f"{1000 * seconds:.2f} ms a photo: {1 / seconds:.0f} photos/s at most"
        alive = batch(many, folder / "alive", work, *there)
        yield f"20 ms of waiting a photo, {WORKERS} Dask workers", f"{alive:.1f} s for 2500 photos"
        victims = list(client.run(os.getpid).values())[: WORKERS // 2]
        killer = threading.Timer(alive / 2, lambda: [os.kill(victim, signal.SIGKILL) for victim in victims])
        killer.start()
        survived = batch(many, folder / "killed", work, *there)
        yield f"the same, {len(victims)} workers killed half-way", f"{survived:.1f} s, none lost"


@contextlib.contextmanager
def s3_server(log: Path) -> Iterator[dict[str, str]]:
    """Moto's S3 server; gives the environment that finds it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with log.open("wb") as out:
        server = subprocess.Popen([sys.executable, "-m", "moto.server", "-p", str(port)], stdout=out, stderr=out)
        try:
            while socket.socket().connect_ex(("127.0.0.1", port)):
                time.sleep(0.1)
            url = f"http://127.0.0.1:{port}"
            keys = {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1"}
            yield {**keys, "AWS_ENDPOINT_URL": url}
        finally:
            server.terminate()
            server.wait()


def store(folder: Path) -> Iterator[Row]:
    """Photos from and to an object store."""
    import boto3

    given = make_photos(folder / "photos", 12, 12)
    with s3_server(folder / "log") as environment:
        os.environ |= environment
        client = boto3.client("s3")
        client.create_bucket(Bucket="archive")
        for path in given.iterdir():
            client.upload_file(str(path), "archive", f"in/{path.name}")
        before = (folder / "log").read_text().count("HTTP/1.1")
        there = took(["rectify", "s3://archive/in", "-o", "s3://archive/out", "--jobs", "1"], one_core=True)
        requests = (folder / "log").read_text().count("HTTP/1.1") - before
    here = took(["rectify", str(given), "-o", str(folder / "out"), "--jobs", "1"], one_core=True)
    yield "12 MP from disc to disc, one core", f"{here.each:.2f} s a photo"
    yield "the same from S3 to S3", f"{there.each:.2f} s a photo, {requests / there.results:.1f} requests a photo"


PARTS = {"photos": photos, "clips": clips, "cluster": cluster, "store": store}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    given = parser.parse_args()
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=EXAMPLES
    ).stdout.strip()
    load = os.getloadavg()[0]
    print(f"Commit {commit}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()},")
    print(f"{load:.1f} other processes at work when it began\n\n| | |\n|---|---|")
    for part in given.parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            for what, figure in PARTS[part](Path(folder)):
                print(f"| {what} | {figure} |", flush=True)


if __name__ == "__main__":
    main()
