"""Rectifies a whole clip: reads its facts, calibrates, decides, renders its frames and writes the output file.

Frames are rendered ahead of being written. Packets of the clip's other streams wait until the frames next to them are
written.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

from unshutter.errors import UnshutterError
from unshutter.export import check_plot
from unshutter.inventory import Fate, Part
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.opencv_threads import no_opencv_threads
from unshutter.options.clip_options import RectifyClip
from unshutter.progress import SILENT, ClipObserver
from unshutter.storage.files import (
    JsonLog,
    check_gyro_name,
    check_motion_name,
    check_target,
    remove_leftovers,
    written_whole,
)
from unshutter.storage.locations import RunFiles
from unshutter.storage.objects import local_file
from unshutter.video.calibrate import cameras
from unshutter.video.calibrate.camera import ClipCamera
from unshutter.video.decision import NO_FRAMES, Decision, Leave, RectifyFrames, calibrate_and_decide, why_unfit
from unshutter.video.file import clip_inventory, matroska, mp4_inventory, mp4_writer, previews
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import ClipFacts, read_clip_facts
from unshutter.video.file.containers import VideoFile
from unshutter.video.file.encoders import Encoder, light_boxes, light_elements
from unshutter.video.file.motion_file import MotionWriter
from unshutter.video.file.mp4 import Movie
from unshutter.video.file.pixels import of_file
from unshutter.video.file.stages import Stage
from unshutter.video.file.video_writer import VideoWriter, check_endings, fitted, is_completed, start_of, writing
from unshutter.video.outcome import ClipOutcome, ClipPlan, Tally
from unshutter.video.render.frame_warper import NewFrame, Warper, common_window
from unshutter.video.render.rendering import (
    Rendering,
    expected,
    path_of,
    straight_view,
    watched,
    with_known_motion,
    with_views,
)
from unshutter.video.render.virtual_gyro import VirtualGyro, write_virtual_gyro

_SMALLER_PX = 8
_TRIED_S = 1.0  # s of a clip by which it is foreseen what becomes of its parts
_MP4 = {".mp4", ".mov", ".m4v", ".3gp", ".3g2"}
_MATROSKA = (".mkv", ".webm")


@no_opencv_threads()  # the steps of a clip have their own
def rectify_clip_file(
    source: str,
    output: str,
    options: RectifyClip,
    observer: ClipObserver = SILENT,
    decided: Callable[[ClipRequest], tuple[ClipRequest, ClipCamera, Decision]] = calibrate_and_decide,
) -> ClipOutcome:
    """Writes a clip without its rolling-shutter distortion. Prints nothing.

    Args:
        observer: receives the progress of the work.
        decided: makes the decision, or knows the one that was made before.
    """
    path, target, outputs = _checked_files(source, output, options)
    cleaned = [each for each in outputs if remove_leftovers(each.parent)]
    log = JsonLog(options.json_log) if options.json_log is not None else None
    request, video = _request(path, target, options, observer)
    request, camera, decision = decided(request)
    clip = video.clip
    request.work.expect(dict.fromkeys(Stage, 0) | expected(request, decision))
    straight = straight_view(request) if options.straight_lines else None
    rendering = with_views(Rendering(request, camera, decision, straight=straight))
    steady = rendering.stabilisation
    if steady is not None and not steady.is_idle:
        video = replace(video, may_be_copy=False)
    if isinstance(rendering.decision, Leave) and video.may_be_copy:
        written = _copy(rendering, video, rendering.decision)
    else:
        written = _write(rendering, video)
    tally = written.tally
    aspect = request.frame_size[1] / request.frame_size[0]
    outcome = ClipOutcome(
        source=source,
        output=output,
        readout_time=camera.readout_time,
        interval_s=clip.interval_s,
        clock=request.clip.clock,
        picture=None if clip.picture is None else clip.picture_size,
        model=options.undo.model,
        written=written.is_written,
        after_killed_run=target in cleaned,
        frames=tally.frames,
        rectified=tally.rectified,
        dense=tally.dense,
        reasons=tally.reasons,
        cuts_s=tally.cuts_s,
        parts=written.parts,
        rotations=tally.rotations,
        gyro=camera.gyro,
        stabilisation=steady,
        enlargement=rendering.enlargement,
        lens=request.lens,
        damaged=written.damaged,
        lens_degrees=None if request.lens is None else request.lens.degrees(aspect),
        straight_degrees=None if straight is None else straight.degrees(aspect),
        direction=camera.scan_direction,
        unfit=why_unfit(camera),
        virtual_gyro=_save_gyro(rendering),
    )
    if options.preview is not None and outcome.written:
        previews.write_preview(
            options.preview, clip, str(target), request.options.start, outcome.frames, options.overwrite
        )
    if options.plot is not None:
        outcome.plot(options.plot, options.overwrite)
    request.work.finish()
    if log is not None:
        log.add("clip", **outcome.as_json())
    return outcome


@no_opencv_threads()
def plan_clip_file(source: str, output: str, options: RectifyClip, observer: ClipObserver = SILENT) -> ClipPlan:
    """Returns what ``rectify_clip_file`` would do. Writes nothing but temporary files: the clip's first second."""
    path, target, _ = _checked_files(source, output, options)
    request, video = _request(path, target, options, observer)
    request, _, decision = calibrate_and_decide(request)
    if options.straight_lines:
        straight_view(request)  # it refuses a clip whose lens is unknown
    reason = decision.reason if isinstance(decision, Leave) else None
    is_left = reason is not None and options.steadiness.stabilize is None and not options.straight_lines
    if is_left and (video.may_be_copy or options.only_changed):
        plan = ClipPlan(source, output, reason, Fate.LEFT_OUT if options.only_changed else Fate.CARRIED)
    else:
        is_cut = reason is None and EdgePolicy(options.undo.edges).must_crop
        plan = ClipPlan(source, output, reason, Fate.TRANSFORMED, _tried(request, video, is_cut))
    request.work.finish()
    return plan


# ---- checks before any work -------------------------------------------------------------------------------


def _checked_files(source: str, output: str, options: RectifyClip) -> tuple[str, Path, list[Path]]:
    """Checks that each output may be written, and that none of them is a file that the run reads.

    Returns:
        The clip's path, the result's, and those of all outputs.
    """
    path = _on_this_machine(source)
    target = Path(_on_this_machine(output))
    files = RunFiles(options, reads=[Path(path)])
    files.writes("--output", target)
    files.check(target)
    check_endings(target, options.preview)
    if options.plot is not None:
        check_plot(options.plot)
    if options.save_motion is not None:
        check_motion_name(options.save_motion.name)
    if options.save_gyro is not None:
        check_gyro_name(options.save_gyro.name)
    outputs = list(filter(None, (target, options.save_motion, options.save_gyro, options.preview, options.plot)))
    for each in outputs:
        check_target(each, options.overwrite)
    return path, target, outputs


def _request(path: str, target: Path, options: RectifyClip, observer: ClipObserver) -> tuple[ClipRequest, _Output]:
    """Reads a clip's facts and checks them; returns the request and the video to be written."""
    clip = read_clip_facts(path, options.max_pixels, options.end, options.progressive)
    _check_clip(clip, options)
    request = ClipRequest.of(clip, options, observer)
    video = _Output.of(clip, options, target)
    request.work.expect(expected(request, RectifyFrames()))
    return request, video


def _check_clip(clip: ClipFacts, options: RectifyClip) -> None:
    """Checks that a clip is whole, and that it and the table of cameras have what the options need."""
    end_s = clip.expected.end_s
    if options.start is not None and end_s is not None and options.start >= end_s - clip.begin_s:
        raise UnshutterError(
            f"{{clip}} ends at {end_s - clip.begin_s:.1f} s: {{--start}} must come before that", clip=clip.path
        )
    if options.shutter.camera is not None:
        cameras.listed(options.shutter.camera)  # even if the clip has a readout time of its own
    clip.check_whole()


def _on_this_machine(source: str) -> str:
    """Returns a name that FFmpeg cannot misread: it interprets ``concat:a|b``, ``subfile,...:a`` and URLs."""
    file = local_file(source)
    if file is None:
        raise UnshutterError(f"{source} is a URL: clips must be files on this machine")
    return os.path.abspath(file) if ":" in str(file) else str(file)


# ---- output ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Output:
    """The new video."""

    clip: ClipFacts
    target: Path
    encoder: Encoder
    into_copy: bool  # whether the new frames replace those in a copy of the clip's file
    kind: str  # file ending of the video that FFmpeg writes
    # whether no frame is encoded if none changes: the clip's file can be copied, or nothing is to be written then
    may_be_copy: bool

    @classmethod
    def of(cls, clip: ClipFacts, options: RectifyClip, target: Path) -> _Output:
        kind = target.suffix.lower()
        is_whole = options.start is None and options.end is None
        alike = is_whole and kind == Path(clip.path).suffix.lower()
        into_copy = alike and kind in _MP4 and clip.can_take_video
        encoder = Encoder.choose(clip, options.encode)
        simple = is_whole and options.only_changed and not options.straight_lines
        simple = simple or (alike and options.may_be_copy)
        if into_copy and kind != ".mov":
            with suppress(UnshutterError):  # MP4 takes most codecs; H.263 needs a file of the clip's own kind
                return cls(clip, target, fitted(encoder, clip, ".mp4"), into_copy, ".mp4", simple)
        return cls(clip, target, fitted(encoder, clip, kind), into_copy, kind, simple)

    def writer(self, container: Any, source: VideoFile, request: ClipRequest, size: tuple[int, int]) -> VideoWriter:
        """Returns the writer of frames of a size into an open container, and of the clip's other streams."""
        part_s = request.options.start, request.options.end
        ending, start_s = (None, 0.0) if self.into_copy else (self.kind, start_of(self.clip, self.kind))
        start_s = start_s if part_s[0] is None else max(start_s, part_s[0])
        return VideoWriter(container, source, self.clip, self.encoder, ending, size, start_s, part_s, request.work)

    def completed_by_ffmpeg(
        self, source: VideoFile, writer: VideoWriter, frames_file: BinaryIO | None, part: Path
    ) -> Iterator[Part]:
        """Completes a video that FFmpeg wrote; yields what became of the clip's tags, and what else it lacks."""
        if frames_file is not None:
            with part.open("r+b") as out:
                light = light_boxes(self.clip, self.encoder.name)
                mp4_writer.write_completed(frames_file, writer.covers, light, out)
        elif self.kind in _MATROSKA and (elements := light_elements(self.clip, self.encoder.name)):
            with part.open("r+b") as out:
                matroska.state_light(out, elements)
        if writer.has_dolby_vision:
            yield Part("configuration of Dolby Vision", Fate.LEFT_OUT, "some players ignore the metadata without it")
        yield from clip_inventory.parts(source, str(part), writer.carried, writer.is_part)


@dataclass(frozen=True)
class _Written:
    """What became of a clip's frames, and of the new video."""

    tally: Tally
    is_written: bool = True  # whether there is a new video
    parts: list[Part] = field(default_factory=list)  # what became of those of the clip's file; none if it was copied
    damaged: int = 0  # number of frames that cannot be decoded, and are missing


def _copy(rendering: Rendering, output: _Output, decision: Leave) -> _Written:
    """Copies a clip in which nothing changes, unless the user wants no output then; but damage is not copied."""
    request = rendering.request
    options = rendering.request.options
    request.work.expect(dict.fromkeys(Stage, 0))
    tally = Tally()
    with ExitStack() as stack:
        motions = None
        if options.save_motion is not None and not options.only_changed:
            motions = stack.enter_context(_writing_motions(rendering, options.save_motion))
        packets = request.clip.packets() if decision.frames is None else None
        frames = packets.frames if packets is not None else decision.frames
        if frames is None or motions is not None or options.plot is not None:
            for moving in watched(rendering):
                tally.add(moving)
                if motions is not None:
                    motions.add(*moving.record)
        else:
            tally.frames = frames
            tally.reasons[decision.reason] = frames
        if motions is not None:
            motions.end()
        if not options.only_changed:
            part = stack.enter_context(written_whole(output.target, options.overwrite))
            shutil.copyfile(request.clip.path, part)
    return _Written(tally, is_written=not options.only_changed)


def _write(rendering: Rendering, output: _Output) -> _Written:
    """Writes the video, or copies the clip if nothing changes and the user wants nothing else of it."""
    request = rendering.request
    options = rendering.request.options
    clip = output.clip
    warper = Warper(request.clip, options.undo)
    if EdgePolicy(options.undo.edges).must_crop:
        rendering = with_known_motion(rendering)
        warper = replace(warper, window=common_window(warper, rendering.known()))
    tally = Tally()

    def is_changed() -> bool:
        return tally.rectified > 0 or rendering.straight is not None

    def is_wanted() -> bool:
        return is_changed() or not options.only_changed

    with ExitStack() as stack:
        part = stack.enter_context(written_whole(output.target, options.overwrite, is_wanted=is_wanted))
        motions = None
        if options.save_motion is not None:
            motions = stack.enter_context(_writing_motions(rendering, options.save_motion, is_wanted))
        source = stack.enter_context(clip.opened())
        frames_file = None
        if output.into_copy or is_completed(output.kind, clip, output.encoder):
            frames_file = stack.enter_context(tempfile.TemporaryFile(dir=output.target.parent))
        container = stack.enter_context(writing(frames_file or part, output.kind, clip.ticks))
        writer = output.writer(container, source, request, warper.size)
        decoded = clip.decode(source, options.start, options.end, None if output.into_copy else writer.waiting)
        frames = stack.enter_context(closing(rendering.rectified(warper, decoded)))
        _write_frames(request, frames, tally, motions, writer)
        if not is_wanted():
            return _Written(tally, is_written=False)
        if not is_changed() and output.may_be_copy:
            shutil.copyfile(clip.path, part)
            return _Written(tally)
        if output.into_copy and frames_file is not None:
            corner = (0, 0) if warper.window is None else (warper.window.left, warper.window.top)
            with part.open("r+b") as out:
                is_dolby = writer.has_dolby_vision
                light = light_boxes(clip, output.encoder.name)
                mp4_writer.write_with_video(source.stream, source.video.id, frames_file, out, corner, is_dolby, light)
                others = [each.id for each in source.other_films]
                parts = mp4_inventory.audited(source.stream, out, source.video.id, others, is_dolby)
        else:
            parts = list(output.completed_by_ffmpeg(source, writer, frames_file, part))
        parts += clip_inventory.lost_of_frames(clip.side_data, read_clip_facts(str(part), options.max_pixels).side_data)
    return _Written(tally, parts=[*writer.parts, *parts], damaged=len(source.damaged_s))


def _save_gyro(rendering: Rendering) -> VirtualGyro | None:
    """Writes the virtual gyro log, also of a clip that is left; returns what became of it, None if none is wanted."""
    request, camera = rendering.request, rendering.camera
    file = request.options.save_gyro
    if file is None:
        return None
    is_left = isinstance(rendering.decision, Leave)
    reason = why_unfit(camera) or (camera.readout_time.instead_of if is_left else None)
    if reason is not None:
        return VirtualGyro(reason=reason)
    return write_virtual_gyro(file, path_of(rendering), request, camera.readout_time, request.options.overwrite)


def _tried(request: ClipRequest, output: _Output, is_cut: bool) -> list[Part]:
    """Returns what would become of the parts of a clip's file, by a video of its first second, whose frames stay.

    If they would be cut, they are made smaller instead: by how much is not known yet.
    """
    clip, options = output.clip, request.options
    smaller_px = _SMALLER_PX if is_cut else 0
    height, width = clip.height - smaller_px, clip.width - smaller_px
    end_s = _TRIED_S + (clip.begin_s if options.start is None else options.start)
    with ExitStack() as stack:
        part = Path(stack.enter_context(tempfile.TemporaryDirectory())) / f"tried{output.kind}"
        source = stack.enter_context(clip.opened())
        in_two_steps = is_completed(output.kind, clip, output.encoder) and not output.into_copy
        frames_file = stack.enter_context(tempfile.TemporaryFile()) if in_two_steps else None
        if in_two_steps:
            part.touch()
        container = stack.enter_context(writing(frames_file or part, output.kind, clip.ticks))
        writer = output.writer(container, source, request, (height, width))
        decoded = clip.decode(source, options.start, options.end, None if output.into_copy else writer.waiting)
        with closing(decoded):
            for frame in takewhile(lambda each: (each.time or 0.0) < end_s, decoded):
                writer.add_frame(frame.reformat(width, height) if smaller_px else frame)
        writer.end()
        if output.into_copy:
            movie = Movie.read(source.stream)
            others = [each.id for each in source.other_films]
            film = movie.track(source.video.id)
            parts = list(mp4_inventory.parts(movie, film, others, writer.has_dolby_vision))
        else:
            parts = list(output.completed_by_ffmpeg(source, writer, frames_file, part))
        parts += clip_inventory.lost_of_frames(clip.side_data, read_clip_facts(str(part), options.max_pixels).side_data)
    return [*writer.parts, *parts]


@contextmanager
def _writing_motions(
    rendering: Rendering, path: Path, is_wanted: Callable[[], bool] = lambda: True
) -> Iterator[MotionWriter]:
    request = rendering.request
    written = written_whole(path, request.options.overwrite, is_wanted=is_wanted)
    with written as part, part.open("w", encoding="utf-8") as stream:
        yield MotionWriter(stream, request, rendering.camera.readout_time)


def _write_frames(
    request: ClipRequest, frames: Iterable[NewFrame], tally: Tally, motions: MotionWriter | None, writer: VideoWriter
) -> None:
    """Writes the frames to the video, and their motion; counts each."""
    steps = request.steps("frames", Stage.DRAW)
    for frame in frames:
        tally.add(frame.source)
        if motions is not None:
            motions.add(*frame.source.record)
        steps.advance()
        writer.add_frame(of_file(frame.picture))
    if not tally.frames:
        raise UnshutterError(NO_FRAMES, clip=request.clip.path)
    writer.end()
    if motions is not None:
        motions.end()
