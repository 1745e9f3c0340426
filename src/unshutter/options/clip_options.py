"""Options for clips (see the package's options/). Nothing here imports NumPy or PyAV."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from unshutter.errors import UsageError
from unshutter.options import MOST_STRENGTH, FrameModel, Reference, check_count, check_time, option
from unshutter.options.fields import LONGEST, check_values
from unshutter.options.photo_options import Edges, check_focal, check_ratio
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime

MAX_CLIP_PIXELS = 38_000_000  # per frame, unless the user allows more: 8K
GYRO_OFF = "off"
JOIN = "to make a video from pictures: ffmpeg -framerate 30 -i frames/%05d.png -c:v libx264 video.mp4"
USUAL_PERIOD_S = 2.0
_PROGRESSIVE = "Frames are whole, even if rows look as if they showed two moments."
_ZOOM_LIMIT, _MOST_ZOOM_LIMIT = 15.0, 50.0  # per cent


@dataclass(frozen=True)
class Shutter:
    """What you know about the camera."""

    readout_ms: float | None = option(
        None, "Readout time of a frame in ms. Default: from the clip or the table of cameras.", metavar="MS"
    )
    readout_ratio: float | None = option(
        None, "Readout time as a share of the time between two frames, above 0 and at most 1."
    )
    camera: str | None = option(
        None,
        "Name of the camera in the table of readout times; `unshutter cameras` lists them. Default: from the "
        "clip's metadata.",
        names="word",
    )
    readout: str = option(
        "auto",
        "Direction in which the sensor was read out, if an editor has rotated the frames. Default: found from the "
        "clip, otherwise top-to-bottom.",
        choices=("auto", *ScanDirection),
    )
    focal_px: float | None = option(None, "Focal length in px of a frame. Default: found from the clip.")
    lens: str | None = option(
        None,
        "Calibration of a lens that bends straight lines: YAML or JSON of OpenCV, JSON of Gyroflow. "
        "Default: found from the clip.",
        metavar="FILE",
        names="input",
        page=False,
    )
    gyro: str | None = option(
        None,
        "Gyro log of the clip: a .gcsv file, a GoPro's clip, or what telemetry-parser reads; off: none. "
        "Default: the log in the clip's own file.",
        metavar="FILE",
        names="input",
        page=False,
    )

    def __post_init__(self) -> None:
        check_values(self)
        if self.readout_ms is not None and self.readout_ratio is not None:
            raise UsageError("give {--readout-ms} or {--readout-ratio}, not both")
        if self.camera is not None and (self.readout_ms is not None or self.readout_ratio is not None):
            raise UsageError("give {--readout-ms}, {--readout-ratio} or {--camera}: one of them")
        check_time("readout-ms", self.readout_ms, "ms")
        if self.lens is not None and self.focal_px is not None:
            raise UsageError("the lens file tells the focal length: leave out {--focal-px}")
        check_ratio(self.readout_ratio)
        check_focal(self.focal_px)

    @property
    def is_empty(self) -> bool:
        """Whether the user states no readout time, camera, focal length, lens or gyro log."""
        known = (self.readout_ms, self.readout_ratio, self.camera, self.focal_px, self.lens, self.gyro)
        return all(each is None for each in known)

    @property
    def states_time(self) -> bool:
        """Whether the user states a readout time."""
        return self.readout_ms is not None or self.readout_ratio is not None

    def readout_time(self, interval_s: float) -> ReadoutTime | None:
        """Returns the stated readout time for the camera's interval between frames; None if none is stated."""
        if self.readout_ratio is not None:
            return ReadoutRatio(self.readout_ratio).seconds(interval_s)
        if self.readout_ms is None:
            return None
        if self.readout_ms / 1000 / interval_s > 1.0005:
            raise UsageError(
                f"frames are {1000 * interval_s:.2f} ms apart: they cannot take {self.readout_ms:g} ms to be read out"
            )
        return ReadoutTime.of_ms(self.readout_ms, ReadoutSource.GIVEN)


@dataclass(frozen=True)
class ClipUndo:
    """How the motion of frames is undone."""

    reference: Reference = option("middle", "Row whose capture time each frame should show. Default: middle.")
    strength: float = option(
        1.0, f"How much of the motion to undo, 0 to {MOST_STRENGTH:g}; 1 is all of it.", limits=(0, MOST_STRENGTH)
    )
    edges: Edges = option(
        "auto",
        "Areas outside the original frame: auto enlarges all frames alike until none shows, by at most 5 %, and "
        "repeats the border beyond that; if 1 % of the width or less is missing, it only repeats the border. "
        "keep: black. crop: cut all frames alike. fill: a mirror image. borrow, with {--model} dense: from the frames "
        "before and after. Default: auto.",
    )
    model: FrameModel = option(
        "camera",
        "camera: one motion for the whole frame. dense: near and far objects may move differently; slower. "
        "Default: camera.",
    )

    def __post_init__(self) -> None:
        check_values(self)
        if self.edges == "borrow" and self.model != "dense":
            raise UsageError("{--edges} borrow needs {--model} dense: choose auto, keep, crop or fill without it")
        if self.edges == "crop" and self.model == "dense":
            raise UsageError("{--model} dense cannot crop frames: choose {--edges} borrow, auto, keep or fill")


@dataclass(frozen=True)
class Steadiness:
    """How the camera's path is smoothed."""

    stabilize: float | None = option(
        None,
        "Also smooth the camera's path: removes movements shorter than this many seconds "
        f"({USUAL_PERIOD_S:g} if you give no number). Frames are enlarged until no border shows.",
        metavar="SECONDS",
        bare=USUAL_PERIOD_S,
    )
    zoom_limit: float | None = option(
        None,
        "Most of the width and height that {--stabilize} may cut off, in per cent; if that is not enough, it smooths "
        f"less. Default: {_ZOOM_LIMIT:g}.",
        metavar="PERCENT",
    )
    level: bool = option(
        False, "With {--stabilize}, keep the horizon level. Needs a gyro log that includes acceleration.", page=False
    )

    def __post_init__(self) -> None:
        if self.stabilize is None and (self.zoom_limit is not None or self.level):
            raise UsageError("{--level} needs {--stabilize}" if self.level else "{--zoom-limit} needs {--stabilize}")
        check_time("stabilize", self.stabilize, "s")
        if self.zoom_limit is not None and not 0 <= self.zoom_limit <= _MOST_ZOOM_LIMIT:
            raise UsageError(f"{{--zoom-limit}} must lie between 0 and {_MOST_ZOOM_LIMIT:g}, got {self.zoom_limit:g}")

    @property
    def largest_zoom(self) -> float:
        """Zoom at the limit of what may be cut off."""
        return 1 / (1 - (_ZOOM_LIMIT if self.zoom_limit is None else self.zoom_limit) / 100)


@dataclass(frozen=True)
class Encode:
    """How frames are encoded."""

    codec: str | None = option(
        None, "Encoder: libx264, libx265, libsvtav1, prores_ks, ffv1 ... Default: the clip's own codec.", names="word"
    )
    crf: float | None = option(
        None,
        "Quality: lower looks better and makes larger files. Default: visually lossless, 12 (libx264, libx265), "
        "10 (libvpx-vp9), 8 (libsvtav1).",
    )
    bitrate: Literal["same"] | None = option(
        None, "same: as many bits per second as the clip, whatever that costs in sharpness."
    )
    preset: str | None = option(
        None, "Speed of the encoder: ultrafast to veryslow (libx264, libx265), 13 to 0 (libsvtav1).", names="word"
    )

    def __post_init__(self) -> None:
        if self.crf is not None and not 0 <= self.crf <= 63:
            raise UsageError(f"{{--crf}} must lie between 0 and 63, got {self.crf:g}")
        if self.bitrate is not None and self.crf is not None:
            raise UsageError("{--bitrate} and {--crf} exclude each other")


@dataclass(frozen=True)
class MeasureClips:
    """Which part of clips to measure, and whether together."""

    progressive: bool = option(False, _PROGRESSIVE)
    one_camera: bool = option(
        False, "The clips are from one camera in one mode: measure them together, too, which is more exact."
    )
    start: float | None = option(None, "Start at this second of each clip.", metavar="SECONDS")
    end: float | None = option(None, "Stop at this second of each clip.", metavar="SECONDS")

    def __post_init__(self) -> None:
        _check_span(self.start, self.end)


def _check_span(start: float | None, end: float | None) -> None:
    """Raises UsageError if a part of a clip ends before it begins."""
    first = start or 0.0
    last = math.inf if end is None else end
    if not 0 <= first < LONGEST or not (last > first and (end is None or last < LONGEST)):
        raise UsageError("{--start} must be 0 or later, and {--end} after it, in seconds")


@dataclass(frozen=True)
class RectifyClip:
    """Which part of the clip, which motion, and what else to write."""

    shutter: Shutter = field(default_factory=Shutter)  # what the user states about the camera
    undo: ClipUndo = field(default_factory=ClipUndo)  # how motion is undone
    steadiness: Steadiness = field(default_factory=Steadiness)  # how the camera's path is smoothed
    encode: Encode = field(default_factory=Encode)  # how frames are encoded
    start: float | None = option(None, "Start at this second of the clip.", metavar="SECONDS")
    end: float | None = option(None, "Stop at this second of the clip.", metavar="SECONDS")
    motion: Path | None = option(
        None, "Undo the motion in this file (from {--save-motion}) instead of finding it.", names="input", page=False
    )
    save_motion: Path | None = option(
        None, "Also write the clip's motion to this JSON file.", metavar="PATH", names="output", page=False
    )
    save_gyro: Path | None = option(
        None,
        "Also write the rotation rate in the frames as a gyro log for Gyroflow (.gcsv).",
        metavar="PATH",
        names="output",
        page=False,
    )
    preview: Path | None = option(
        None,
        "Also write before and after side by side: five frames (.jpg, .png), or a video (.mp4).",
        names="output",
        page=False,
    )
    plot: Path | None = option(
        None,
        "Also plot how fast the camera turned (.png, .svg, .pdf). Needs the extra `plot`.",
        names="output",
        page=False,
    )
    progressive: bool = option(False, _PROGRESSIVE, page=False)
    straight_lines: bool = option(
        False, "Also straighten the lines that a wide lens bends. The lens must be known.", page=False
    )
    only_changed: bool = option(False, "Write nothing if no frame changes. Default: copy the clip.", page=False)
    overwrite: bool = option(False, "Replace existing output files, but never the clip itself.", page=False)
    json_log: Path | None = option(
        None, "Append a log of the run to this file, one JSON object per line.", names="output", page=False
    )
    max_pixels: int = option(
        MAX_CLIP_PIXELS, "Refuse clips with larger frames. Default: 38 000 000 pixels (8K).", page=False
    )

    def __post_init__(self) -> None:
        if self.motion is not None and not self.shutter.is_empty:
            raise UsageError(
                "the motion file describes the camera: leave out {--readout-ms}, {--focal-px} and the like"
            )
        if self.undo.model == "dense" and (self.motion is not None or self.save_motion is not None):
            raise UsageError(
                "motion files contain the camera's motion, which {--model} dense cannot undo: use {--model} camera"
            )
        if self.steadiness.level and self.motion is not None:
            raise UsageError(
                "{--level} needs the clip's gyro log, which a motion file does not contain: leave out {--motion}"
            )
        if self.straight_lines and self.steadiness.stabilize is not None:
            raise UsageError(
                "{--straight-lines} cannot be combined with {--stabilize}: stabilise the straightened clip"
            )
        if self.steadiness.level and self.shutter.gyro == GYRO_OFF:
            raise UsageError("{--level} needs the clip's gyro log: leave out {--gyro} off")
        _check_span(self.start, self.end)
        check_count("max-pixels", self.max_pixels)

    @property
    def may_enlarge(self) -> bool:
        """Whether frames may be enlarged to hide their borders."""
        return self.undo.edges == "auto"

    @property
    def may_be_copy(self) -> bool:
        """Whether a clip in which nothing changes can be copied: no part or encoding is asked for."""
        whole = self.start is None and self.end is None and self.encode == Encode()
        return whole and not self.straight_lines

    def on_clock(self, begin_s: float) -> RectifyClip:
        """Returns these options with start and end on a clock that shows this time as the clip begins [s]."""
        start, end = (None if each is None else each + begin_s for each in (self.start, self.end))
        return replace(self, start=start, end=end) if begin_s else self

    def span(self, begin_s: float, duration_s: float) -> tuple[float, float]:
        """Returns start and end [s] of the part to keep; a clip of unknown length (0) counts as a minute long.

        Args:
            begin_s: time at which the clip begins, on the clock of start and end.
        """
        return self.start or begin_s, self.end or begin_s + (duration_s or 60.0)
