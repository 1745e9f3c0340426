"""Whole-process time and peak memory of ``unshutter video`` beside the least that the same PyAV can do.

    python benchmarks/bench_video.py CLIP [--preset veryfast] [--ratio 0.6] [--model camera] [--runs 5]

The floor is one Python process that decodes the clip's video, warps the three planes of every frame by the identity
(bicubic remap, maps made once) and encodes it with the same settings: decoding, warping and encoding beside each
other, as unshutter does it. It copies no sound. Both run in turn after a warm-up; ratios are taken pair by pair, since
machines are noisy. Processor time (user and system, all threads) stands beside, which other work disturbs less.

A second table says where the processor time goes: the steps of the pipeline are run up to each one in turn, and each
counts what it adds.
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

FLOOR = """
import sys
import av, cv2, numpy as np
from unshutter.video.file.ahead import ahead
from unshutter.video.render.frame_warper import side_by_side
from unshutter.video.file.pixels import PixelFormat

cv2.setNumThreads(1)
source, out, preset, threads = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
reader = av.open(source)
video = reader.streams.video[0]
video.thread_type = "AUTO"
pixels = PixelFormat.of(video.codec_context.format)
writer = av.open(out, "w")
name = {"h264": "libx264", "hevc": "libx265"}[video.codec_context.name]
made = writer.add_stream(name, rate=video.guessed_rate, options={"preset": preset, "crf": "18"})
made.width, made.height, made.pix_fmt = video.width, video.height, video.pix_fmt
if name == "libx265":
    made.options["x265-params"] = "log-level=error"
made.codec_context.time_base = video.time_base
maps = {}

def warped(frame):
    new = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for old, out in zip(pixels.arrays(frame), pixels.arrays(new)):
        if old.shape not in maps:
            identity = np.meshgrid(*map(np.arange, old.shape[::-1]))
            maps[old.shape] = [np.ascontiguousarray(each, np.float32) for each in identity]
        cv2.remap(old, *maps[old.shape], cv2.INTER_CUBIC, dst=out, borderMode=cv2.BORDER_REPLICATE)
    new.pts, new.time_base = frame.pts, frame.time_base
    return new

for frame in side_by_side(warped, ahead(reader.decode(video), 2), threads):
    writer.mux(made.encode(frame))
writer.mux(made.encode(None))
writer.close()
"""

# Prints the processor time of the search for the lens [ms, median of 3], then the name of each step and the processor
# time of a frame [ms] up to and with it.
STEPS = """
import resource, sys
import cv2
from contextlib import closing
from unshutter.readout_time import ReadoutTime
from unshutter.video.calibrate.camera import ClipCamera, find_camera
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.render.frame_warper import Warper
from unshutter.video.decision import RectifyFrames
from unshutter.video.render.rendering import Rendering
from unshutter.options.clip_options import ClipUndo, Encode, RectifyClip, Shutter

cv2.setNumThreads(1)
source, out, preset, ratio, model = sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4]), sys.argv[5]
options = RectifyClip(
    shutter=Shutter(readout_ratio=ratio),
    undo=ClipUndo(model=model),
    encode=Encode(preset=preset, crf=18),
    overwrite=True,
)
clip = read_clip_facts(source)
request = ClipRequest.of(clip, options)
rendering = Rendering(request, ClipCamera(ReadoutTime(ratio * clip.interval_s)), RectifyFrames())

def count(items):
    with closing(items) as items:
        return sum(1 for _ in items)

def rectified():
    return rendering.rectified(Warper(clip, options.undo), clip.frames_between())

steps = {
    "decode": lambda: count(clip.frames_between()),
    "find the motion": lambda: count(rendering.moving(clip.frames_between())),
    "warp" if model == "camera" else "flow and warp": lambda: count(rectified()),
    "encode and write": lambda: rectify_clip_file(source, out, options).frames,
}

def ms_of(step):
    before = resource.getrusage(resource.RUSAGE_SELF)
    frames = step() or 1
    after = resource.getrusage(resource.RUSAGE_SELF)
    return 1000 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / frames

count(rendering.moving(clip.frames_between()))  # libraries are loaded
print(sorted(ms_of(lambda: find_camera(request) and 1) for _ in range(3))[1])
for name, step in steps.items():
    print(name, ms_of(step), sep="\\t")
"""


def run(command: list[str]) -> tuple[float, float, float]:
    """(seconds, processor seconds, peak MB) of a process."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        sys.exit(f"{command} failed: {process.stderr.read().decode() if process.stderr else ''}")
    if process.stderr:
        process.stderr.close()
    process.returncode = 0
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000


def steps_table(lines: list[str]) -> str:
    """Where the processor time goes: milliseconds of a frame, and shares."""
    until = [(name, float(ms)) for name, ms in (line.split("\t") for line in lines)]
    whole, before = until[-1][1], 0.0
    table = "| step | processor ms a frame | share |\n|---|---|---|\n"
    for name, ms in until:
        table += f"| {name} | {ms - before:.1f} | {100 * (ms - before) / whole:.0f} % |\n"
        before = ms
    return table + f"| all | {whole:.1f} | |"


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} … {max(values):.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--preset", default="veryfast")
    parser.add_argument("--ratio", default="0.6")
    parser.add_argument("--model", choices=("camera", "dense"), default="camera")
    parser.add_argument("--runs", type=int, default=5)
    given = parser.parse_args()
    threads = str(os.cpu_count() or 1)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line does: its idle threads spin
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / f"out{given.clip.suffix}")
        commands = {
            "floor": [sys.executable, "-c", FLOOR, str(given.clip), out, given.preset, threads],
            "unshutter video": [
                *(sys.executable, "-m", "unshutter", "video", str(given.clip), "-o", out, "--overwrite"),
                *("--readout-ratio", given.ratio, "--preset", given.preset, "--crf", "18", "--model", given.model),
            ],
        }
        for command in commands.values():
            run(command)
        measured: dict[str, list[tuple[float, float, float]]] = {name: [] for name in commands}
        for _ in range(given.runs):
            for name, command in commands.items():
                measured[name].append(run(command))
        by_step = [sys.executable, "-c", STEPS, str(given.clip), out, given.preset, given.ratio, given.model]
        lines = subprocess.run(by_step, capture_output=True, text=True, check=True).stdout.splitlines()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    print(f"{given.clip.name}, {given.preset}, {threads} processors, {platform.processor()}, commit {commit}\n")
    print("| | s | processor s | MB | of the floor | processor time of the floor's |\n|---|---|---|---|---|---|")
    floor = measured["floor"]
    for name, runs in measured.items():
        ratios, work = ([a[k] / b[k] for a, b in zip(runs, floor, strict=True)] for k in (0, 1))
        times, processor, memory = zip(*runs, strict=True)
        print(
            f"| {name} | {spread(list(times))} | {spread(list(processor))} | {max(memory):.0f} "
            f"| {spread(ratios)} | {spread(work)} |"
        )
    print(f"\n{steps_table(lines[1:])}\n\nThe lens is searched for once a clip, in {float(lines[0]):.0f} processor ms.")


if __name__ == "__main__":
    main()
