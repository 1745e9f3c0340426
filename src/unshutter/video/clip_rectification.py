"""Rectifies a whole clip: checks it, determines its readout time, rectifies its frames and writes the output file."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import cv2

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.geometry.readout import Readout
from unshutter.progress import Steps, Watch
from unshutter.reasons import Code, Reason
from unshutter.storage.files import written_whole
from unshutter.storage.new_folders import new_folder
from unshutter.video import mp4_movie, pictures
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.clip_gyro import ClipGyro, gyro_of_clip
from unshutter.video.clip_motion_file import ClipMotion, load, motion_written
from unshutter.video.clip_preview import write_preview
from unshutter.video.encoders import Encoder
from unshutter.video.film_file import FilmWriter, RateCallback, write_picture, writing
from unshutter.video.frame_warper import NewFrame, Warper, common_window
from unshutter.video.options import Encode, RectifyClip
from unshutter.video.outcome import ClipOutcome
from unshutter.video.output_checks import are_pictures, check_targets, on_this_machine
from unshutter.video.path_pass import watched, with_steady_views
from unshutter.video.pipeline import Pipeline
from unshutter.video.readout_choice import Visibility, readout_ratio_of_clip, too_little_to_see

_MP4 = {".mp4", ".mov", ".m4v", ".3gp", ".3g2"}

ReadoutCallback: TypeAlias = Callable[[ReadoutRatio, float], None]  # receives the ratio and the frame interval [s]


def rectify_clip_file(
    source: str,
    output: str,
    options: RectifyClip,
    ratio: ReadoutRatio | None = None,
    watch: Watch | None = None,
    on_readout: ReadoutCallback | None = None,
    on_rate: RateCallback | None = None,
) -> ClipOutcome:
    """Writes a clip without its rolling-shutter distortion. Prints nothing.

    Args:
        source: a film, a folder of pictures, or a pattern of their names.
        output: a file, or a folder or pattern for pictures.
        options: the user's options.
        ratio: the readout ratio, if already known; ignored if the options state it.
        watch: called for every frame.
        on_readout: called once the readout ratio is found, which may be long before the clip is done.
        on_rate: called early if the new film will be much larger or smaller than the clip (see ``FilmWriter``).

    Raises:
        UsageError: the options do not suit the clip.
        UnshutterError: the clip cannot be read, or the output cannot be written.
    """
    cv2.setNumThreads(1)  # the pipeline has its own threads
    path, target = on_this_machine(source), Path(on_this_machine(output))
    log, after_killed_run = check_targets(path, target, options)
    clip = Clip.look(path, options.fps, options.max_pixels)
    if options.fps is not None and not clip.of_pictures:
        raise UsageError("--fps is for sequences of pictures: a film says it itself")
    end_s = clip.expected.end_s
    if options.start is not None and end_s is not None and options.start >= end_s:
        raise UnshutterError(f"{{clip}} ends at {end_s:.1f} s: --start must come before that", clip=clip.path)
    clip.check_whole(options.start, options.end)
    encoder = Encoder.choose(clip, options.encode) if not are_pictures(target) else None
    pipeline, visibility, gyro = _pipeline(clip, options, ratio, watch, on_readout)
    outcome = ClipOutcome(source, output, pipeline.ratio, clip.interval_s, options.undo.model)
    outcome.after_killed_run, outcome.gyro = after_killed_run, gyro
    if options.steadiness.stabilize is not None:
        pipeline = with_steady_views(pipeline, gyro, watch)
        outcome.stabilisation = pipeline.stabilisation
    if visibility is not None and pipeline.unmoved is not None and _is_simple(clip, target, options):
        outcome.add_unchanged(visibility.frames, pipeline.unmoved)
        outcome.written = not options.only_changed
        if outcome.written:
            _copy(clip, target, options.overwrite)
    else:
        _write(pipeline, encoder, target, outcome, watch, on_rate)
    if options.preview is not None and outcome.written:
        write_preview(options.preview, clip, str(target), options.start or 0.0, outcome.frames, options.overwrite)
    if options.plot is not None:
        outcome.plot(options.plot, options.overwrite)
    if log is not None:
        log.add("clip", **outcome.as_json())
    return outcome


def _pipeline(
    clip: Clip,
    options: RectifyClip,
    ratio: ReadoutRatio | None,
    watch: Watch | None,
    on_readout: ReadoutCallback | None,
) -> tuple[Pipeline, Visibility | None, ClipGyro | None]:
    """Returns the steps for a clip, with readout ratio and direction from the motion file, the options or the clip.

    Returns:
        The steps; the bound on visible motion, if a clip of unknown readout time cannot show enough to change a frame;
        and the gyro log, if there is one.
    """
    if options.motion is not None:
        motion = load(options.motion)
        _check_size(motion, clip)
        return (
            Pipeline(clip, options, ReadoutRatio(motion.ratio, 0.0, "motion file"), motion.readout, motion),
            None,
            None,
        )
    readout, ratio_option = Readout.parse(options.shutter.readout), options.shutter.ratio(clip.interval_s)
    search = ratio_option is None and ratio is None
    if ratio_option is not None:
        ratio = ReadoutRatio(ratio_option, 0.0, "given")
    span = options.span(clip.duration_s)
    gyro = gyro_of_clip(clip, readout, options.shutter, span, None if ratio is None else ratio.value, watch)
    if ratio is None and gyro is not None:
        ratio = gyro.ratio
    if ratio is None:
        ratio = readout_ratio_of_clip(clip, readout, options.shutter, span, watch)
    gyro = None if gyro is None else gyro.with_ratio(ratio.value)
    pipeline = Pipeline(clip, options, ratio, readout, gyro=None if gyro is None else gyro.turns)
    if ratio.plausible is not None and options.steadiness.stabilize is None:
        visibility = too_little_to_see(clip, readout, options, ratio.plausible.highest, watch)
        if visibility is not None:
            reason = Reason.of(Code.NOTHING_TO_SEE, px=max(round(visibility.largest_px, 1), 0.1))
            return replace(pipeline, unmoved=reason), visibility, gyro
    if search and on_readout is not None:
        on_readout(ratio, clip.interval_s)
    return pipeline, None, gyro


def _check_size(motion: ClipMotion, clip: Clip) -> None:
    """Raises UnshutterError if a motion file belongs to frames of another size."""
    if (motion.height, motion.width) != (clip.height, clip.width):
        raise UnshutterError(
            f"the motion file is of frames of {motion.width}x{motion.height} px, the clip has "
            f"{clip.width}x{clip.height}: it is of another clip"
        )


# ---- output ---------------------------------------------------------------------------------------------


def _write(
    pipeline: Pipeline,
    encoder: Encoder | None,
    target: Path,
    outcome: ClipOutcome,
    watch: Watch | None,
    on_rate: RateCallback | None,
) -> None:
    """Writes the clip; as pictures if there is no encoder."""
    clip, options = pipeline.clip, pipeline.options
    warper = Warper(clip, options.undo)
    if options.undo.edges == "crop":
        with closing(pipeline.moving()) as items:
            warper = Warper(clip, options.undo, common_window(warper, watched(items, clip, options, watch)))
    try:
        if encoder is None:
            _write_pictures(pipeline, warper, target, outcome, watch)
        else:
            _write_film(pipeline, warper, encoder, target, outcome, watch, on_rate)
    except _NothingChangedError:
        outcome.written = False


class _NothingChangedError(Exception):
    """No frame changes, and the user wants no output in that case."""


def _copy(clip: Clip, target: Path, overwrite: bool) -> None:
    """Copies the clip's file unchanged."""
    with written_whole(target, overwrite) as part:
        shutil.copyfile(clip.path, part)


def _is_simple(clip: Clip, target: Path, options: RectifyClip) -> bool:
    """Whether a clip without changed frames can be copied as a file, with no motion to write or plot."""
    whole = options.start is None and options.end is None
    same_kind = not clip.of_pictures and target.suffix.lower() == Path(clip.path).suffix.lower()
    return whole and same_kind and options.encode == Encode() and options.save_motion is options.plot is None


def _write_film(
    pipeline: Pipeline,
    warper: Warper,
    encoder: Encoder,
    target: Path,
    outcome: ClipOutcome,
    watch: Watch | None,
    on_rate: RateCallback | None,
) -> None:
    """Writes a film; its frames replace those in a copy of the clip's file if the format allows it."""
    clip, options = pipeline.clip, pipeline.options
    whole = options.start is None and options.end is None
    into_copy = whole and _same_family(clip.path, target) and mp4_movie.can_take(clip.path)
    with ExitStack() as stack:
        part = stack.enter_context(written_whole(target, options.overwrite))
        source = stack.enter_context(clip.opened())
        frames = stack.enter_context(tempfile.TemporaryFile(dir=target.parent)) if into_copy else None
        container = stack.enter_context(writing(part if frames is None else frames, target.suffix, clip.ticks))
        items = stack.enter_context(_counted(pipeline, warper, outcome, watch, all_streams=not into_copy))
        film = FilmWriter(container, source, clip, encoder, not into_copy, warper.size, options.start or 0.0, on_rate)
        for item in items:
            if isinstance(item, SidePacket):
                film.add_packet(item.packet)
            else:
                film.add_frame(item.picture)
        film.end()
        if options.only_changed and not outcome.rectified:
            raise _NothingChangedError
        outcome.left_out = film.left_out
        if frames is not None:
            with open(clip.path, "rb") as original, part.open("r+b") as out:
                mp4_movie.write_with_film(original, frames, out)


def _write_pictures(
    pipeline: Pipeline, warper: Warper, target: Path, outcome: ClipOutcome, watch: Watch | None
) -> None:
    """Writes pictures into a new folder, which is given its name once all of them are written."""
    folder, name = pictures.folder_and_name(target, pipeline.clip.pictures)
    with new_folder(folder) as part, _counted(pipeline, warper, outcome, watch) as items:
        for number, item in enumerate(items, 1):
            assert isinstance(item, NewFrame)  # no other streams were requested
            write_picture(item.picture, part / (name % number))
        if pipeline.options.only_changed and not outcome.rectified:
            raise _NothingChangedError


@contextmanager
def _counted(
    pipeline: Pipeline, warper: Warper, outcome: ClipOutcome, watch: Watch | None, all_streams: bool = False
) -> Iterator[Iterator[NewFrame | SidePacket]]:
    """Yields the rectified frames and packets, counting each frame in the outcome and writing its motion.

    Raises:
        UnshutterError: there are no frames, or the motion file cannot be written.
    """
    clip, options = pipeline.clip, pipeline.options
    steps = Steps("frames", clip.expected_frames(options.start, options.end), watch)

    def counted() -> Iterator[NewFrame | SidePacket]:
        for item in items:
            if isinstance(item, NewFrame):
                outcome.add(item.source)
                if motions is not None:
                    motions.add(item.source)
                steps.advance()
            yield item
        if not outcome.frames:
            raise UnshutterError("{clip} has no frames there", clip=clip.path)

    with (
        motion_written(options.save_motion, options.overwrite, clip, pipeline.ratio, pipeline.readout) as motions,
        closing(pipeline.rectified(warper, all_streams)) as items,
    ):
        yield counted()


def _same_family(source: str, target: Path) -> bool:
    return Path(source).suffix.lower() in _MP4 and target.suffix.lower() == Path(source).suffix.lower()
