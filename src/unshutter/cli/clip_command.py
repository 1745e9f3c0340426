"""``unshutter video`` rectifies a clip, and ``unshutter measure`` measures the readout time of clips."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.cli.arguments import Command
from unshutter.cli.pipes import Pipes
from unshutter.errors import UsageError, visible
from unshutter.inventory import Fate, describe
from unshutter.options import option
from unshutter.options.clip_options import JOIN, Encode, MeasureClips, RectifyClip
from unshutter.options.fields import positional
from unshutter.options.picture_formats import SUFFIXES
from unshutter.progress import Bar, ClipObserver, clock, tell
from unshutter.reasons import Code
from unshutter.run.inputs import video_name
from unshutter.version import extra

if TYPE_CHECKING:
    from unshutter.readout_time import ReadoutTime
    from unshutter.video.calibrate.clip_gyro import ClipGyro
    from unshutter.video.file.camera_clock import CameraClock
    from unshutter.video.measurement import ClipMeasurement
    from unshutter.video.outcome import ClipOutcome
    from unshutter.video.render.enlargement import Enlargement
    from unshutter.video.render.stabilisation import Stabilisation


@dataclass(frozen=True)
class Video:
    """Arguments of ``unshutter video``."""

    clip: str = positional("A video (.mp4, .mov, .mkv ...); - is standard input.", "input", pipe=True)
    output: str | None = option(
        None,
        "File or folder to write; - is standard output, as Matroska. Default: NAME.rectified.EXT next to the clip.",
        short="-o",
        metavar="PATH",
        names="results",
        pipe=True,
    )
    options: RectifyClip = field(default_factory=RectifyClip)
    dry_run: bool = option(
        False, "List what would be done, and what would become of each part of the clip's file, without writing it."
    )


def _video(arguments: Video) -> int:
    """Rectifies the clip; returns the exit code."""
    if Path(arguments.clip).suffix.lower() in SUFFIXES:
        raise UsageError(f"{arguments.clip} is a photo, not a clip: unshutter rectify {arguments.clip}; {JOIN}")
    with Pipes(arguments.clip, arguments.output, "a clip") as pipes:
        if pipes.is_read:
            arguments = replace(arguments, clip=str(pipes.keep_clip(arguments.output)))
        if arguments.dry_run:
            if pipes.is_written:
                raise UsageError("{--dry-run} lists what would be written: leave out - or {--dry-run}")
            _list(*_settled(arguments))
            return 0
        if not pipes.is_written:
            _report(_rectify(arguments), arguments.options.preview)
            return 0
        video = pipes.name_video(Path(arguments.clip))
        options = arguments.options
        passes_on = options.may_be_copy and not options.only_changed  # a clip that does not change, byte for byte
        if passes_on:
            options = replace(options, only_changed=True)
        outcome = _rectify(replace(arguments, output=str(video), options=options))
        if not outcome.written:
            video = Path(arguments.clip)
        if outcome.written or passes_on:
            pipes.send(video)
        _report(replace(outcome, written=outcome.written or passes_on), options.preview if outcome.written else None)
    return 0


def _settled(arguments: Video) -> tuple[str, str, RectifyClip]:
    """Returns the clip, the file to write, and the options."""
    options = arguments.options
    if arguments.output is None and options.may_be_copy:  # next to the clip, nothing is written for one that stays
        options = replace(options, only_changed=True)
    clip = Path(arguments.clip)
    output = arguments.output
    if output is None or Path(output).is_dir():
        output = str(Path(output or clip.parent) / video_name(clip))
    return arguments.clip, output, options


def _rectify(arguments: Video) -> ClipOutcome:
    """Rectifies the clip."""
    from unshutter.video.clip_rectification import rectify_clip_file

    settled = _settled(arguments)
    with _Terminal(arguments.options.encode) as terminal:
        return rectify_clip_file(*settled, observer=terminal)


def _list(clip: str, output: str, options: RectifyClip) -> None:
    """Lists what would be done with the clip, and with each part of its file."""
    from unshutter.video.clip_rectification import plan_clip_file

    with _Terminal(options.encode) as terminal:
        plan = plan_clip_file(clip, output, options, observer=terminal)
    ways = {Fate.CARRIED: "copied", Fate.LEFT_OUT: "nothing to write", Fate.TRANSFORMED: "no frame straightened"}
    target = "" if plan.fate is Fate.LEFT_OUT else f" -> {output}"
    print(visible(f"{clip}{target}{'' if plan.reason is None else f' ({ways[plan.fate]}: {plan.reason})'}"))
    for line in dict.fromkeys(f"  {part.fate}: {part}" for part in plan.parts):
        print(visible(line))
    tell("unshutter: nothing was written")


def _report(outcome: ClipOutcome, preview: Path | None) -> None:
    """Reports what came of the clip, and the preview that was asked for."""
    for line in _lines_of(outcome):
        tell(line)
    if preview is not None and outcome.written:
        tell(f"before and after: {preview}")


@dataclass
class _Terminal(Bar, ClipObserver):
    """Shows how the work goes on, by a bar that starts with its first step."""

    encode: Encode

    def note_progress(self, what: str, done: int, total: int) -> None:
        self._show(description=f"{what} {done}/{max(done, total)}")

    def note_share(self, share: float, left_s: float | None) -> None:
        self._show(completed=share, said="" if left_s is None else clock(left_s))

    def _show(self, **shown: Any) -> None:
        if self._bar is None:
            self._start("", 1.0, "{task.percentage:>3.0f}%", "{task.fields[said]}")
        if self._bar is not None:
            self._bar.update(self._task, **shown)

    def note_readout(self, time: ReadoutTime, interval_s: float) -> None:
        self.tell(_line_of(time))

    def note_rate(self, before: float, after: float) -> None:
        self.tell(_rate_line(before, after, self.encode))


def _line_of(time: ReadoutTime) -> str:
    """Describes the readout time and its source, in a form that can be reused as an option."""
    ms = time.ms
    if time.plausible_ms is not None:
        low, high = (f"{each:.1f}" for each in time.plausible_ms)
        span = "" if low == high else f" (anything from {low} to {high} ms)"
        usual = f"taking {ms:.1f} ms, typical of {time.camera}{span}"
        return f"unshutter: {time.instead_of}: {usual}; to set it: --readout-ms"
    if time.source.is_measured:
        return f"unshutter: readout time {ms:.1f} +- {time.error_ms:.1f} ms (--readout-ms {ms:.1f})"
    unlike = "" if time.shown_s is None else f"; but the frames show {1000 * time.shown_s:.1f} ms"
    return f"unshutter: readout time {ms:.1f} ms, from {time.source} ({time.camera}){unlike}"


def _rate_line(before: float, after: float, encode: Encode) -> str:
    """Compares the new video's size with the clip's, and names the option that changes it."""
    times = after / before
    size = f"{times:.1f} times as large as" if times > 1 else f"{1 / times:.1f} times smaller than"
    advice = "--crf chooses another quality" + ("" if encode.bitrate else ", --bitrate same keeps the clip's size")
    return (
        f"unshutter: the video will be about {size} the clip's: {after / 1e6:.1f} instead of {before / 1e6:.1f} "
        f"million bits a second; {advice}"
    )


def _lines_of(outcome: ClipOutcome) -> Iterator[str]:
    """Yields the result and warnings for the user, one line each."""
    if outcome.after_killed_run:
        yield "unshutter: an earlier run was killed here; this one started from the beginning"
    note = ""
    by_camera = outcome.rectified - outcome.dense
    if outcome.model == "dense" and by_camera:
        note = f" ({by_camera} of them by the camera's motion alone)"
    if unchanged := outcome.frames - outcome.rectified:
        reason, count = outcome.reasons.most_common(1)[0]
        others = f"; {unchanged - count} for other reasons" if unchanged > count else ""
        moved = outcome.stabilisation is not None and not outcome.stabilisation.is_idle
        note += f", {unchanged} {'not straightened' if moved else 'left unchanged'} ({reason}{others})"
    frames = f"{outcome.rectified} of {_frames(outcome.frames)} straightened"
    result = outcome.output if outcome.written else "not written"
    yield f"{outcome.source} -> {result}: {frames}{note}"
    yield from _frame_lines(outcome)
    yield from _view_lines(outcome)
    yield from _ways_to_straighten(outcome)
    if outcome.direction is not None:
        yield f"unshutter: the frames show that they were read {outcome.direction} (--readout {outcome.direction})"
    if outcome.lens is not None and (outcome.rectified or outcome.straight_degrees):
        now = f"; straight now, {outcome.straight_degrees:.0f} degrees" if outcome.straight_degrees else ""
        sure = f" +- {100 * outcome.lens.error:.1f} %" if outcome.lens.error else ""
        view = f"{outcome.lens_degrees:.0f} degrees from corner to corner{sure}"
        yield f"unshutter: the lens bends straight lines: {view}, from {outcome.lens.source}{now}"
    yield from _gyro_lines(outcome)
    if outcome.left_out:
        yield f"unshutter: {describe(outcome.left_out)}"
    if outcome.as_they_were:
        yield f"unshutter: left unchanged: {', '.join(outcome.as_they_were)}"
    if outcome.gap_s is not None:
        at, seconds = outcome.gap_s
        hole = f"has no frames for {seconds:.1f} s after {at:.1f} s"
        yield f"unshutter: {outcome.source} {hole}: part of it may be missing"


def _frame_lines(outcome: ClipOutcome) -> Iterator[str]:
    """Yields what is special about the clip's frames."""
    yield from (f"unshutter: {line}" for line in _clock_lines(outcome.clock, outcome.interval_s))
    if outcome.picture is not None and outcome.rectified:
        height, width = outcome.picture
        yield f"unshutter: bars are left unchanged: the picture between them has {width}x{height} px"
    if outcome.damaged:
        missing = "cannot be decoded, and is" if outcome.damaged == 1 else "cannot be decoded, and are"
        yield f"unshutter: {_frames(outcome.damaged)} of {outcome.source} {missing} missing"


def _clock_lines(clock: CameraClock, interval_s: float) -> Iterator[str]:
    """Yields how the camera's frames follow each other, if not as the file shows them."""
    shown, of_camera = (f"{rate / interval_s:.5g}" for rate in (1.0, float(clock.share)))
    if clock.share < 1:
        yield f"{of_camera} of {shown} frames a second are the camera's; the others repeat them"
    if clock.share > 1:
        yield f"{shown} of the camera's {of_camera} frames a second are there"
    if clock.slowed != 1:
        taken = f"{1 / clock.interval_s(interval_s):.5g}"
        yield f"{'slow' if clock.slowed > 1 else 'fast'} motion: the camera took {taken} frames a second"


def _ways_to_straighten(outcome: ClipOutcome) -> Iterator[str]:
    """Yields what the user can do about a clip that was left unchanged."""
    if outcome.unfit is not None and outcome.unfit.code is Code.GYRO_DISAGREES:
        yield "unshutter: if the gyro log is not this clip's: --gyro off"
    if outcome.unfit is not None or any(reason.code is Code.NO_GAIN for reason in outcome.reasons):
        yield "unshutter: to straighten it anyway, give its readout time: --readout-ms"


def _steady_line(stabilisation: Stabilisation) -> str:
    """Describes the result of smoothing the camera's path."""
    if stabilisation.is_idle:
        return "unshutter: the camera's path is smooth already: nothing to stabilise"
    said = f"unshutter: path smoothed, {100 * (1 - 1 / stabilisation.zoom):.1f} % of width and height cut off"
    if stabilisation.limited:
        said += f", less smooth than asked for about {_frames(stabilisation.limited)} (--zoom-limit allows more)"
    if stabilisation.unknown:
        said += f"; how the camera turned is unknown between {_frames(stabilisation.unknown)}"
    return said


def _view_lines(outcome: ClipOutcome) -> Iterator[str]:
    """Yields how the path was smoothed and frames were enlarged."""
    if outcome.stabilisation is not None:
        yield _steady_line(outcome.stabilisation)
    if outcome.enlargement is not None and outcome.enlargement.zoom > 1.0:
        yield _enlarged_line(outcome.enlargement)


def _enlarged_line(enlargement: Enlargement) -> str:
    """Describes how frames were enlarged, and what is missing nevertheless."""
    said = f"unshutter: all frames enlarged by {100 * (enlargement.zoom - 1):.1f} %"
    if enlargement.frames:
        missing = f"up to {enlargement.missing_px:.0f} px more are missing in {_frames(enlargement.frames)}"
        return f"{said}, the most; {missing}: the border is repeated there (--edges crop cuts it off)"
    return f"{said}, so that no border shows (--edges keep does not enlarge)"


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _gyro_lines(outcome: ClipOutcome) -> Iterator[str]:
    """Yields what became of the clip's gyro log, and of the one found in its frames."""
    if outcome.gyro is not None and (outcome.gyro.rotations is not None or outcome.gyro.reason != outcome.unfit):
        yield _gyro_line(outcome.gyro)
    virtual = outcome.virtual_gyro
    if virtual is not None and virtual.reason is not None:
        yield f"unshutter: no gyro log written: {virtual.reason}"
    elif virtual is not None and virtual.unknown:
        yield f"unshutter: how the camera turned is unknown before {_frames(virtual.unknown)}: the gyro log has 0 there"


def _gyro_line(gyro: ClipGyro) -> str:
    """Describes how the clip's gyro log was used, or why it was not."""
    if gyro.reason is not None and gyro.reason.code is Code.GYRO_UNREAD:
        needed = f"reading it takes Python 3.11 or 3.12 and {extra('gyro')}"
        return f"unshutter: the clip may have a gyro log (track {gyro.origin}): {needed}"
    if gyro.reason is not None or gyro.rotations is None:
        return f"unshutter: gyro log ({gyro.origin}) not used: {gyro.reason}"
    alignment = gyro.rotations.alignment
    focal = f"focal length {gyro.rotations.focal_px(1):.2f} times the frame's height"
    return (
        f"unshutter: gyro log ({gyro.origin}) used: its clock is {alignment.offset_s:+.3f} s from the clip's, {focal}"
    )


VIDEO = Command(
    """Straighten a clip: every frame as a global shutter would have seen it.

The frames show how the camera moved, and usually how long it takes to read one out. Sound, other tracks, tags and
timestamps are kept. Needs the extra `video`.""",
    Video,
    _video,
    when_stopped="no half-written file is left",
    essentials={
        "clip": "a video; -: stdin",
        "output": "a file or folder; -: stdout",
        "readout_ms": "readout time of a frame, if you know it",
        "camera": "take its readout time (unshutter cameras lists them)",
        "model": "camera, or dense: near and far move differently",
        "edges": "auto, keep, crop, fill or borrow",
        "strength": "how much to undo: 1 is all of it",
        "stabilize": "also smooth the camera's path",
        "start": "from this second",
        "end": "up to this second",
        "preview": "before and after: a picture, or a short video (.mp4)",
        "overwrite": "replace an existing result",
    },
)


# ---- unshutter measure --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measure:
    """Arguments of ``unshutter measure``."""

    clip: list[str] = positional("Videos (.mp4, .mov, .mkv ...).", "input")
    json: bool = option(False, "Print JSON: a list with an object for each clip.")
    options: MeasureClips = field(default_factory=MeasureClips)


def _measure(arguments: Measure) -> int:
    """Prints what the clips tell; returns the exit code."""
    for name in arguments.clip:
        if Path(name).suffix.lower() in SUFFIXES:
            raise UsageError(f"{name} is a photo: only clips show their readout time")
    from unshutter.video.measurement import measure_clips

    options = arguments.options
    found = measure_clips(arguments.clip, one_camera=options.one_camera, start=options.start, end=options.end)
    if arguments.json:
        print(json.dumps([each.as_json() for each in found], indent=1))
    else:
        print("\n".join(line for each in found for line in _measured_lines(each)))
    return 0


def _measured_lines(measurement: ClipMeasurement) -> Iterator[str]:
    """Yields what a measurement says, for people."""
    names = measurement.clips
    name = names[0] if len(names) == 1 else f"all {len(names)} clips"
    time = measurement.readout_time
    size = f"{measurement.width}x{measurement.height} px, {1 / measurement.interval_s:.2f} frames/s"
    if time is None:
        what = "no rolling shutter" if measurement.is_global else "readout time unknown"
        yield f"{name} ({size}): {what}: {measurement.reason}"
    else:
        error = f" +- {time.error_ms:.1f}" if time.error_s else ""
        share = f"{100 * time.ratio(measurement.camera_interval_s).value:.0f} % of the time between frames"
        way = "" if measurement.direction is None else f", {measurement.direction}"
        source = f"{measurement.how} ({time.camera})" if time.camera else measurement.how
        yield f"{name} ({size}): readout time {time.ms:.1f}{error} ms, {share}{way}; from {source}"
        if time.shown_s is not None:
            yield f"  but the frames show {1000 * time.shown_s:.1f} ms"
    yield from (f"  {line}" for line in _clock_lines(measurement.clock, measurement.interval_s))
    shown = measurement.shown
    if shown is not None and measurement.wobble_px is not None and not measurement.is_global:
        yield f"  wobble from frame to frame: {measurement.wobble_px:.2f} px ({shown.pairs} pairs of frames)"
    if measurement.lens_degrees is not None:
        yield f"  the lens bends straight lines: {measurement.lens_degrees:.0f} degrees from corner to corner"


MEASURE = Command(
    """Measure the readout time of clips: how long the sensor takes from the first row of a frame to the last.

The frames show it where the camera changes its speed; a second or two of a hand-held clip suffices. Prints the time
with its error and direction, how it was found, how far the clip wobbles, and the lens. Nothing is written. Blanking
rows, which no frame shows, are not included. Needs the extra `video`.""",
    Measure,
    _measure,
)
