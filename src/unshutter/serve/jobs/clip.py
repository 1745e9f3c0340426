"""Jobs on a clip: previews of a few moments, the readout time, and the whole clip as ``unshutter video`` writes it."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Readout
from unshutter.serve.jobs.cache import OpenFile, ProgressFile, digest, errors_of, put
from unshutter.serve.jobs.facts import ClipFacts, MomentResult, ReadoutTime, SavedClip
from unshutter.serve.jobs.screen import as_jpeg
from unshutter.video.options import RectifyClip

if TYPE_CHECKING:
    import numpy as np
    from av import VideoFrame

    from unshutter.frames.self_calibration import ReadoutRatio
    from unshutter.frames.sequence import CameraMotion
    from unshutter.video.clip import Clip
    from unshutter.video.moving_frames import MovingFrame

MOMENTS = 5  # number of moments of a clip that are shown
_AROUND = 12  # frames on each side of a moment used to estimate its motion


def before(open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """Returns an upright frame of the clip as a JPEG for the screen, and :class:`ClipFacts` as JSON.

    Args:
        open_file: the clip.
        options: options of the clip; only start and end are used.
        moment: index of the moment, 0 ... MOMENTS - 1, spaced evenly between start and end.
        longest: longer side [px], or None for full size.

    Raises:
        UnshutterError: the clip cannot be read.
    """
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        moments_s = [moment_time(clip, options, k) for k in range(MOMENTS)]
        frame = _frame_at(clip, moments_s[moment])
        facts = ClipFacts(*_upright_size(frame, None), clip.duration_s, 1 / clip.interval_s, clip.frames, moments_s)
        return as_jpeg(_upright_pixels(frame, longest)), facts.as_json()


def after(open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """Returns a rectified frame of the clip as a JPEG for the screen, and :class:`MomentResult` as JSON.

    Its motion is estimated from the frames around it. Edges that would be cropped are kept, because the area common to
    all frames is known only once the whole clip has been read.

    Args:
        open_file, options, moment, longest: as for :func:`before`, but all options are used.

    Raises:
        UsageError, UnshutterError: the options do not fit the clip, or its readout time is unknown.
    """
    from unshutter.motion.verdict import LEAST_PX
    from unshutter.video.clip import Clip
    from unshutter.video.frame_warper import Warper

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        edges = options.undo.edges
        undo = replace(options.undo, edges="keep") if edges == "crop" else options.undo
        warper, moving = Warper(clip, undo), _moving_at(open_file, clip, options, moment_time(clip, options, moment))
        size = Readout.parse(options.shutter.readout).frame_size(clip.height, clip.width)
        motion = warper.motion(moving).resized(*size)
        pixels = _upright_pixels(warper.rectified(moving).picture, longest, turned_as=moving.frame)
        largest_px, reason, time_s = motion.largest_px, moving.motion.reason, moving.frame.time or 0.0
        result = MomentResult(not motion.is_zero, reason, largest_px, largest_px < LEAST_PX, edges, time_s)
        return as_jpeg(pixels), result.as_json()


def readout(open_file: OpenFile, options: RectifyClip) -> dict[str, Any]:
    """Returns the :class:`ReadoutTime` of a clip's camera as JSON.

    Raises:
        UnshutterError: the clip cannot be read, or its readout time is unknown.
    """
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        ratio, interval_ms = ratio_of(open_file, clip, options), 1000 * clip.interval_s
        times_ms = ratio.value * interval_ms, ratio.error * interval_ms
        plausible = ratio.plausible
        return ReadoutTime(
            ratio.value,
            ratio.error,
            *times_ms,
            ratio.source,
            ratio.camera if plausible is None else plausible.cameras,
            None if plausible is None else (plausible.lowest * interval_ms, plausible.highest * interval_ms),
            "" if ratio.instead_of is None else str(ratio.instead_of),
        ).as_json()


def rectified(open_file: OpenFile, target: Path, options: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    """Writes a clip as `unshutter video` does, and returns :class:`SavedClip` as JSON.

    Args:
        open_file: the clip.
        target: path of the output.
        options: options of the clip.
        progress: file to which progress is written.

    Raises:
        UsageError, UnshutterError: see :func:`unshutter.video.clip_rectification.rectify_clip_file`.
    """
    from unshutter.video.clip import Clip
    from unshutter.video.clip_rectification import rectify_clip_file

    progress.note("frames", 0, 0)
    with errors_of(open_file, {target: target.name, target.parent: "the folder"}):
        ratio = ratio_of(open_file, Clip.look(open_file.path), options, progress)
        return SavedClip(rectify_clip_file(str(open_file.path), str(target), options, ratio, progress.note)).as_json()


def ratio_of(
    open_file: OpenFile, clip: Clip, options: RectifyClip, progress: ProgressFile | None = None
) -> ReadoutRatio:
    """Returns the readout ratio of a clip: the user's, or else an estimate, which is cached.

    Raises:
        UnshutterError: the ratio cannot be estimated from the clip.
    """
    from unshutter.frames.self_calibration import ReadoutRatio
    from unshutter.video.readout_choice import readout_ratio_of_clip

    stated = options.shutter.ratio(clip.interval_s)
    if stated is not None:
        return ReadoutRatio(stated, 0.0, "given")
    part = options.span(clip.duration_s)
    file = open_file.path.with_name(f"readout-{digest(options.shutter, part)}.json")
    if not file.exists():
        readout = Readout.parse(options.shutter.readout)
        ratio = readout_ratio_of_clip(clip, readout, options.shutter, part, progress.note if progress else None)
        put(file, lambda new: new.write_text(json.dumps(ratio.as_json()), encoding="utf-8"))
    return ReadoutRatio.from_json(json.loads(file.read_text(encoding="utf-8")))


def moment_time(clip: Clip, options: RectifyClip, moment: int) -> float:
    """Returns the time of a moment [s]: the middle of one of MOMENTS equal parts."""
    start, end = options.start or 0.0, min(options.end or clip.duration_s, clip.duration_s)
    return start + (moment + 0.5) / MOMENTS * max(end - start, 0.0)


def camera_of(clip: Clip, options: RectifyClip, ratio: ReadoutRatio) -> CameraMotion:
    """Returns the estimator of camera motion for a clip's frames."""
    from unshutter.frames.sequence import CameraMotion
    from unshutter.video.moving_frames import FEWEST, window

    readout = Readout.parse(options.shutter.readout)
    return CameraMotion(ratio, options.shutter.focal_px, readout, window=window(clip), fewest=FEWEST)


def _frame_at(clip: Clip, time_s: float) -> VideoFrame:
    for frame in clip.iter_frames(max(time_s - clip.interval_s / 2, 0.0)):
        return frame
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: its part ends before")


def _moving_at(open_file: OpenFile, clip: Clip, options: RectifyClip, time_s: float) -> MovingFrame:
    """Returns the frame at a time [s] and its motion, which is cached."""
    from unshutter.motion import Motion
    from unshutter.video.moving_frames import MovingFrame, with_motion

    ratio = ratio_of(open_file, clip, options)
    file = open_file.path.with_name(f"moment-{digest(options.shutter, ratio, time_s)}.json")
    if file.exists():
        return MovingFrame(_frame_at(clip, time_s), Motion.from_json(file.read_text(encoding="utf-8")))
    camera = camera_of(clip, options, ratio)
    first = max(time_s - _AROUND * clip.interval_s, 0.0)
    for moving in with_motion(clip, islice(clip.iter_frames(first), 2 * _AROUND + 1), camera):
        if isinstance(moving, MovingFrame) and (moving.frame.time or 0.0) >= time_s - clip.interval_s / 2:
            put(file, lambda part, motion=moving.motion: part.write_text(motion.to_json(), encoding="utf-8"))
            return moving
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: its part ends before")


# ---- upright frames ----------------------------------------------------------------------------------------------


def _upright_pixels(frame: VideoFrame, longest: int | None, turned_as: VideoFrame | None = None) -> np.ndarray:
    """Returns the [H, W, 3] RGB pixels of a frame, upright.

    Args:
        frame: the decoded frame.
        longest: longer side [px], or None for full size.
        turned_as: frame from which to take the rotation, if this one does not have it.
    """
    turns = _quarter_turns(turned_as or frame)
    height, width = _upright_size(frame, longest, turns)
    size = (width, height) if turns % 2 == 0 else (height, width)
    return upright_pixels(frame.reformat(*size, format="rgb24").to_ndarray(), turned_as or frame)


def upright_pixels(pixels: np.ndarray, turned_as: VideoFrame) -> np.ndarray:
    """Turns [H, W, 3] pixels upright, using the rotation stored in a frame."""
    import numpy as np

    return np.ascontiguousarray(np.rot90(pixels, _quarter_turns(turned_as)))


def _upright_size(frame: VideoFrame, longest: int | None, turns: int | None = None) -> tuple[int, int]:
    """Returns the height and width of a frame once it has been turned upright [px]."""
    height, width = (frame.height, frame.width)
    scale = 1.0 if longest is None else min(longest / max(height, width), 1.0)
    height, width = (max(2, round(side * scale)) for side in (height, width))
    return (height, width) if (_quarter_turns(frame) if turns is None else turns) % 2 == 0 else (width, height)


def _quarter_turns(frame: VideoFrame) -> int:
    """Returns the number of anticlockwise quarter turns that turn a frame upright."""
    return round(frame.rotation / 90)
