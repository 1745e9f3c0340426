"""A sheet for comparing readout times: one frame as taken, and rectified with each of them, side by side."""

from __future__ import annotations

import math
from contextlib import closing
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.geometry.readout import Readout
from unshutter.progress import Steps, Watch
from unshutter.storage.files import check_target, written_whole
from unshutter.storage.protection import Protection
from unshutter.video import pictures
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.clip_preview import small_picture
from unshutter.video.frame_warper import Warper
from unshutter.video.moving_frames import FEWEST, MovingFrame, window, with_motion
from unshutter.video.options import RectifyClip
from unshutter.video.output_checks import on_this_machine
from unshutter.video.pipeline import Pipeline

_ENDINGS = (".jpg", ".jpeg", ".png")
_AROUND = 12  # frames on both sides of the one shown, used for estimating its motion
_MOST = 8  # readout times on a sheet
_ACROSS = 2  # pictures per row
_LABEL_PX = 28


def parsed_times(text: str) -> list[float]:
    """Parses readout times [ms] such as ``8,12,16,20``.

    Raises:
        UsageError: it is not a list of up to eight positive numbers.
    """
    try:
        times = [float(part) for part in text.split(",")]
    except ValueError:
        times = []
    if not 1 <= len(times) <= _MOST or not all(0 < ms < math.inf for ms in times):
        raise UsageError(f"--try takes up to {_MOST} readout times in ms, such as 8,12,16,20, not '{text}'")
    return times


def write_trial(
    source: str, output: str, options: RectifyClip, times_ms: list[float], watch: Watch | None = None
) -> float:
    """Writes the sheet for the frame at which the readout times differ most; returns that frame's time [s].

    Args:
        source: the clip.
        output: the sheet, a .jpg or .png file.
        options: the part of the clip to search, and how motion is undone.
        times_ms: the readout times [ms].
        watch: called for every frame.

    Raises:
        UsageError: a readout time is longer than a frame interval, or the sheet's file ending is that of another kind.
        UnshutterError: the clip cannot be read, the sheet cannot be written, or no frame shows motion.
    """
    path, target = on_this_machine(source), Path(on_this_machine(output))
    if target.suffix.lower() not in _ENDINGS:
        raise UsageError(f"--try writes a picture: name a .jpg or .png file, not {target.name}")
    Protection(pictures.files_of(path)).check(target)
    check_target(target, options.overwrite)
    clip = Clip.look(path, options.fps, options.max_pixels)
    longest_ms = 1000 * clip.interval_s
    if max(times_ms) > 1.0005 * longest_ms:
        raise UsageError(f"frames are {longest_ms:.2f} ms apart: they cannot take {max(times_ms):g} ms to be read out")
    ratios = [min(ms / longest_ms, 1.0) for ms in times_ms]
    time_s = _most_distorted(clip, options, max(ratios), watch)
    sheet = _sheet(clip, options, time_s, [None, *ratios], ["as taken", *(f"{ms:g} ms" for ms in times_ms)])
    with written_whole(target, options.overwrite) as part:
        if not cv2.imwrite(str(part), sheet[..., ::-1]):
            raise UnshutterError(f"cannot write {target}")
    return time_s


def _most_distorted(clip: Clip, options: RectifyClip, ratio: float, watch: Watch | None) -> float:
    """Returns the time of the frame that a readout ratio changes most [s]."""
    readout = Readout.parse(options.shutter.readout)
    pipeline = Pipeline(clip, options, ReadoutRatio(ratio, 0.0, "given"), readout)
    steps, largest, time_s = Steps("looking", clip.expected_frames(options.start, options.end), watch), 0.0, None
    with closing(pipeline.moving()) as items:
        for item in items:
            if not isinstance(item, SidePacket):
                steps.advance()
                if item.motion.largest_px > largest:
                    largest, time_s = item.motion.largest_px, item.frame.time or 0.0
    if time_s is None:
        raise UnshutterError("{clip} shows no motion: all readout times give the same frames", clip=clip.path)
    return time_s


def _sheet(
    clip: Clip, options: RectifyClip, time_s: float, ratios: list[float | None], labels: list[str]
) -> np.ndarray:
    """[H, W, 3] RGB: the frame for each ratio, or as taken for None, with its label."""
    tiles = []
    for ratio, label in zip(ratios, labels, strict=True):
        moving = _moving_at(clip, options, time_s, ratio or 1.0)
        frame = moving.frame if ratio is None else Warper(clip, options.undo).rectified(moving).picture
        picture = small_picture(frame, turned_as=moving.frame)
        banner = np.full((_LABEL_PX, picture.shape[1], 3), 255, np.uint8)
        cv2.putText(banner, label, (8, _LABEL_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(np.concatenate([banner, picture]))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % _ACROSS)
    return np.concatenate([np.concatenate(tiles[k : k + _ACROSS], 1) for k in range(0, len(tiles), _ACROSS)])


def _moving_at(clip: Clip, options: RectifyClip, time_s: float, ratio: float) -> MovingFrame:
    """Returns the frame at a time [s] with its motion for a readout ratio."""
    readout = Readout.parse(options.shutter.readout)
    known = ReadoutRatio(ratio, 0.0, "given")
    camera = CameraMotion(known, options.shutter.focal_px, readout, window=window(clip), fewest=FEWEST)
    first = max(time_s - _AROUND * clip.interval_s, 0.0)
    for moving in with_motion(clip, islice(clip.iter_frames(first), 2 * _AROUND + 1), camera):
        if isinstance(moving, MovingFrame) and (moving.frame.time or 0.0) >= time_s - clip.interval_s / 2:
            return moving
    raise UnshutterError(f"{{clip}} has no frame at {time_s:.1f} s", clip=clip.path)
