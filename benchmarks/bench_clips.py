"""Processor time and peak memory of ``unshutter video`` beside vid.stab, on real clips and with one encoder.

    python benchmarks/bench_clips.py FOLDER [--runs 3]

Each clip of a folder is encoded as it is, stabilised by vid.stab (both passes) and rectified with no option but the
encoder's, all by libx264 with CRF 18 and the preset medium. FFmpeg must have been built with vid.stab, as Debian's is.
Figures are the least of some runs that alternate: seconds of processor time (user and system) of all processes, and the
largest process. A clip that unshutter leaves is named so: then its time is that of saying no.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from unshutter.frames.pyav import VIDEO_FORMATS

_ENCODER = ("-c:v", "libx264", "-crf", "18", "-preset", "medium")
_QUIET = ("ffmpeg", "-y", "-v", "error", "-i")


class Cost(NamedTuple):
    """What some processes took, one after another."""

    seconds: float  # user and system
    megabytes: float  # of the largest

    @classmethod
    def of(cls, *commands: tuple[str, ...]) -> Cost:
        """Runs commands, which must succeed."""
        seconds = 0.0
        largest = 0
        for command in commands:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            if status:
                raise SystemExit(f"failed: {' '.join(command)}")
            seconds += usage.ru_utime + usage.ru_stime
            largest = max(largest, usage.ru_maxrss)
        return cls(seconds, largest / 1024)

    def least(self, other: Cost) -> Cost:
        """Returns the smaller figures of both."""
        return Cost(min(self.seconds, other.seconds), min(self.megabytes, other.megabytes))


def _costs(clip: Path, folder: Path) -> tuple[Cost, Cost, Cost]:
    out = str(folder / f"out{clip.suffix}")
    path = str(folder / "path.trf")
    source = str(clip)
    encoded = Cost.of((*_QUIET, source, *_ENCODER, "-an", out))
    stabilised = Cost.of(
        (*_QUIET, source, "-vf", f"vidstabdetect=result={path}", "-f", "null", "-"),
        (*_QUIET, source, "-vf", f"vidstabtransform=input={path}", *_ENCODER, "-an", out),
    )
    Path(out).unlink()
    command = (sys.executable, "-m", "unshutter", "video", source, "-o", out, "--only-changed")
    return encoded, stabilised, Cost.of((*command, "--codec", "libx264", "--crf", "18", "--preset", "medium"))


def _row(clip: Path, folder: Path, runs: int) -> str:
    costs = _costs(clip, folder)
    for _ in range(runs - 1):
        costs = tuple(map(Cost.least, costs, _costs(clip, folder)))
    encoded, stabilised, rectified = costs
    extra = (rectified.seconds - encoded.seconds) / max(stabilised.seconds - encoded.seconds, 0.01)
    name = clip.stem if (folder / f"out{clip.suffix}").exists() else f"{clip.stem} (left)"
    return (
        f"| {name} | {encoded.seconds:.1f} | {stabilised.seconds:.1f} | {rectified.seconds:.1f} "
        f"| {rectified.seconds / stabilised.seconds:.2f} | {extra:.1f} | {rectified.megabytes:.0f} |"
    )


def main() -> None:
    """Prints a row for each clip."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    print(f"Commit {commit}, {os.cpu_count()} cores: processor seconds, least of {given.runs} runs\n")
    titles = (
        "clip",
        "encoding alone",
        "vid.stab",
        "unshutter video",
        "by vid.stab's",
        "beyond encoding",
        "memory [MB]",
    )
    print(f"| {' | '.join(titles)} |", "|---" * len(titles) + "|", sep="\n", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for clip in sorted(each for each in given.folder.iterdir() if each.suffix in VIDEO_FORMATS):
            print(_row(clip, Path(folder), given.runs), flush=True)


if __name__ == "__main__":
    main()
