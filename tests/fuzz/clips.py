"""Damaged clips of every container: each is written straightened, or refused in one line, within memory and time.

python tests/fuzz/clips.py [--files 500] [--seed 0] [mp4 mov mkv ...]

Each is worked on by a process of its own, so that a crash of a decoder is one finding and not the end.
"""

import argparse
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import av
import cv2

sys.path.insert(0, str(Path(__file__).parent.parent))

from support import clips
from support.fuzzing import CHANGES
from unshutter.cli import main as unshutter

SIDE, FRAMES = (72, 96), 12
MOST_MEMORY, LONGEST_S, HANG_S = 900_000_000, 20.0, 120.0  # of a process that needs 0.2 GB and less than a second
ADDRESSES = 6_000_000_000  # bytes: a process asks for no more than this, whatever a file says
MOST_FINDINGS = 20

# name -> encoder, pixel format, sound, and what else support.clips.write takes
FORMATS: dict[str, tuple[str, str, str | bool, dict]] = {
    "mp4": ("libx264", "yuv420p", "aac", {}),
    "fragments.mp4": ("libx264", "yuv420p", "aac", {"container": {"movflags": "frag_keyframe+empty_moov"}}),
    "mov": ("prores_ks", "yuv422p10le", "aac", {}),
    "hevc.mp4": ("libx265", "yuv420p", False, {"options": {"x265-params": "log-level=none"}}),
    "mkv": ("libx264", "yuv420p", "aac", {}),
    "webm": ("libvpx-vp9", "yuv420p", "libopus", {"options": {"b": "0", "crf": "30", "cpu-used": "8"}}),
    "avi": ("mpeg4", "yuv420p", "mp2", {"options": {"bf": "2"}}),
    "flv": ("libx264", "yuv420p", "aac", {}),
    "ts": ("libx264", "yuv420p", "mp2", {}),
    "mpg": ("mpeg2video", "yuv420p", "mp2", {}),
    "wmv": ("wmv2", "yuv420p", False, {}),
    "mjpeg.avi": ("mjpeg", "yuvj420p", False, {}),
    "nut": ("ffv1", "yuv420p", False, {}),
    "mxf": ("mpeg2video", "yuv422p", False, {}),
    "ivf": ("libvpx-vp9", "yuv420p", False, {"options": {"cpu-used": "8"}}),
}


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    Attributes:
        code: its exit code; negative: the signal that ended it.
        said: on standard error.
        seconds: of a processor that it took.
        memory: that it took [bytes].
    """

    code: int
    said: str
    seconds: float
    memory: int


def mutated(whole: bytes, random: Random) -> bytes:
    """A file with one to six changes, half of them where headers and tables are."""
    data = bytearray(whole)
    for _ in range(random.randint(1, 6)):
        near = random.random()
        first, end = 0, len(data)
        if near < 0.3:
            end = min(end, 400)
        elif near < 0.5:  # many formats have tables at the end
            first = max(0, end - 2000)
        if data:
            change = random.choice(CHANGES)
            at = min(random.randrange(first, max(end, first + 1)), len(data) - 1)
            change(data, at, random.randint(1, 64), random.randrange(1 << 16))
    return bytes(data)


def straightened(source: Path, target: Path, log: Path, random: Random) -> Ended:
    """What comes of a clip, in a process of its own."""
    words = ["video", str(source), "-o", str(target), "--readout-ratio", "0.6"]
    words += random.choice([[], [], [], ["--start", "0.1"], ["--end", "0.2"], ["--edges", "crop"], ["--strength", "0"]])
    child = os.fork()
    if child == 0:
        code = 99
        try:
            resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
            signal.alarm(int(HANG_S))
            told = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(told, 2)
            sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
            code = unshutter(words)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    said = log.read_text("utf-8", "replace").strip()
    return Ended(code, said, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)


def wrong(ended: Ended, folder: Path, target: Path) -> str:
    """What is wrong about an outcome; empty: nothing."""
    lines = ended.said.splitlines()
    left = [path.name for path in folder.iterdir() if path.name.startswith(".") or path.suffix == ".part"]
    if ended.code < 0:
        return f"ended by signal {-ended.code}" + (" (it hung)" if -ended.code == signal.SIGALRM else "")
    if ended.code not in (0, 1, 2):
        return f"exit code {ended.code}"
    if "Traceback" in ended.said:
        return "a traceback"
    if ended.code and (len(lines) != 1 or not lines[0].startswith("unshutter: ")):
        return f"{len(lines)} lines"
    if bool(ended.code) == target.exists():
        return f"exit code {ended.code}, but the result is {'there' if target.exists() else 'not there'}"
    if left:
        return f"left {left}"
    if ended.seconds > LONGEST_S or ended.memory > MOST_MEMORY:
        return "it took too much"
    return "" if not ended.code or lines[0].removeprefix("unshutter: ").strip() else "an empty message"


def run(name: str, files: int, seed: int, kept: Path | None) -> int:
    """Tries so many files of a format; returns how many findings there are."""
    codec, pixels, sound, more = FORMATS[name]
    random, counts, findings = Random(f"{name} {seed}"), Counter(), 0
    slowest, largest, start = 0.0, 0, time.monotonic()
    with TemporaryDirectory(prefix="unshutter-fuzz-") as where:
        folder = Path(where) / "work"
        folder.mkdir()
        ending = name.rpartition(".")[2]
        greys = [cv2.resize(grey, SIDE[::-1]) for grey in clips.moving(FRAMES)[1]]
        whole = clips.write(Path(where) / f"in.{name}", greys, codec, pixels, sound=sound, **more).read_bytes()
        source, target = folder / f"in.{ending}", folder / f"out.{ending}"
        for k in range(files):
            data = mutated(whole, random)
            source.write_bytes(data)
            ended = straightened(source, target, Path(where) / "log", random)
            told = wrong(ended, folder, target)
            slowest, largest = max(slowest, ended.seconds), max(largest, ended.memory)
            counts["straightened" if not ended.code else f"exit code {ended.code}"] += 1
            if told:
                findings += 1
                print(f"{name} {k}: {told}; {ended.seconds:.1f} s, {ended.memory / 1e6:.0f} MB: {ended.said[-1500:]}")
                if kept is not None:
                    (kept / f"{seed}-{k}-{name}").write_bytes(data)
                if findings >= MOST_FINDINGS:
                    break
            for path in folder.iterdir():
                subprocess.run(["rm", "-r", "--", str(path)], check=True) if path.is_dir() else path.unlink()
    fates = ", ".join(f"{fate}: {count}" for fate, count in sorted(counts.items()))
    took = f"{time.monotonic() - start:.0f} s, slowest {slowest:.1f} s, most {largest / 1e6:.0f} MB"
    print(f"{name}: {sum(counts.values())} files ({took}): {fates}; {findings} wrong", flush=True)
    return findings


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("formats", nargs="*", default=[], help=", ".join(FORMATS))
    parser.add_argument("--files", type=int, default=500, help="of each format")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the files that something is wrong with")
    given = parser.parse_args()
    av.logging.set_level(None)
    return min(sum([run(name, given.files, given.seed, given.keep) for name in given.formats or FORMATS]), 1)


if __name__ == "__main__":
    sys.exit(main())
