"""Measures clips, which are left unchanged: readout time and direction, how far they wobble, and the lens.

Readout times are those from the first row of the clip's frames to the last: the camera's blanking rows, which no frame
shows, are not included, nor are rows that were cropped.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.motion.lens import Lens
from unshutter.options.clip_options import MeasureClips, RectifyClip
from unshutter.options.fields import implemented_by
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.video.calibrate.camera import find_camera
from unshutter.video.calibrate.readout_regression import Regression, Run, regression
from unshutter.video.decision import why_unfit
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import ClipFacts, read_clip_facts

_BY_FRAMES = ReadoutSource.FRAMES, ReadoutSource.REGRESSION


@dataclass(frozen=True)
class ClipMeasurement:
    """The measurement of a camera by one or several of its clips."""

    clips: tuple[str, ...]  # their files
    width: int  # of the stored frames [px]
    height: int
    interval_s: float  # the usual time from one frame to the next, as the files show them [s]
    readout_time: ReadoutTime | None  # from the first row of a frame to the last; None if it is unknown
    direction: ScanDirection | None  # in which the stored rows or columns were read; None if that is unknown
    reason: Reason | None = None  # why it was not found, or that there is no rolling shutter
    shown: Regression | None = None  # what the regression says; None if there are too few frames
    wobble_px: float | None = None  # wobble that this explains: RMS at the first and last rows, frame to frame [px]
    lens: Lens | None = None  # the lens, if it bends straight lines
    clock: CameraClock = field(default_factory=CameraClock)  # the camera's, as far as it differs from the file's

    @property
    def camera_interval_s(self) -> float:
        """The camera's time from one frame to the next [s]."""
        return self.clock.interval_s(self.interval_s)

    @property
    def how(self) -> str:
        """How the readout time was found: regression, search, or the name of another source; empty: it was not."""
        if self.readout_time is None:
            return ""
        return "search" if self.readout_time.source is ReadoutSource.FRAMES else str(self.readout_time.source)

    @property
    def is_global(self) -> bool:
        """Whether all rows look as if they had been exposed at once."""
        return self.reason is not None and self.reason.code is Code.READ_AT_ONCE

    @property
    def lens_degrees(self) -> float | None:
        """Field of view from corner to corner [degrees]; None if the lens keeps lines straight, or is unknown."""
        sides = self.height, self.width
        return None if self.lens is None else round(self.lens.degrees(max(sides) / min(sides)), 1)

    def as_json(self) -> JsonObject:
        """Returns the measurement, ready for JSON."""
        time = self.readout_time
        shown = self.shown
        known = None if time is None else time.ratio(self.camera_interval_s)
        return {
            "clips": list(self.clips),
            "width": self.width,
            "height": self.height,
            "fps": round(1 / self.interval_s, 4),
            **({} if self.clock.is_files else {"camera_fps": round(1 / self.camera_interval_s, 4)}),
            "readout_ms": None if time is None else round(time.ms, 3),
            "readout_ms_sd": None if time is None or not time.error_s else round(time.error_ms, 3),
            "readout_ratio": None if known is None else round(known.value, 4),
            "direction": self.direction,
            "found_by": self.how or None,
            "camera": None if time is None else time.camera or None,
            "rolling_shutter": False if self.is_global else None if time is None else True,
            "reason": None if self.reason is None else self.reason.as_json(),
            "frames_show_ratio": None if shown is None else round(shown.rows.ratio, 4),
            "frames_show_ratio_sd": None if shown is None else round(shown.error, 4),
            "frames_show_surely": None if shown is None else shown.is_sure or shown.is_none,
            "pairs": None if shown is None else shown.pairs,
            "wobble_px": None if self.wobble_px is None else round(self.wobble_px, 3),
            "lens_degrees": self.lens_degrees,
        }


def _measure_clips(sources: Sequence[str | os.PathLike[str]], options: MeasureClips) -> list[ClipMeasurement]:
    measured = [_measured(Path(source), options) for source in sources]
    found = [measurement for measurement, _, _ in measured]
    return [*found, _together(measured)] if len(measured) > 1 and options.one_camera else found


@implemented_by(_measure_clips, options=MeasureClips)
def measure_clips(
    sources: Sequence[str | os.PathLike[str]],
    *,
    progressive: bool = False,
    one_camera: bool = False,
    start: float | None = None,
    end: float | None = None,
) -> list[ClipMeasurement]:
    """Measures clips: readout time and direction, wobble, and the lens. Writes and prints nothing.

    Args:
        sources: videos.

    Returns:
        A measurement for each clip; with ``one_camera``, also one of all clips together.

    Raises:
        UsageError: an option is invalid.
        UnshutterError: a clip cannot be read, or clips of one camera differ in the size or rate of their frames.

    Examples:
        >>> (measurement,) = unshutter.measure_clips(["walk.mp4"])
        >>> measurement.width, measurement.height
        (192, 144)
    """
    ...


def _measured(path: Path, options: MeasureClips) -> tuple[ClipMeasurement, list[Run], float]:
    """Returns a clip's measurement, its runs, and the px of the clip for each of the copies in which it was tracked."""
    clip = read_clip_facts(path, until_s=options.end, progressive=options.progressive)
    clip.check_whole()
    request = ClipRequest.of(clip, RectifyClip(start=options.start, end=options.end))
    camera, sampled = find_camera(request)
    runs = sampled.pair_runs
    direction = camera.scan_direction or request.scan_direction
    request = camera.complete(request)
    px = sampled.px_of(request.frame_size[0])
    if px is None:
        raise UnshutterError("{clip} has too few frames to measure", clip=str(path))
    time = camera.readout_time
    reason = why_unfit(camera) or time.instead_of
    measurement = _of_camera((str(path),), clip, time, reason, direction, regression(runs), px, camera.lens)
    return replace(measurement, clock=request.clip.clock), runs, px


def _of_camera(
    clips: tuple[str, ...],
    size: ClipFacts | ClipMeasurement,
    time: ReadoutTime | None,
    reason: Reason | None,
    direction: ScanDirection,
    shown: Regression | None,
    px: float,
    lens: Lens | None,
) -> ClipMeasurement:
    """Returns the measurement for what is known of a camera; the reason is that for which a time may be unknown."""
    is_known = time is not None and time.source is not ReadoutSource.USUAL and time.plausible_s is None
    return ClipMeasurement(
        clips=clips,
        width=size.width,
        height=size.height,
        interval_s=size.interval_s,
        readout_time=time if is_known else None,
        direction=direction if is_known else None,
        reason=None if is_known else reason,
        shown=shown,
        wobble_px=None if shown is None else shown.wobble_px * px,
        lens=lens,
    )


def _together(measured: Sequence[tuple[ClipMeasurement, list[Run], float]]) -> ClipMeasurement:
    """Returns what clips of one camera tell together, by one regression of all their frames."""
    every = [measurement for measurement, _, _ in measured]
    first = every[0]
    for each in every:
        same_rate = abs(each.camera_interval_s - first.camera_interval_s) <= 0.01 * each.camera_interval_s
        if (each.width, each.height) != (first.width, first.height) or not same_rate:
            raise UnshutterError(f"{first.clips[0]} and {each.clips[0]} differ in the size or rate of their frames")
    shown = regression([run for _, runs, _ in measured for run in runs])
    _, _, px = measured[0]
    times = [each.readout_time for each in every if each.readout_time is not None]
    stated = next((each for each in times if each.source not in _BY_FRAMES), None)
    names = tuple(name for each in every for name in each.clips)
    direction = next((each.direction for each in every if each.direction is not None), ScanDirection.TOP_TO_BOTTOM)
    time = stated
    if time is None and shown is not None and (shown.is_sure or shown.is_likely):
        time = shown.readout_ratio.seconds(first.camera_interval_s)
    is_none = shown is not None and shown.is_none
    reason = Reason(Code.READ_AT_ONCE if is_none else Code.NO_WOBBLE)
    return replace(_of_camera(names, first, time, reason, direction, shown, px, first.lens), clock=first.clock)
