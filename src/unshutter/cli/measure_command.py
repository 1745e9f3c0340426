"""``unshutter measure``: measures the readout time of clips."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.cli.arguments import Command
from unshutter.errors import UsageError
from unshutter.options import option
from unshutter.options.clip_options import MeasureClips
from unshutter.options.fields import positional
from unshutter.run.inputs import PHOTO_SUFFIXES

if TYPE_CHECKING:
    from unshutter.video.measurement import ClipMeasurement


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``unshutter measure``."""

    clip: list[str] = positional("Films (.mp4, .mov, .mkv ...).", "input")
    json: bool = option(False, "Print JSON: a list with an object for each clip.")
    options: MeasureClips = field(default_factory=MeasureClips)


def run(arguments: Arguments) -> int:
    """Prints what the clips tell; returns the exit code."""
    for name in arguments.clip:
        if Path(name).suffix.lower() in PHOTO_SUFFIXES:
            raise UsageError(f"{name} is a photo: only clips show their readout time")
    from unshutter.video.measurement import measure_clips

    options = arguments.options
    found = measure_clips(arguments.clip, one_camera=options.one_camera, start=options.start, end=options.end)
    if arguments.json:
        print(json.dumps([each.as_json() for each in found], indent=1))
    else:
        print("\n".join(line for each in found for line in _lines_of(each)))
    return 0


def _lines_of(measurement: ClipMeasurement) -> Iterator[str]:
    """Yields what a measurement says, for people."""
    names = measurement.clips
    name = names[0] if len(names) == 1 else f"all {len(names)} clips"
    time = measurement.readout
    size = f"{measurement.width}x{measurement.height} px, {1 / measurement.interval_s:.2f} frames/s"
    if time is None:
        what = "no rolling shutter" if measurement.is_global else "readout time unknown"
        yield f"{name} ({size}): {what}: {measurement.reason}"
    else:
        error = f" +- {time.error_ms:.1f}" if time.error_s else ""
        share = f"{100 * time.ratio(measurement.interval_s).value:.0f} % of the time between frames"
        way = "" if measurement.direction is None else f", {measurement.direction}"
        source = f"{measurement.how} ({time.camera})" if time.camera else measurement.how
        yield f"{name} ({size}): readout time {time.ms:.1f}{error} ms, {share}{way}; from {source}"
        if time.shown_s is not None:
            yield f"  but the frames show {1000 * time.shown_s:.1f} ms"
    shown = measurement.shown
    if shown is not None and measurement.wobble_px is not None and not measurement.is_global:
        yield f"  wobble from frame to frame: {measurement.wobble_px:.2f} px ({shown.pairs} pairs of frames)"
    if measurement.lens_degrees is not None:
        yield f"  the lens bends straight lines: {measurement.lens_degrees:.0f} degrees from corner to corner"


COMMAND = Command(
    """Measure the readout time of clips: how long the sensor takes from the first row of a frame to the last.

The frames show it where the camera changes its speed; a second or two of a hand-held clip suffices. Prints the time
with its error and direction, how it was found, how far the clip wobbles, and the lens. Nothing is written. Blanking
rows, which no frame shows, are not included. Needs the extra `video`.""",
    Arguments,
    run,
)
