"""Clips of 48 kinds into MP4, QuickTime and Matroska: each stream is kept, or named. Needs the ffmpeg program.

Usage:
    python benchmarks/clip_files.py FOLDER [--only TEXT]

Prints a line for each combination, and the counts for docs/research/clips.md:

    fine    all streams are kept, and FFmpeg reads the result to its end; sound has the same length
    named   a stream was left out, or nothing was written, and a line says which and why
    bad     everything else
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import av
from av.error import FFmpegError

FRAMES, ENDINGS = 24, ("mp4", "mov", "mkv")
FILM = "scale=352:288,rotate=0.02*sin(n):fillcolor=gray,crop=320:240:16+8*sin(n/2):24+8*sin(n/3)"
X264 = "-c:v libx264 -preset ultrafast -pix_fmt yuv420p"
AAC = "-c:a aac"
EXTRAS = {
    "srt": "1\n00:00:00,100 --> 00:00:00,700\nwords\n",
    "ffmeta": ";FFMETADATA1\ntitle=Walk\n[CHAPTER]\nTIMEBASE=1/1000\nSTART=0\nEND=400\ntitle=One\n",
}
# name and ending of the source -> ffmpeg's options; {srt}, {png}, {jpg} and {ttf} are files
SOURCES = {
    **{
        name: f"{video} {sound}"
        for name, video, sound in (
            ("mjpeg-u8.avi", "-c:v mjpeg -pix_fmt yuvj420p", "-c:a pcm_u8"),
            ("mjpeg-422.avi", "-c:v mjpeg -pix_fmt yuvj422p", "-c:a pcm_s16le"),
            ("xvid-mp3.avi", "-c:v mpeg4 -vtag XVID -bf 0", "-c:a libmp3lame"),
            ("xvid-b.avi", "-c:v mpeg4 -vtag XVID -bf 2", "-c:a libmp3lame"),
            ("divx.avi", "-c:v mpeg4 -vtag DX50", "-c:a ac3"),
            ("msmpeg4.avi", "-c:v msmpeg4", "-c:a libmp3lame"),
            ("h264.avi", X264, "-c:a pcm_s16le"),
            ("h264-b.avi", f"{X264} -preset medium -bf 2", "-c:a aac"),
            ("raw-i420.avi", "-c:v rawvideo -pix_fmt yuv420p", "-c:a pcm_s16le"),
            ("raw-yuyv.avi", "-c:v rawvideo -pix_fmt yuyv422", "-an"),
            ("raw-bgr.avi", "-c:v rawvideo -pix_fmt bgr24", "-an"),
            ("huffyuv.avi", "-c:v huffyuv -pix_fmt yuv422p", "-c:a pcm_s24le"),
            ("ffvhuff.avi", "-c:v ffvhuff -pix_fmt yuv420p", "-an"),
            ("ffv1.avi", "-c:v ffv1 -pix_fmt yuv420p", "-c:a pcm_s16le"),
            ("utvideo.avi", "-c:v utvideo -pix_fmt yuv420p", "-an"),
            ("dv.avi", "-c:v dvvideo -s 720x576 -r 25 -pix_fmt yuv420p", "-c:a pcm_s16le -ar 48000"),
            ("mpeg2.avi", "-c:v mpeg2video", "-c:a mp2"),
            ("wmv2.avi", "-c:v wmv2", "-c:a wmav2"),
            ("cinepak.avi", "-c:v cinepak", "-an"),
            ("alaw.avi", "-c:v mpeg4", "-c:a pcm_alaw -ar 8000"),
            ("s16le.mov", X264, "-c:a pcm_s16le"),
            ("s16be.mov", X264, "-c:a pcm_s16be"),
            ("s24.mov", X264, "-c:a pcm_s24le"),
            ("s32-6ch.mkv", X264, "-c:a pcm_s32le -ac 6"),
            ("f32.mkv", X264, "-c:a pcm_f32le"),
            ("u8.mkv", X264, "-c:a pcm_u8"),
            ("alaw.mov", X264, "-c:a pcm_alaw -ar 8000"),
            ("mulaw.mov", X264, "-c:a pcm_mulaw -ar 8000"),
            ("opus.mkv", X264, "-c:a libopus"),
            ("vorbis.mkv", X264, "-c:a libvorbis"),
            ("flac.mkv", X264, "-c:a flac"),
            ("flac-mp4.mp4", X264, "-c:a flac -strict -2"),
            ("alac.mov", X264, "-c:a alac"),
            ("ac3.mkv", X264, "-c:a ac3"),
            ("eac3.mp4", X264, "-c:a eac3"),
            ("dts.mkv", X264, "-c:a dca -strict -2"),
            ("truehd.mkv", X264, "-c:a truehd -strict -2"),
            ("ts.ts", X264, "-c:a mp2"),
        )
    },
    "timecode.mov": f"{X264} {AAC} -timecode 01:02:03:04",
    "timecode.mp4": f"{X264} {AAC} -timecode 01:02:03:04",
    "srt.mkv": f"-i {{srt}} -map 0 -map 1 -map 2 {X264} {AAC} -c:s srt",
    "ass.mkv": f"-i {{srt}} -map 0 -map 1 -map 2 {X264} {AAC} -c:s ass",
    "tx3g.mp4": f"-i {{srt}} -map 0 -map 1 -map 2 {X264} {AAC} -c:s mov_text",
    "cover.mp4": f"-i {{png}} -map 0 -map 1 -map 2 {X264} {AAC} -c:v:1 copy -disposition:v:1 attached_pic",
    "attachments.mkv": f"{X264} {AAC} -attach {{jpg}} -metadata:s:t:0 mimetype=image/jpeg -attach {{ttf}} "
    "-metadata:s:t:1 mimetype=font/ttf",
    "chapters.mp4": f"-i {{ffmeta}} -map_metadata 2 -map 0 -map 1 {X264} {AAC}",
    "vp9-opus.webm": "-c:v libvpx-vp9 -deadline realtime -cpu-used 8 -c:a libopus",
    "prores.mov": "-c:v prores_ks -pix_fmt yuv422p10le -c:a pcm_s24be",
}


def made(folder: Path, name: str) -> Path:
    """Makes a source of two inputs, video and sound, and returns its path."""
    target = folder / name
    seconds = FRAMES / 30
    files = {kind: folder / f"extra.{kind}" for kind in ("srt", "ffmeta", "png", "jpg", "ttf")}
    options = SOURCES[name].format(**files)
    first = f"-f lavfi -i mandelbrot=size=640x480:rate=30,format=yuv420p,{FILM}"
    sound = "-f lavfi -i sine=frequency=440:sample_rate=48000"
    subprocess.run(
        ["ffmpeg", "-v", "error", "-y", *first.split(), *sound.split(), *options.split(), "-t", str(seconds), target],
        check=True,
    )
    return target


def make_extras(folder: Path) -> None:
    """Writes the files that some sources contain."""
    for kind, text in EXTRAS.items():
        (folder / f"extra.{kind}").write_text(text)
    (folder / "extra.ttf").write_bytes(b"\0\1\0\0 a font")
    for kind in ("png", "jpg"):
        picture = ["ffmpeg", "-v", "error", "-y", "-f", "lavfi", "-i", "color=red:size=64x64", "-frames:v", "1"]
        subprocess.run([*picture, folder / f"extra.{kind}"], check=True)


def streams(path: Path) -> list[dict]:
    """What ffprobe says of the streams of a file."""
    words = ["ffprobe", "-v", "error", "-show_streams", "-count_frames", "-show_chapters", "-of", "json", str(path)]
    said = json.loads(subprocess.run(words, check=True, capture_output=True).stdout)
    return [*said["streams"], *({"codec_type": "chapter"} for _ in said["chapters"])]


def contents(path: Path) -> Counter:
    """Kinds of streams in a file; timecode counts once, however it is stored."""
    counts: Counter = Counter()
    for stream in streams(path):
        tags = {key.lower() for key in stream.get("tags", {})}
        kind = "cover" if stream.get("disposition", {}).get("attached_pic") else stream["codec_type"]
        if kind != "data":
            counts[kind] += 1
        if "timecode" in tags:
            counts["timecode"] = 1
    return counts


def sound_s(path: Path) -> float:
    """Length of the sound in a file [s]; decodes all of it and the video."""
    with av.open(str(path)) as video:
        frames = [
            frame
            for frame in video.decode(*video.streams.video, *video.streams.audio)
            if isinstance(frame, av.AudioFrame)
        ]
        return sum(frame.samples / frame.sample_rate for frame in frames)


def result(source: Path, target: Path) -> tuple[str, str]:
    """Rectifies a source into a target; returns the verdict and what speaks for it."""
    words = [sys.executable, "-m", "unshutter", "video", source, "-o", target, "--readout-ratio", "0.6", "--overwrite"]
    run = subprocess.run([str(word) for word in words], check=False, capture_output=True, text=True)
    lines = run.stderr.strip().splitlines()
    if run.returncode:
        plain = len(lines) >= 1 and "Traceback" not in run.stderr and not target.exists()
        return ("named" if plain else "bad"), lines[-1] if lines else ""
    try:
        samples = [sound_s(path) for path in (source, target)]
    except FFmpegError as error:
        return "bad", str(error)
    had, has = contents(source), contents(target)
    missing = had - has
    named = [line for line in lines if "not kept" in line]
    if sum(missing.values()) > (len(named[0].split(": ", 2)[-1].split(", stream")) if named else 0):
        return "bad", f"{dict(missing)} is missing; said: {named}"
    if not missing["audio"] and abs(samples[0] - samples[1]) > 0.05:
        return "bad", f"{samples[0]:.2f} s of sound became {samples[1]:.2f} s"
    frames = [next(s["nb_read_frames"] for s in streams(p) if s["codec_type"] == "video") for p in (source, target)]
    if frames[0] != frames[1]:
        return "bad", f"{frames[0]} frames became {frames[1]}"
    return ("named", named[0]) if named else ("fine", "")


def main() -> None:
    """Runs all combinations."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    make_extras(arguments.folder)
    counts: Counter = Counter()
    for name in SOURCES:
        if arguments.only not in name:
            continue
        source = made(arguments.folder, name)
        for ending in ENDINGS:
            verdict, why = result(source, arguments.folder / f"{name.replace('.', '-')}.out.{ending}")
            counts[ending, verdict] += 1
            print(f"{verdict:5} {name:16} {ending}  {why}", flush=True)
    for ending in ENDINGS:
        print(ending, *(f"{counts[ending, verdict]} {verdict}" for verdict in ("fine", "named", "bad")))


if __name__ == "__main__":
    main()
