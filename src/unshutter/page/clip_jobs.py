"""Jobs on clips: previews of single moments, short before-and-after videos, the readout time, and the whole clip."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.options.clip_options import ClipUndo, RectifyClip, Steadiness
from unshutter.page.opened import (
    MOMENTS,
    OpenFile,
    ProgressFile,
    errors_of,
    hash_options,
    progress_of,
    put,
    put_text,
    remembered,
)
from unshutter.page.screen import as_jpeg
from unshutter.page.sentences import reason_json, sentence
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.video.calibrate.camera import ClipCamera, find_camera
from unshutter.video.calibrate.clip_gyro import log_of_clip
from unshutter.video.calibrate.gain import is_tested
from unshutter.video.calibrate.questions import open_question
from unshutter.video.calibrate.readout_time import time_without_search, wobble_in_frames
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.decision import Decision, Leave, RectifyFrames, decide, why_unfit
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import ClipFacts, read_clip_facts
from unshutter.video.file.encoders import writable
from unshutter.video.file.pixels import ArrayFrame, PixelFormat, in_srgb, of_file, upright
from unshutter.video.file.previews import encode_pairs
from unshutter.video.file.row_samples import ROWS
from unshutter.video.file.stages import Stage
from unshutter.video.render.clip_motion import MovingFrame, with_motion
from unshutter.video.render.enlargement import Enlargement
from unshutter.video.render.frame_warper import Warper
from unshutter.video.render.rendering import Rendering, expected, with_views
from unshutter.video.render.stabilisation import CameraPath

if TYPE_CHECKING:
    from av import VideoFrame

    from unshutter.motion.shapes import UInt8

_AROUND = 12  # frames on each side of a moment used to estimate its motion
_EXCERPT_S = 8.0  # longest video; shorter above 60 frames a second
_EXCERPT_SIDE = 640  # px, longer side of either half


def before(open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None) -> tuple[bytes, JsonObject]:
    """Returns an upright frame of the clip as a JPEG for the screen, and facts from its file as JSON.

    ``moment`` counts the moments from 0, evenly spaced; ``longest`` is the longer side [px], or None for full size.
    """
    with _look(open_file) as clip:
        moments_s = [_moment_time(clip, options, k) for k in range(MOMENTS)]
        frame = _frame_at(clip, moments_s[moment])
        stored = frame.height, frame.width
        height, width = stored[::-1] if round(frame.rotation / 90) % 2 else stored
        facts = {"height": height, "width": width, "duration_s": clip.duration_s, "fps": 1 / clip.interval_s}
        of_clip_s = [time_s - clip.begin_s for time_s in moments_s]
        return as_jpeg(_small(frame, longest, frame)), facts | {"moments_s": of_clip_s, "encoders": writable(clip)}


def after(
    open_file: OpenFile, options: RectifyClip, moment: int, longest: int | None, usual: bool = False
) -> tuple[bytes, JsonObject]:
    """Returns a rectified frame of the clip as a JPEG for the screen, and what was done to it as JSON.

    Its motion is estimated from the frames around it, with the usual readout time of such cameras if ``usual``. Edges
    that would be cropped are kept, and the frame is enlarged as far as it needs itself: the area common to all frames
    is known only once the whole clip has been read.
    """
    with _look(open_file) as clip:
        undo = _shown_undo(options)
        warper = Warper(clip, undo)
        moving = _moving_at(open_file, clip, options, _moment_time(clip, options, moment), usual)
        motion = warper.motion(moving)
        if options.may_enlarge and options.steadiness.stabilize is None:
            height, width = motion.scan_direction.frame_size(*clip.picture_size)
            path = CameraPath(undo, motion.scan_direction, width / height)
            path.add(moving.found, moving.step, moving.cut, 0.0)
            moving = replace(moving, view=Enlargement.least(path, *clip.picture_size).of(None))
        if not motion.is_zero:
            motion = motion.resized(*motion.scan_direction.frame_size(*clip.picture_size))
        pixels = _small(of_file(warper.rectified(moving).picture), longest, of_file(moving.frame))
        result = {
            "changed": not motion.is_zero,
            "largest_px": motion.largest_px,
            "edges": options.undo.edges,
            "reason": "",
        }
        if moving.found.reason is not None:
            about = reason_json(moving.found.reason)
            result |= {"reason": about["sentence"], "code": about["code"], "figures": about["figures"]}
        return as_jpeg(pixels), result


def measure_readout_time(open_file: OpenFile, options: RectifyClip) -> JsonObject:
    """Returns the readout time of a clip's camera, its error and its source, and the clip's wobble as JSON."""
    with _look(open_file) as clip:
        request = _as_usual(ClipRequest.of(clip, options, progress_of(open_file)))
        _decided(open_file, request)
        camera, _, wobble_px = _found_in(open_file, request)
        interval_s = camera.complete(request).clip.camera_interval_s
        time = camera.readout_time
        return {
            "ratio": time.ratio(interval_s).value,
            "ms": time.ms,
            "ms_sd": time.error_ms,
            "found_by": time.source,
            "cameras": time.camera,
            "direction": camera.scan_direction or "",  # in which rows were read, if the frames show another than usual
            # wobble that the readout explains, from frame to frame; None if too few frames were looked at
            "wobble_px": wobble_px,
            # range of the typical time, of which no frame takes longer than one; None if the time is known
            "plausible_ms": time.plausible_ms and [min(each, 1000 * interval_s) for each in time.plausible_ms],
            "reason": "" if time.instead_of is None else str(time.instead_of),  # why a typical time stands in
            "left": why_unfit(camera) is not None,  # whether the clip is left as it is, unless its time is given
        }


def excerpt(open_file: OpenFile, options: RectifyClip, moment: int) -> Path:
    """Returns the path of a WebM video around a moment, with each frame before (left) and after (right), upright."""
    with _look(open_file) as clip:
        file = open_file.path.with_name(f"video-{hash_options(options, moment)}.webm")
        if not file.exists():
            pairs = _pairs(open_file, clip, options, moment)
            put(file, lambda part: _write(part, pairs, clip.interval_s))
        return file


_SHOWN = ("frames", "rectified", "left_out", "as_they_were", "parts")  # of a run's record


def rectified(open_file: OpenFile, target: Path, options: RectifyClip, progress: ProgressFile) -> JsonObject:
    """Writes a clip as `unshutter video` does, and returns a summary of the run as JSON."""
    progress.note_progress("frames", 0, 0)
    with errors_of(open_file, {target: target.name, target.parent: "the folder"}):
        decided = partial(_decided, open_file)
        record = rectify_clip_file(str(open_file.path), str(target), options, progress, decided).as_json()
    declined = [sentence(Reason.from_json(each)) for each in record["declined"]]
    return {**{name: record[name] for name in _SHOWN}, "declined": declined}


@contextmanager
def _look(open_file: OpenFile) -> Iterator[ClipFacts]:
    """Reads the facts of the clip; errors in the block refer to files by names that the user recognises."""
    with errors_of(open_file):
        yield read_clip_facts(open_file.path)


def _found_in(open_file: OpenFile, request: ClipRequest) -> tuple[ClipCamera, SampledFrames, float | None]:
    """Returns a clip's camera, the frames that were tracked for it, and the clip's wobble; cached."""

    def find() -> tuple[ClipCamera, SampledFrames, float | None]:
        camera, sampled = find_camera(request)
        return camera, sampled, wobble_in_frames(sampled, camera.complete(request).frame_size[0])

    _, parts = open_question(request, log_of_clip(request))
    return remembered(open_file, "camera", (request.options.shutter, request.span, parts), find)


def _decided(open_file: OpenFile, request: ClipRequest) -> tuple[ClipRequest, ClipCamera, Decision]:
    """Returns the request with the camera filled in, the camera, and the decision; cached."""

    def decide_for(steadiness: Steadiness) -> tuple[ClipCamera, Decision]:
        camera, sampled, _ = _found_in(open_file, request)
        options = replace(request.options, steadiness=steadiness)
        return camera, decide(camera.complete(replace(request, options=options)), camera, sampled)

    options = request.options
    undo = (options.undo.reference, options.undo.strength, options.undo.model)
    key = (options.shutter, request.span, undo)
    camera, decision = remembered(open_file, "plan", key, lambda: decide_for(Steadiness()))
    nothing = isinstance(decision, Leave) and decision.reason.code is Code.NOTHING_TO_SEE
    if nothing and options.steadiness.stabilize is not None:  # which plans otherwise
        camera, decision = remembered(open_file, "steady", key, lambda: decide_for(options.steadiness))
    return camera.complete(request), camera, decision


def _as_usual(request: ClipRequest) -> ClipRequest:
    """Returns the request with default options for undoing motion, by which a clip is judged at first."""
    return replace(request, options=replace(request.options, undo=ClipUndo(), steadiness=Steadiness()))


def _shown_decision(open_file: OpenFile, request: ClipRequest) -> tuple[ClipCamera, Decision]:
    """Returns a clip's camera, and the decision for its previews."""
    _, camera, decision = _decided(open_file, _as_usual(request))
    if is_tested(request.options):
        return camera, decision
    reason = why_unfit(camera)
    return camera, RectifyFrames() if reason is None else Leave(reason)


def _shown_undo(options: RectifyClip) -> ClipUndo:
    """Returns how motion is undone in what is shown: the crop common to all frames is known only at the clip's end."""
    return replace(options.undo, edges="keep") if options.undo.edges == "crop" else options.undo


def _moment_time(clip: ClipFacts, options: RectifyClip, moment: int) -> float:
    """Returns the time of a moment [s], on the clock of the frames: the middle of one of MOMENTS equal parts."""
    start = options.start or 0.0
    end = min(options.end or clip.duration_s, clip.duration_s)
    return clip.begin_s + start + (moment + 0.5) / MOMENTS * max(end - start, 0.0)


def _frame_at(clip: ClipFacts, time_s: float) -> VideoFrame:
    for frame in clip.frames_between(max(time_s - clip.interval_s / 2, 0.0)):
        return frame
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: the selected part ends earlier")


def _moving_at(open_file: OpenFile, clip: ClipFacts, options: RectifyClip, time_s: float, usual: bool) -> MovingFrame:
    """Returns the frame at a time [s] and its motion, which is cached."""
    request = ClipRequest.of(clip, options)
    if usual:
        camera, decision = ClipCamera(time_without_search(request)), RectifyFrames()
    else:
        camera, decision = _shown_decision(open_file, request)
    if isinstance(decision, Leave):
        return MovingFrame(_frame_at(clip, time_s), Finding(RowMotion.zero(ROWS, ROWS), reason=decision.reason))
    time = camera.readout_time
    file = open_file.path.with_name(f"moment-{hash_options(options.shutter, time, time_s, usual)}.json")
    if file.exists():
        return MovingFrame(_frame_at(clip, time_s), Finding.from_json(file.read_text(encoding="utf-8")))
    first = max(time_s - _AROUND * clip.interval_s, 0.0)
    frames = islice(clip.frames_between(first), 2 * _AROUND + 1)
    for moving in with_motion(camera.complete(request), frames, time):
        if (moving.frame.time or 0.0) >= time_s - clip.interval_s / 2:
            put_text(file, moving.found.to_json())
            return moving
    raise UnshutterError(f"the clip has no frame at {time_s:.1f} s: the selected part ends earlier")


def _small(frame: VideoFrame, longest: int | None, turned_as: VideoFrame) -> np.ndarray:
    """Returns the [H, W, 3] RGB pixels of a frame, turned upright as another frame states."""
    scale = 1.0 if longest is None else min(longest / max(frame.height, frame.width), 1.0)
    height, width = (max(2, round(side * scale)) for side in (frame.height, frame.width))
    return upright(in_srgb(frame, width, height), turned_as)


# ---- the video ----------------------------------------------------------------------------------------------------


def _pairs(
    open_file: OpenFile, clip: ClipFacts, options: RectifyClip, moment: int
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Yields small frames around a moment, before and after side by side."""
    request = ClipRequest.of(clip, options, progress_of(open_file))
    start_s, end_s = request.span
    first = max(_moment_time(clip, options, moment) - _EXCERPT_S / 2, start_s)
    last = min(first + min(_EXCERPT_S, 480 * clip.interval_s), end_s)
    part = replace(options, undo=replace(options.undo, model="camera"), start=first, end=last)
    request.work.expect(expected(replace(request, options=part), RectifyFrames()) | {Stage.ENCODE: 0})
    camera, decision = _shown_decision(open_file, request)
    request = camera.complete(replace(request, options=part))
    request.work.expect(dict.fromkeys(Stage, 0) | expected(request, decision) | {Stage.ENCODE: 0})
    rendering = with_views(Rendering(request, camera, decision))
    undo = _shown_undo(part)
    steps = request.steps("film", Stage.DRAW)
    for moving in rendering.moving(clip.frames_between(first, last)):
        frame = of_file(moving.frame)
        scale = min(_EXCERPT_SIDE / max(frame.height, frame.width), 1.0)
        height, width = (2 * max(round(side * scale / 2), 1) for side in (frame.height, frame.width))
        before = in_srgb(frame, width, height)
        pixels = PixelFormat.of_array(before)
        inside = clip.picture and clip.picture.scaled(height / frame.height, width / frame.width)
        warper = Warper(replace(clip, height=height, width=width, pixels=pixels, side_data={}, picture=inside), undo)
        small = replace(moving, frame=ArrayFrame(before, frame.time or 0.0))
        (after,) = pixels.arrays(warper.rectified(small).picture)
        yield np.concatenate([upright(each, frame) for each in (before, after)], axis=1)
        steps.advance()


def _write(file: Path, pairs: Iterator[UInt8[np.ndarray, "height width 3"]], interval_s: float) -> None:
    # a sixth of the work of VP8's fastest setting; keyframes are frequent enough for scrubbing; constant quality at any
    # bit rate, since at a fixed one VP9's fastest setting shows blocks
    settings = {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "g": "15", "crf": "22", "b": "0"}
    with av().open(str(file), "w", format="webm") as container:
        encode_pairs(container, pairs, interval_s, "libvpx-vp9", settings)
