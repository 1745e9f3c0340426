"""What ``unshutter video`` does to real clips, next to vid.stab: a line for the clip as taken, and for each way.

    PYTHONPATH=benchmarks python lab/benchmarks/real_clips.py DATA [--keep FOLDER] [--only karma] [--preset medium]

DATA is the folder of data sets; those that it lacks are left out. vid.stab is FFmpeg's ``vidstabdetect`` and
``vidstabtransform``, at as many bits per second as the clip has. Frames that are pictures become a clip first. Told:

* wobble: what a turn of the camera and a change of scale leave of the tracks between neighbouring frames: root mean
  square of 90 % of them, median of all pairs [px of 1080 rows];
* shake and turn: jitter of the path (``benchmarks/stability.py``) [px];
* sharpness: variance of the Laplacian of luma, without a border of 6 %, mean of the frames;
* crop: share of the width and height that is cut off, as tracks from frames to the clip's own show it [%];
* bits of the video [kbit/s].

Two pairs of photos are no clips: one camera read from the top and from the bottom at once (``dual``), where the
distance of corners between the two is twice the distortion; and two frames of a phone (``pair_phone``).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
from stability import measured

from unshutter.frames.self_calibration import usual_focal
from unshutter.frames.tracks import follow
from unshutter.video.calibrate.gain import TALL, wobble
from unshutter_lab.evaluation.clip_wobble import grey_frames
from unshutter_lab.evaluation.real_clips import straighten

CLIPS = {  # name: files of DATA, frames a second, readout ratio if it is known
    "karma": ("video/gopro_karma.mp4", 0.0, None),
    "windscreen": ("video/street_phone/RE_frame-*.jpg", 30.0, "0.6"),
    "carla_town05": ("video/carla_town05/*.png", 30.0, "1"),
}
BITS = 8_000_000  # a second, of clips made of pictures of 1920x1080 px; of smaller ones as many per pixel
SMOOTHING = 15  # frames before and after
HEAD = (
    "| clip | wobble, px | shake, px | turn, px | sharpness | crop, % | kbit/s | result |\n"
    "|---|---|---|---|---|---|---|---|"
)


def grey(path: Path) -> np.ndarray:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    return picture


def from_pictures(paths: list[Path], rate: float, out: Path) -> None:
    """Writes pictures as a clip."""
    with av.open(str(out), "w") as video:
        height, width = grey(paths[0]).shape
        stream = video.add_stream("libx264", rate=int(rate), options={"preset": "medium"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.bit_rate = BITS * width * height // (1920 * 1080)
        for path in paths:
            video.mux(stream.encode(av.VideoFrame.from_ndarray(cv2.imread(str(path)), format="bgr24")))
        video.mux(stream.encode(None))


def kbits(path: Path) -> int:
    """Bits of the video [kbit/s]."""
    with av.open(str(path)) as clip:
        video = clip.streams.video[0]
        size = sum(packet.size for packet in clip.demux(video))
        return round(8 * size / (video.frames / float(video.average_rate or 30)) / 1000)


def wobbles(path: Path) -> Iterator[float]:
    """Yields what a turning camera leaves of the tracks of each pair of frames [px of 1080 rows]."""
    for (_, before), (_, after) in pairwise(grey_frames(path)):
        tracks = follow(before, after)
        if len(tracks) > 20:
            yield wobble(tracks, usual_focal(tracks))


def sharpness(path: Path) -> float:
    border = 0.06
    found = []
    for _, frame in grey_frames(path):
        rows, cols = (slice(int(border * side), -int(border * side)) for side in frame.shape)
        found.append(cv2.Laplacian(frame[rows, cols], cv2.CV_64F).var())
    return float(np.mean(found))


def crop(path: Path, clip: Path) -> float:
    """Share of the width and height that is cut off [%]."""
    scales = []
    for k, ((_, now), (_, before)) in enumerate(zip(grey_frames(path), grey_frames(clip), strict=False)):
        if k % 5 == 0:
            tracks = follow(before, now)
            if len(tracks) > 20:
                matrix, _ = cv2.estimateAffinePartial2D(tracks.start, tracks.end, ransacReprojThreshold=3.0)
                scales.append(np.hypot(*matrix[:, 0]))
    return 100 * (1 - 1 / float(np.median(scales)))


def report(name: str, clip: Path, path: Path, said: str) -> None:
    shake, turn, _, _ = measured(str(path))
    cut = 0.0 if path == clip else crop(path, clip)
    row = f"{np.median(list(wobbles(path))):.2f} | {shake:.2f} | {turn:.2f} | {sharpness(path):.0f} | {cut:.1f}"
    print(f"| {name} | {row} | {kbits(path)} | {said} |", flush=True)


def vidstab(clip: Path, out: Path, preset: str) -> None:
    ffmpeg = ["ffmpeg", "-hide_banner", "-loglevel", "error", "-y", "-i", str(clip)]
    moves = out.with_suffix(".trf")
    detect, smooth = "vidstabdetect=shakiness=6:accuracy=15", "optzoom=1:interpol=bicubic"
    subprocess.run([*ffmpeg, "-vf", f"{detect}:result={moves}", "-f", "null", "-"], check=True)
    transform = f"vidstabtransform=input={moves}:smoothing={SMOOTHING}:{smooth}"
    rate = ["-c:v", "libx264", "-preset", preset, "-b:v", f"{kbits(clip)}k"]
    subprocess.run([*ffmpeg, "-vf", transform, *rate, "-an", "-dn", str(out)], check=True)


def video(name: str, clip: Path, ratio: str | None, folder: Path, preset: str) -> None:
    report(f"{name}: as taken", clip, clip, "")
    given = ("--readout-ratio", ratio) if ratio else ("--readout-ms", "30")
    ways = {"ours": (), "readout time given": given, "--stabilize": ("--stabilize", "1")}
    for way, flags in ways.items():
        out = folder / f"{name}-{way}.mp4"
        done = straighten(clip, out, *flags, *(("--preset", preset) if way != "ours" else ()))
        why = max(done["left"], key=done["left"].get, default="")
        report(f"{name}: {way}", clip, out, f"{done['rectified']} of {done['frames']} frames changed; {why}")
    out = folder / f"{name}-vidstab.mp4"
    vidstab(clip, out, preset)
    report(f"{name}: vid.stab", clip, out, "")


def two(name: str, before: Path, after: Path, folder: Path, *flags: str) -> None:
    """Prints how far apart two photos of one moment, or of neighbouring ones, are before and after."""
    words = ["-o", str(folder / name), "--overwrite", "--edges", "keep", *flags]
    subprocess.run([sys.executable, "-m", "unshutter", "rectify", str(before), str(after), *words], check=True)
    results = [next((folder / name).glob(f"{path.stem}.*")) for path in (before, after)]
    for way, paths in (("as taken", (before, after)), ("ours", results)):
        one, other = map(grey, paths)
        tracks = follow(one, other)
        unit = TALL / min(one.shape)
        apart = float(np.median(np.hypot(*(tracks.end - tracks.start).T))) * unit
        print(f"| {name} | {way} | {apart:.2f} | {wobble(tracks, usual_focal(tracks)):.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--keep", type=Path, help="keep the clips in this folder")
    parser.add_argument("--only", nargs="+", default=[*CLIPS, "pairs"])
    parser.add_argument("--preset", default="medium")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = given.keep or Path(name)
        print(HEAD)
        for clip in set(CLIPS) & set(given.only):
            files, rate, ratio = CLIPS[clip]
            paths = sorted(given.data.glob(files), key=lambda path: (len(path.name), path.name))
            if rate and paths:
                from_pictures(paths, rate, folder / f"{clip}.mp4")
                paths = [folder / f"{clip}.mp4"]
            if paths:
                video(clip, paths[0], ratio, folder, given.preset)
        if "pairs" in given.only:
            print("\n| pair | | corners apart, px | wobble, px |\n|---|---|---|---|")
            for kind in ("r0", "s0"):
                two(f"dual {kind}", *(given.data / "dual" / f"ifed_{kind}_{way}.png" for way in ("t2b", "b2t")), folder)
            phone = sorted((given.data / "pair_phone").glob("*.jpg"))
            two("pair_phone", *phone, folder)
            two("pair_phone, --sequence", *phone, folder, "--sequence", "--readout-ratio", "0.6")


if __name__ == "__main__":
    main()
