"""Jobs on a clip: a few moments and short films to look at, the readout time, and the whole clip."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av
from unshutter.options.clip_options import RectifyClip
from unshutter.orientation import Readout
from unshutter.page.opened import OpenFile, ProgressFile, as_jpeg, digest, errors_of, put, put_text
from unshutter.readout_time import ReadoutTime

if TYPE_CHECKING:
    import numpy as np
    from av import VideoFrame

    from unshutter.motion.shapes import UInt8
    from unshutter.video.clip import Clip, ClipRequest
    from unshutter.video.frame_warper import MovingFrame

MOMENTS = 5  # number of moments of a clip that are shown
_AROUND = 12  # frames on each side of a moment used to estimate its motion
_FILM_S = 8.0  # longest film
_FILM_FRAMES = 480
_FILM_SIDE = 640  # px, longer side of either half
_QUALITY = "22"  # constant quality at any bit rate: with a fixed bit rate, VP9's fastest setting shows blocks


def before(open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """Returns an upright frame of the clip as a JPEG for the screen, and facts from its file as JSON.

    Args:
        open_file: the clip.
        options: options of the clip; only start and end are used.
        moment: index of the moment, 0 ... MOMENTS - 1, spaced evenly between start and end.
        longest: longer side [px], or None for full size.
    """
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        moments_s = [_moment_time(clip, options, k) for k in range(MOMENTS)]
        frame = _frame_at(clip, moments_s[moment])
        is_turned = round(frame.rotation / 90) % 2 == 1
        facts = {
            "height": frame.width if is_turned else frame.height,
            "width": frame.height if is_turned else frame.width,
            "duration_s": clip.duration_s,
            "fps": 1 / clip.interval_s,
            "frames": clip.frames,
            "moments_s": moments_s,
        }
        return as_jpeg(_small(frame, longest, frame)), facts


def after(open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """Returns a rectified frame of the clip as a JPEG for the screen, and what was done to it as JSON.

    Its motion is estimated from the frames around it. Edges that would be cropped are kept, because the area common to
    all frames is known only once the whole clip has been read.
    """
    from unshutter.video.clip import Clip
    from unshutter.video.frame_warper import Warper

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        edges = options.undo.edges
        undo = replace(options.undo, edges="keep") if edges == "crop" else options.undo
        warper, moving = Warper(clip, undo), _moving_at(open_file, clip, options, _moment_time(clip, options, moment))
        size = Readout.parse(options.shutter.readout).frame_size(clip.height, clip.width)
        motion = warper.motion(moving).resized(*size)
        pixels = _small(warper.rectified(moving).picture, longest, moving.frame)
        result = {"changed": not motion.is_zero, "largest_px": motion.largest_px, "edges": edges, "reason": ""}
        if moving.motion.reason is not None:
            about = moving.motion.reason.as_json()
            result |= {"reason": about["sentence"], "code": about["code"], "figures": about["figures"]}
        return as_jpeg(pixels), result


def readout(open_file: OpenFile, options: RectifyClip) -> dict[str, Any]:
    """Returns the readout time of a clip's camera, its error and its source as JSON."""
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        time = _time_of(open_file, clip, options)
        return {
            "ratio": time.value,
            "ms": time.ms,
            "ms_sd": time.error_ms,
            "found_by": time.source,
            "cameras": time.camera,
            "plausible_ms": time.plausible_ms,  # range of the typical time; None if the time is known
            "reason": "" if time.instead_of is None else str(time.instead_of),  # why a typical time is used
        }


def film(open_file: OpenFile, options: RectifyClip, moment: int) -> Path:
    """Returns the path of a WebM film around a moment, with each frame before (left) and after (right), upright."""
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        file = open_file.path.with_name(f"film-{digest(options, moment)}.webm")
        if not file.exists():
            pairs = _pairs(open_file, clip, options, moment)
            put(file, lambda part: _write(part, pairs, clip.interval_s))
        return file


def rectified(open_file: OpenFile, target: Path, options: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    """Writes a clip as `unshutter video` does, and returns a summary of the run as JSON.

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
        time = _time_of(open_file, Clip.look(open_file.path), options, progress)
        record = rectify_clip_file(str(open_file.path), str(target), options, time, progress.note).as_json()
    return {name: record[name] for name in ("frames", "rectified", "left_out")}


def _time_of(
    open_file: OpenFile, clip: Clip, options: RectifyClip, progress: ProgressFile | None = None
) -> ReadoutTime:
    """Returns the readout time of a clip: the user's, or else an estimate, which is cached."""
    from unshutter.video.clip_rectification import camera_of_clip

    stated = options.shutter.readout_time(clip.interval_s)
    if stated is not None:
        return stated
    part = options.span(clip.duration_s)
    file = open_file.path.with_name(f"readout-{digest(options.shutter, part)}.json")
    if not file.exists():
        time, _ = camera_of_clip(_request(open_file, clip, options, progress))
        put_text(file, json.dumps(time.as_json()))
    return ReadoutTime.from_json(json.loads(file.read_text(encoding="utf-8"))).in_frames(clip.interval_s)


def _request(
    open_file: OpenFile, clip: Clip, options: RectifyClip, progress: ProgressFile | None = None
) -> ClipRequest:
    """Returns the request of a clip with its lens, which is cached."""
    from unshutter.motion.lens import Lens
    from unshutter.video.clip import ClipRequest
    from unshutter.video.lenses import lens_of_clip

    request = ClipRequest.of(clip, options, progress.note if progress else None)
    file = open_file.path.with_name(f"lens-{digest(options.shutter, options.span(clip.duration_s))}.json")
    if not file.exists():
        lens = lens_of_clip(request)
        put_text(file, json.dumps(lens and lens.as_json()))
    known = json.loads(file.read_text(encoding="utf-8"))
    return request if known is None else replace(request, lens=Lens.of_json(known))


def _moment_time(clip: Clip, options: RectifyClip, moment: int) -> float:
    """Returns the time of a moment [s]: the middle of one of MOMENTS equal parts."""
    start, end = options.start or 0.0, min(options.end or clip.duration_s, clip.duration_s)
    return start + (moment + 0.5) / MOMENTS * max(end - start, 0.0)


def _frame_at(clip: Clip, time_s: float) -> VideoFrame:
    for frame in clip.iter_frames(max(time_s - clip.interval_s / 2, 0.0)):
        return frame
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: the selected part ends earlier")


def _moving_at(open_file: OpenFile, clip: Clip, options: RectifyClip, time_s: float) -> MovingFrame:
    """Returns the frame at a time [s] and its motion, which is cached."""
    from unshutter.motion import Motion, RowMotion
    from unshutter.video.frame_warper import ROWS, MovingFrame, with_motion

    time = _time_of(open_file, clip, options)
    if time.declined is not None:
        return MovingFrame(_frame_at(clip, time_s), RowMotion.zero(ROWS, ROWS, reason=time.declined))
    file = open_file.path.with_name(f"moment-{digest(options.shutter, time, time_s)}.json")
    if file.exists():
        return MovingFrame(_frame_at(clip, time_s), Motion.from_json(file.read_text(encoding="utf-8")))
    first = max(time_s - _AROUND * clip.interval_s, 0.0)
    frames = islice(clip.iter_frames(first), 2 * _AROUND + 1)
    for moving in with_motion(_request(open_file, clip, options), frames, time):
        if isinstance(moving, MovingFrame) and (moving.frame.time or 0.0) >= time_s - clip.interval_s / 2:
            put_text(file, moving.motion.to_json())
            return moving
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: the selected part ends earlier")


def _small(frame: VideoFrame, longest: int | None, turned_as: VideoFrame) -> np.ndarray:
    """Returns the [H, W, 3] RGB pixels of a frame, upright.

    Args:
        frame: the decoded frame.
        longest: longer side [px], or None for full size.
        turned_as: frame from which to take the rotation.
    """
    from unshutter.video.clip import upright

    scale = 1.0 if longest is None else min(longest / max(frame.height, frame.width), 1.0)
    height, width = (max(2, round(side * scale)) for side in (frame.height, frame.width))
    return upright(frame.reformat(width, height, format="rgb24").to_ndarray(), turned_as)


# ---- the film ----------------------------------------------------------------------------------------------------


def _pairs(
    open_file: OpenFile, clip: Clip, options: RectifyClip, moment: int
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Yields small frames around a moment, before and after side by side."""
    import numpy as np

    from unshutter.motion.warp import straighten
    from unshutter.video.clip import upright
    from unshutter.video.frame_warper import MovingFrame, Warper, with_motion

    time = _time_of(open_file, clip, options)
    readout = Readout.parse(options.shutter.readout)
    edges = "keep" if options.undo.edges in ("keep", "crop") else "fill"
    warper = Warper(clip, replace(options.undo, model="camera", edges=edges))
    start_s, end_s = options.span(clip.duration_s)
    first = max(_moment_time(clip, options, moment) - _FILM_S / 2, start_s)
    count = min(round(min(_FILM_S, end_s - first) / clip.interval_s), _FILM_FRAMES)
    frames = islice(clip.iter_frames(first), max(count, 1))
    for moving in with_motion(_request(open_file, clip, options), frames, time):
        if isinstance(moving, MovingFrame):
            scale = min(_FILM_SIDE / max(moving.frame.height, moving.frame.width), 1.0)
            height, width = (2 * max(round(side * scale / 2), 1) for side in (moving.frame.height, moving.frame.width))
            before = moving.frame.reformat(width, height, format="rgb24").to_ndarray()
            motion = warper.motion(moving).resized(*readout.frame_size(height, width))
            after = straighten(before, motion, edges).pixels
            turned = [upright(each, moving.frame) for each in (before, after)]
            yield np.concatenate(turned, axis=1)


def _write(file: Path, pairs: Iterator[UInt8[np.ndarray, "height width 3"]], interval_s: float) -> None:
    from unshutter.video.film_file import encode_pairs

    # a sixth of the work of VP8's fastest setting; keyframes are frequent enough for scrubbing
    settings = {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "g": "15", "crf": _QUALITY, "b": "0"}
    with av().open(str(file), "w", format="webm") as container:
        encode_pairs(container, pairs, interval_s, "libvpx-vp9", settings)
