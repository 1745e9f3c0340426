"""Rectifies a whole clip: checks it, determines its readout time, rectifies its frames and writes the output file.

The steps of the frames are generators that run ahead of one another in threads. Packets of the clip's other streams
wait until the frames next to them are written.

    VideoFrame -> MovingFrame -> (LinkedFrame ->) NewFrame
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.export import check_plot
from unshutter.frames.frame_motion import SHARES
from unshutter.motion import RowMotion
from unshutter.motion.opencv_threads import no_opencv_threads
from unshutter.motion.warp import thread_count
from unshutter.options.clip_options import RectifyClip
from unshutter.progress import Watch
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.storage.files import JsonLog, check_motion_name, check_target, remove_leftovers, written_whole
from unshutter.storage.locations import RunFiles, place
from unshutter.video import cameras, film_file, mp4
from unshutter.video.camera import Camera, find_camera
from unshutter.video.clip import ClipFacts, ClipRequest, look
from unshutter.video.clip_gyro import ClipGyro, level_turns
from unshutter.video.decode import DECODED_AHEAD, ahead, decode, frames_of
from unshutter.video.encoders import Encoder
from unshutter.video.film_file import FilmWriter, RateCallback, fitted, holds_covers, start_of, writing
from unshutter.video.frame_map import StraightView
from unshutter.video.frame_warper import (
    ROWS,
    LinkedFrame,
    MovingFrame,
    NewFrame,
    Warper,
    common_window,
    linked,
    side_by_side,
    with_motion,
)
from unshutter.video.gain import gain_of_clip, is_tested
from unshutter.video.gyro_fit import up_directions
from unshutter.video.outcome import ClipMotion, ClipOutcome, MotionWriter, load
from unshutter.video.readout import too_little_to_see
from unshutter.video.stabilisation import CameraPath, Stabilisation, stabilised
from unshutter.video.survey import Survey, survey

if TYPE_CHECKING:
    from av import VideoFrame

_MP4 = {".mp4", ".mov", ".m4v", ".3gp", ".3g2"}

ReadoutCallback: TypeAlias = Callable[[ReadoutTime, float], None]  # receives the time and the frame interval [s]


@no_opencv_threads()  # the pipeline has its own
def rectify_clip_file(
    source: str,
    output: str,
    options: RectifyClip,
    found: Camera | None = None,
    watch: Watch | None = None,
    on_readout: ReadoutCallback | None = None,
    on_rate: RateCallback | None = None,
) -> ClipOutcome:
    """Writes a clip without its rolling-shutter distortion. Prints nothing.

    Args:
        found: what is known of the camera from an earlier look; its readout time is ignored if the options state it.
        watch: called for every frame.
        on_readout: called once the readout time is found, which may be long before the clip is done.
        on_rate: called early if the new film will be much larger or smaller than the clip (see ``FilmWriter``).
    """
    path, target, log, after_killed_run = _checked_files(source, output, options)
    clip = look(path, options.max_pixels, until_s=options.end)
    _check_clip(clip, options)
    film = _Output.of(clip, options, target)
    pipeline = _pipeline(ClipRequest.of(clip, options, watch), found, on_readout)
    result = ClipOutcome(source, output, pipeline.time, clip.interval_s, options.undo.model)
    result.after_killed_run, result.gyro, result.lens = after_killed_run, pipeline.gyro, pipeline.request.lens
    height, width = pipeline.request.frame_size
    if result.lens is not None:
        result.lens_degrees = result.lens.degrees(width / height)
    if options.straight_lines:
        pipeline = replace(pipeline, straight=_straight_view(pipeline.request))
        result.straight_degrees = pipeline.straight and pipeline.straight.degrees(width / height)
    if options.steadiness.stabilize is not None:
        pipeline = with_steady_views(pipeline)
        result.stabilisation = pipeline.stabilisation
    if pipeline.stabilisation is not None and not pipeline.stabilisation.is_idle:
        film = replace(film, may_be_copy=False)
    if pipeline.unmoved is not None and film.may_be_copy:  # but damage is not copied
        frames = sum(1 for _ in _watched(pipeline)) if pipeline.frames is None else pipeline.frames
        result.add_unchanged(frames, pipeline.unmoved)
        _copy(pipeline, film, result)
    else:
        _write(pipeline, film, result, on_rate)
    if options.preview is not None and result.written:
        film_file.write_preview(options.preview, clip, str(target), options.start, result.frames, options.overwrite)
    if options.plot is not None:
        result.plot(options.plot, options.overwrite)
    if log is not None:
        log.add("clip", **result.as_json())
    return result


# ---- checks before any work -------------------------------------------------------------------------------


def _checked_files(source: str, output: str, options: RectifyClip) -> tuple[str, Path, JsonLog | None, bool]:
    """Checks that each output may be written, and that none of them is a file that the run reads.

    Returns:
        The clip's path and the result's; the log, if requested; and whether leftovers of an earlier, killed run were
        removed there.
    """
    path, target = _on_this_machine(source), Path(_on_this_machine(output))
    files = RunFiles(options, reads=[Path(path)])
    files.writes("--output", target)
    files.check(target)
    film_file.check_endings(target, options.preview)
    if options.plot is not None:
        check_plot(options.plot)
    if options.save_motion is not None:
        check_motion_name(options.save_motion.name)
    leftovers = False
    for each in filter(None, (target, options.save_motion, options.preview, options.plot)):
        check_target(each, options.overwrite)
        leftovers |= bool(remove_leftovers(each.parent)) and each is target
    return path, target, JsonLog(options.json_log) if options.json_log is not None else None, leftovers


def _check_clip(clip: ClipFacts, options: RectifyClip) -> None:
    """Checks that a clip is whole, and that it and the table of cameras have what the options need."""
    end_s = clip.expected.end_s
    if options.start is not None and end_s is not None and options.start >= end_s:
        raise UnshutterError(f"{{clip}} ends at {end_s:.1f} s: {{--start}} must come before that", clip=clip.path)
    if options.shutter.camera is not None:
        cameras.listed(options.shutter.camera)  # even if the clip has a readout time of its own
    clip.check_whole()


def _on_this_machine(source: str) -> str:
    """Returns a name that FFmpeg cannot misread: it interprets ``concat:a|b``, ``subfile,...:a`` and URLs."""
    file = place(source)
    if not isinstance(file, Path):
        raise UnshutterError(f"{source} is a URL: clips must be files on this machine")
    return os.path.abspath(file) if ":" in str(file) else str(file)


# ---- the steps for a clip ---------------------------------------------------------------------------------


def _pipeline(request: ClipRequest, found: Camera | None, on_readout: ReadoutCallback | None) -> Pipeline:
    """Returns the steps for a clip, with readout time and direction from the motion file, the options or the clip."""
    clip, options = request.clip, request.options
    if options.motion is not None:
        motion = load(options.motion)
        if (motion.height, motion.width) != (clip.height, clip.width):
            raise UnshutterError(
                f"the motion file is for frames of {motion.width}x{motion.height} px, the clip has "
                f"{clip.width}x{clip.height}: it belongs to another clip"
            )
        time = ReadoutTime(motion.ratio * clip.interval_s, source=ReadoutSource.MOTION_FILE)
        return Pipeline(replace(request, readout=motion.readout, lens=motion.lens), time, motion)
    camera, evidence = find_camera(request, found)
    request = replace(request, lens=camera.lens)
    pipeline = Pipeline(request, camera.readout, gyro=camera.gyro)
    reason = _reason_to_leave(request, camera, evidence)
    by_frames = reason is not None and camera.readout.declined is None
    if by_frames and not evidence.is_whole:  # now all frames are asked
        evidence = survey(request, [(options.start, options.end)], request.steps("looking")).through(camera.lens)
        reason = _reason_to_leave(request, camera, evidence)
    searched = found is None and camera.readout.source is not ReadoutSource.GIVEN
    is_used = camera.readout.declined is None and (reason is None or reason.code is not Code.NOTHING_TO_SEE)
    if searched and is_used and on_readout is not None:
        on_readout(camera.readout, clip.interval_s)
    return replace(pipeline, unmoved=reason, frames=len(evidence.parts[0]) if evidence.is_whole else None)


def _reason_to_leave(request: ClipRequest, camera: Camera, evidence: Survey) -> Reason | None:
    """Returns why a clip is to be left unchanged, as its tracked frames show; None if it is to be straightened."""
    time, options = camera.readout, request.options
    if time.declined is not None:
        return time.declined
    if time.plausible_s is not None and options.steadiness.stabilize is None:
        visibility = too_little_to_see(request, evidence, time.longest_s)
        if visibility is not None:
            return Reason.of(Code.NOTHING_TO_SEE, px=max(round(visibility.largest_px, 1), 0.1))
    if time.source is ReadoutSource.GIVEN or not is_tested(options):
        return None
    return gain_of_clip(request, time, camera.gyro and camera.gyro.turns, evidence).declined()


def _straight_view(request: ClipRequest) -> StraightView:
    """Returns the view in which lines are straight; raises UnshutterError if the lens is unknown."""
    if request.lens is None:
        raise UnshutterError(
            "{clip} shows no lens that bends lines, and none is known for its camera: name one with {--lens}",
            clip=request.clip.path,
        )
    height, width = request.frame_size
    return StraightView.of(request.lens, request.readout, width / height)


def with_steady_views(pipeline: Pipeline) -> Pipeline:
    """Returns the steps for stabilising a clip, after a first pass that determines the camera's path."""
    request, options = pipeline.request, pipeline.request.options
    turns = level_turns(pipeline.gyro) if options.steadiness.level else None
    undo = options.undo if pipeline.unmoved is None else replace(options.undo, strength=0.0)
    height, width = request.frame_size
    path = CameraPath(undo, request.readout, width / height, request.lens)
    for moving in _watched(replace(pipeline, unmoved=None)):
        path.add(moving.motion, moving.step, moving.cut, moving.frame.time or 0.0)
    if pipeline.file_motion is not None and not any(path.middle_steps):
        raise UnshutterError(
            f"{options.motion} is from an earlier version and lacks the turns between frames: "
            "save it again with {--save-motion}"
        )
    up = turns and up_directions(turns, np.array(path.times_s), SHARES[options.undo.reference])
    steady = stabilised(path, options.steadiness, request.clip.interval_s, up)
    return replace(pipeline, stabilisation=steady, frames=len(path))


def _watched(pipeline: Pipeline) -> Generator[MovingFrame]:
    """Yields the frames with their motion, reporting progress for each: a pass before that which writes the film."""
    steps, options = pipeline.request.steps("looking"), pipeline.request.options
    decoded = frames_of(pipeline.request.clip, options.start, options.end)
    with closing(pipeline.moving(decoded)) as frames:
        for moving in frames:
            steps.advance()
            yield moving


_LINKED_AHEAD = 1  # frames, all held in memory
_MOVING_AHEAD = 8  # frames, if they are small


@dataclass(frozen=True)
class Pipeline:
    """The processing steps of a clip's frames."""

    request: ClipRequest
    time: ReadoutTime
    file_motion: ClipMotion | None = None  # motion from a file; None to estimate it from the frames
    unmoved: Reason | None = None  # why no frame is changed; None if frames are rectified
    frames: int | None = None  # number of frames, if all were examined to find that none is to be changed
    gyro: ClipGyro | None = None  # the clip's gyro log; None if it has none
    # the frames' views and motion from a first pass; None if the camera's path is left unchanged
    stabilisation: Stabilisation | None = None
    straight: StraightView | None = None  # the view in which lines are straight; None if the lens is kept

    def moving(self, frames: Iterator[VideoFrame]) -> Generator[MovingFrame]:
        """Yields frames with their motion."""
        clip, options = self.request.clip, self.request.options
        if self.straight is not None:
            return self._straightened(replace(self, straight=None).moving(frames))
        decoded = ahead(frames, clip.most_ahead(DECODED_AHEAD))
        if self.stabilisation is not None or self.unmoved is not None or self.file_motion is not None:
            return self._with_known_motion(decoded)
        whole_path = options.steadiness.stabilize is not None or options.save_motion is not None
        moving = with_motion(self.request, decoded, self.time, self.gyro and self.gyro.turns, whole_path)
        return ahead(moving, clip.most_ahead(_MOVING_AHEAD))  # as the next are analysed

    def _straightened(self, frames: Generator[MovingFrame]) -> Generator[MovingFrame]:
        with closing(frames):
            for moving in frames:
                yield replace(moving, view=self.straight)

    def _with_known_motion(self, frames: Generator[VideoFrame]) -> Generator[MovingFrame]:
        unchanged = None if self.unmoved is None else RowMotion.zero(ROWS, ROWS, reason=self.unmoved)
        with closing(frames):
            for number, frame in enumerate(frames):
                if self.stabilisation is not None:
                    path, view = self.stabilisation.path, self.stabilisation.view(number)
                    motion = unchanged or path.motion(number)
                    yield MovingFrame(frame, motion, path.cuts[number], step=path.middle_steps[number], view=view)
                elif unchanged is not None:
                    yield MovingFrame(frame, unchanged)
                elif self.file_motion is not None:
                    motion, cut, step = self.file_motion.at(frame.time or 0.0)
                    yield MovingFrame(frame, motion, cut, step=step)

    def rectified(self, warper: Warper, frames: Iterator[VideoFrame]) -> Generator[NewFrame]:
        """Yields the frames to encode."""
        request, undo = self.request, self.request.options.undo
        moving: Generator[MovingFrame | LinkedFrame] = self.moving(frames)
        if undo.model == "dense" and undo.strength and self.unmoved is None:
            moving = ahead(linked(request, moving, self.time.ratio(request.clip.interval_s).value), _LINKED_AHEAD)
        return side_by_side(warper, moving, thread_count())


# ---- output ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Output:
    """The new film."""

    target: Path
    encoder: Encoder
    into_copy: bool  # whether the new frames replace those in a copy of the clip's file
    kind: str  # file ending of the film that FFmpeg writes
    may_be_copy: bool  # whether the clip's file can be copied if no frame changes: nothing else is to be written

    @classmethod
    def of(cls, clip: ClipFacts, options: RectifyClip, target: Path) -> _Output:
        kind = target.suffix.lower()
        alike = options.start is None and options.end is None and kind == Path(clip.path).suffix.lower()
        into_copy = alike and kind in _MP4 and clip.can_take_film
        if into_copy and kind != ".mov":
            kind = ".mp4"
        simple = alike and options.may_be_copy
        return cls(target, fitted(Encoder.choose(clip, options.encode), clip, kind), into_copy, kind, simple)


class _NothingChangedError(Exception):
    """No frame changes: the clip's own file is as good, or the user wants no output in that case."""


def _copy(pipeline: Pipeline, film: _Output, result: ClipOutcome) -> None:
    """Copies the clip, in which nothing changes, unless the user wants no output in that case."""
    options = pipeline.request.options
    result.written = not options.only_changed
    if result.written:
        with written_whole(film.target, options.overwrite) as part:
            shutil.copyfile(pipeline.request.clip.path, part)


def _write(pipeline: Pipeline, film: _Output, result: ClipOutcome, on_rate: RateCallback | None) -> None:
    """Writes the film, or copies the clip if nothing changes and the user wants nothing else of it."""
    warper = Warper(pipeline.request.clip, pipeline.request.options.undo)
    if warper.undo.edges == "crop":
        with closing(_watched(pipeline)) as frames:
            warper = replace(warper, window=common_window(warper, frames))
    try:
        _write_film(pipeline, warper, film, result, on_rate)
    except _NothingChangedError:
        _copy(pipeline, film, result)


def _write_film(
    pipeline: Pipeline, warper: Warper, film: _Output, result: ClipOutcome, on_rate: RateCallback | None
) -> None:
    clip, options, target = pipeline.request.clip, pipeline.request.options, film.target
    with ExitStack() as stack:
        part, motions = stack.enter_context(written_whole(target, options.overwrite)), None
        if options.save_motion is not None:
            motion_part = stack.enter_context(written_whole(options.save_motion, options.overwrite))
            stream = stack.enter_context(motion_part.open("w", encoding="utf-8"))
            motions = MotionWriter(stream, pipeline.request, pipeline.time)
        source, frames_file = stack.enter_context(clip.opened()), None
        if film.into_copy or holds_covers(film.kind, clip):
            frames_file = stack.enter_context(tempfile.TemporaryFile(dir=target.parent))
        container = stack.enter_context(writing(frames_file or part, film.kind, clip.ticks))
        ending, start_s = (None, 0.0) if film.into_copy else (film.kind, start_of(clip, film.kind))
        start_s = start_s if options.start is None else max(start_s, options.start)
        writer = FilmWriter(container, source, clip, film.encoder, ending, warper.size, start_s, on_rate)
        decoded = decode(source, clip, options.start, options.end, None if film.into_copy else writer.waiting)
        frames = stack.enter_context(closing(pipeline.rectified(warper, decoded)))
        _write_frames(pipeline.request, frames, result, motions, writer)
        if not result.rectified and pipeline.straight is None and (options.only_changed or film.may_be_copy):
            raise _NothingChangedError
        result.left_out = writer.left_out
        if frames_file is not None:
            with part.open("r+b") as out:
                if film.into_copy:
                    mp4.write_with_film(source.stream, frames_file, out)
                else:
                    mp4.write_with_covers(frames_file, writer.covers, out)


def _write_frames(
    request: ClipRequest,
    frames: Iterable[NewFrame],
    result: ClipOutcome,
    motions: MotionWriter | None,
    writer: FilmWriter,
) -> None:
    """Writes the frames to the film, and their motion; counts each frame in the outcome."""
    steps = request.steps("frames")
    for frame in frames:
        result.add(frame.source)
        if motions is not None:
            motions.add(frame.source)
        steps.advance()
        writer.add_frame(frame.picture)
    if not result.frames:
        raise UnshutterError("{clip} has no frames in this part", clip=request.clip.path)
    writer.end()
    if motions is not None:
        motions.end()
