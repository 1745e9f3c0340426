"""Options for photos: finding the motion, undoing it, writing the picture, and the frames before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

from unshutter.errors import UsageError, shortened
from unshutter.options.fields import check_time, check_values, option
from unshutter.options.picture_formats import BY_NAME, TABLE, PictureFormat, in_words
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio

DEFAULT_ESTIMATOR = "segment-manhattan"
MOST_ROLL_DEG, MOST_TILT_DEG = 45, 90  # beyond these, up is no longer up


_LONGEST_PX = 1e9  # the longest focal length


def check_focal(focal_px: float | None, rows: int = 64) -> None:
    """Checks a focal length [px], if any, for a picture with this many rows, by default the fewest accepted."""
    least = rows / 20.0
    if focal_px is not None and not least <= focal_px <= _LONGEST_PX:
        raise UsageError(f"{{--focal-px}} must lie between {least:g} and {_LONGEST_PX:g} px, got {focal_px:g} px")


USUAL_FOCAL = 0.85  # focal length to expect, as a share of width + height
Moving = Literal["yes", "left", "right", "up", "down"]


@dataclass(frozen=True)
class Camera:
    """What you know about the camera."""

    readout: str = option(
        "auto",
        "Direction in which the sensor was read out, if an editor has rotated the file. Default: taken from "
        "{--motion} or found in the photo, otherwise top-to-bottom.",
        choices=("auto", *ScanDirection),
    )
    focal_px: float | None = option(
        None,
        f"Focal length in px, for methods that use it. Default: from EXIF, otherwise {USUAL_FOCAL} (width + height).",
    )
    roll_deg: float | None = option(
        None,
        "Camera roll in degrees, clockwise from upright; for methods that use it.",
        limits=(-MOST_ROLL_DEG, MOST_ROLL_DEG),
    )
    tilt_deg: float | None = option(
        None,
        "Camera tilt in degrees: positive is up, -90 straight down.",
        limits=(-MOST_TILT_DEG, MOST_TILT_DEG),
    )
    exposure_s: float | None = option(None, "Exposure time in seconds. Default: from EXIF.", metavar="SECONDS")
    readout_ms: float | None = option(
        None,
        "Readout time in ms, from the first row to the last. Default: the usual time for such a camera.",
        metavar="MS",
    )
    moving: Moving | None = option(
        None,
        "The camera was on the move: in a train, on a car, on a drone. left, right, up or down: the direction in which "
        "it went or turned; this decides between candidates.",
        bare="yes",
    )

    def __post_init__(self) -> None:
        check_values(self)
        check_focal(self.focal_px)
        check_time("exposure-s", self.exposure_s, "s")
        check_time("readout-ms", self.readout_ms, "ms")

    @property
    def scan_direction(self) -> ScanDirection:
        """The readout direction, with ``auto`` resolved."""
        return ScanDirection.parse(self.readout)


@dataclass(frozen=True)
class DecisionOptions:
    """The user's and the folder's part in deciding whether to undo a motion."""

    # confidence from which a motion is undone, instead of weighing gain against harm; 0: the likeliest, however unsure
    least_confidence: float | None = None
    # what the other photos of a folder say about how many of them moved: log odds, 0 for half (run/folder.py)
    folder: float = 0.0

    @property
    def any(self) -> bool:
        """Whether to accept the likeliest motion, however unsure."""
        return self.least_confidence == 0


@dataclass(frozen=True)
class Find:
    """How a photo's motion is found."""

    estimator: str = option(
        DEFAULT_ESTIMATOR, "Method that finds the camera's motion; `unshutter models` lists them.", names="word"
    )
    camera: Camera = field(default_factory=Camera)  # known facts about the camera
    no_film: bool = option(False, "Do not use the video that belongs to a motion photo or Live Photo.")
    candidate: int | None = option(
        None,
        "Undo candidate N from `unshutter estimate --candidates`, however unsure, instead of the first.",
        metavar="N",
    )
    decision: DecisionOptions = field(default_factory=DecisionOptions)

    def __post_init__(self) -> None:
        if self.candidate is not None and self.candidate < 1:
            raise UsageError(f"{{--candidate}} is counted from 1, got {self.candidate}")

    @property
    def insists(self) -> bool:
        """Whether the user asks for a motion that the photo may not show: by a method, at any confidence, or moving."""
        return self.estimator != DEFAULT_ESTIMATOR or self.decision.any or self.camera.moving is not None

    def for_least_confidence(self, least: float | None) -> Find:
        """Adapts the options to a least confidence; 0 accepts the likeliest motion, however unsure."""
        return replace(
            self, decision=replace(self.decision, least_confidence=least if self.candidate is None else None)
        )

    def check_unused(self) -> None:
        """Checks that only the readout direction is set, as required when no motion is to be found."""
        if self.camera != Camera(self.camera.readout) or self.no_film or self.candidate is not None:
            raise UsageError(
                "{--focal-px}, {--roll-deg}, {--tilt-deg}, {--exposure-s}, {--readout-ms}, {--moving}, {--no-film} and "
                "{--candidate} are for finding a motion: leave them out if you give one"
            )


# of a motion that is undone, unless the user sets another; methods that weigh gain against harm ask for as much
MIN_CONFIDENCE = 0.45
MOST_STRENGTH = 2.0

Reference = Literal["first", "middle", "last"]
Edges = Literal["auto", "keep", "crop", "fill", "borrow"]
Upright = Literal["level", "full"]
LEAST_GOOD_CROP = 0.6  # share of a picture's area: after a smaller crop, someone should look


def check_edges(edges: str) -> None:
    """Checks a choice of edges that needs only the photo."""
    if edges not in get_args(Edges) or edges == "borrow":
        raise UsageError(f"{{--edges}} does not take '{shortened(edges)}': choose auto, keep, crop or fill")


def check_strength(strength: float) -> None:
    """Checks the share of the motion to undo."""
    if not 0 <= strength <= MOST_STRENGTH:
        raise UsageError(f"{{--strength}} must lie between 0 and {MOST_STRENGTH:g}, got {min(strength, 1e15):g}")


@dataclass(frozen=True)
class Undo:
    """How a motion is undone."""

    reference: Reference | None = option(
        None, "Row whose capture time the result shows. Default: taken from {--motion}, otherwise first."
    )
    strength: float = option(
        1.0, f"How much of the motion to undo, 0 to {MOST_STRENGTH:g}; 1 is all of it.", limits=(0, MOST_STRENGTH)
    )
    edges: Edges = option(
        "auto",
        "Areas outside the original photo: keep them empty (black, or transparent with alpha), crop them, fill them "
        "with a mirror image of the photo, or borrow them from neighbouring frames. auto borrows what neighbours show "
        "and crops the rest; with masks, {--keep-names}, saved motions and sequences, it keeps them empty. "
        "Default: auto.",
    )
    min_confidence: float | None = option(
        None,
        "Minimum probability that the result is better than the photo, 0 to 1; below it, the photo is left unchanged. "
        "0 undoes the likeliest motion, however unsure. A motion that you supply is always undone. "
        "Default: the expected gain must outweigh the harm, which takes 0.5 to 0.6.",
        limits=(0, 1),
    )
    upright: Upright | None = option(
        None,
        "Also turn the photo upright, whether or not the camera moved. level: undo its roll. full: undo its tilt, too, "
        "which makes verticals parallel. Rolls above 8 degrees and tilts above 25 are left, unless you state them with "
        "{--roll-deg} and {--tilt-deg}.",
    )

    def __post_init__(self) -> None:
        check_values(self)

    def keeping_coordinates(self) -> Undo:
        """Returns the options with automatic edges kept empty, for results with the photo's size and coordinates."""
        if self.upright:
            raise UsageError(
                "{--upright} turns the picture, but masks, motions and sequences keep its coordinates: leave it out"
            )
        return replace(self, edges="keep") if self.edges == "auto" else self

    def at_any_confidence(self) -> Undo:
        """Returns the options for a motion from the user, which is undone regardless of its confidence."""
        if self.min_confidence:
            raise UsageError("a given motion is undone whatever its confidence: leave out {--min-confidence}")
        if self.upright:
            raise UsageError("{--upright} is for a motion that is found with the photo: leave it out when you give one")
        return replace(self, min_confidence=0)


Subsampling = Literal["4:4:4", "4:2:0"]
_LOSSY = in_words(row for row in TABLE if row.usual_quality)
_SUBSAMPLED = in_words(row for row in TABLE if row.has_subsampling)
_FOR_READ_ONLY = ", ".join(f"{BY_NAME[row.written_as].title} for {row.title}" for row in TABLE if not row.is_written)


@dataclass(frozen=True)
class Save:
    """How a picture is written."""

    format: PictureFormat | None = option(
        None,
        f"File format of the results. Default: same as the photo; {_FOR_READ_ONLY} files (HEIC with a gain map: JPEG).",
        also={"jpg": "jpeg", "tif": "tiff"},
    )
    quality: int | None = option(
        None,
        f"Quality of {_LOSSY}, 1 to 100. Default: close to the original's.",
        limits=(1, 100),
    )
    subsampling: Subsampling | None = option(
        None,
        f"Colour at full (4:4:4) or half (4:2:0) resolution in {_SUBSAMPLED}. Default: same as the original.",
    )
    keep_times: bool = option(False, "Give each result the access and modification times of its photo.", page=False)
    only_changed: bool = option(
        False, "Write only photos that change. Default: copy the others into the folder, too.", page=False
    )
    keep_names: bool = option(
        False, "Keep the photos' file names for the results, in the folder set by {--output}.", page=False
    )

    def __post_init__(self) -> None:
        check_values(self)


FrameModel = Literal["camera", "dense"]


def check_ratio(ratio: float | None) -> None:
    """Checks a readout ratio; None, for unknown, is allowed."""
    if ratio is not None and not 0 < ratio <= 1:
        raise UsageError(
            "{--readout-ratio} (readout time / time from frame to frame) must be above 0 and at most 1, got "
            f"{ratio:g}"
        )


@dataclass(frozen=True)
class Clock:
    """How fast frames were taken and read out."""

    readout_ratio: float | None = option(
        None,
        "Readout time of a frame divided by the time between frames, 0 to 1. Default: found from the frames; two or "
        "three cannot show it, so that which is usual for the camera, otherwise 0.5.",
        limits=(0, 1),
    )
    fps: float | None = option(
        None, "Frames per second; together with the readout time, it replaces the ratio.", metavar="N"
    )
    readout_ms: float | None = None  # set by the camera's option of this name

    def __post_init__(self) -> None:
        if self.readout_ratio is not None and self.fps is not None:
            raise UsageError("give {--readout-ratio}, or {--readout-ms} with {--fps}, not both")
        for name, value in (("readout-ms", self.readout_ms), ("fps", self.fps)):
            if value is not None and not 0 < value < math.inf:
                raise UsageError(f"{{--{name}}} must be above 0, got {value:g}")
        check_ratio(self._ratio)

    @property
    def _ratio(self) -> float | None:
        """Readout time / frame interval, if it was stated, directly or by readout time and frame rate."""
        by_rate = None if self.readout_ms is None or self.fps is None else self.readout_ms * self.fps / 1000
        return by_rate if self.readout_ratio is None else self.readout_ratio

    @property
    def stated_ratio(self) -> ReadoutRatio | None:
        """The stated readout time as a share of the time between frames; None if it was not stated."""
        return None if self._ratio is None else ReadoutRatio(self._ratio)


def model_for(model: FrameModel | None, at: float | None, undo: Undo) -> FrameModel | None:
    """Chooses the motion model: as requested, otherwise as other options require; None: as the frames suggest."""
    if model not in (None, *get_args(FrameModel)):
        raise UsageError(f"{{--model}} does not take '{shortened(model)}': choose camera or dense")
    dense = at is not None or undo.edges == "borrow"
    camera = undo.strength != 1
    if dense and (camera or model == "camera"):
        wrong = "{--model} camera" if model == "camera" else "{--strength}"
        raise UsageError(f"{{--at}} and {{--edges}} borrow are for {{--model}} dense: leave out {wrong}")
    if camera and model == "dense":
        raise UsageError("{--model} dense undoes the whole motion: leave out {--strength}")
    return "dense" if dense else "camera" if camera else model


@dataclass(frozen=True)
class Neighbours:
    """Frames taken just before and after the photo."""

    before: Path | None = option(None, "Frame taken by the same camera just before the photo.", names="input")
    after: Path | None = option(None, "Frame taken just after the photo; one of the two is enough.", names="input")
    sequence: bool = option(
        False,
        "The photos are frames from one camera at even intervals, in the order given (in folders: by name). Their "
        "motions and, unless you give it, the readout ratio are found from one another.",
        page=False,
    )
    clock: Clock = field(default_factory=Clock)  # timing of the frames
    at: float | None = option(
        None,
        "Moment that the result shows, instead of that of a reference row, in frame intervals from the photo's first "
        "row: with {--after}, 0.5 is halfway to the next frame.",
    )
    model: FrameModel | None = option(
        None,
        "camera: one motion for the whole picture. dense: near and far objects may move differently. "
        "Default: the one that fits the frames.",
    )
    each_alone: bool = option(
        False,
        "Judge each photo by itself. Default: photos of one folder, camera and hour together show how many of them "
        "moved, and those of a burst show one another's motion.",
        page=False,
    )
    fallback: bool = option(
        False, "If the neighbouring frames show no motion, use the photo alone. Default: leave the photo unchanged."
    )

    def __post_init__(self) -> None:
        if self.sequence and self:
            raise UsageError("{--sequence} already gives each photo its neighbours: leave out {--before} and {--after}")
        others = self.clock != Clock() or self.at is not None or self.model is not None or self.fallback
        if not (self or self.sequence) and others:
            raise UsageError(
                "{--readout-ratio}, {--fps}, {--at}, {--model} and {--fallback} are for a photo with neighbours: "
                "name one with {--before} or {--after}, or several with {--sequence}"
            )
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"{{--at}} must lie between -1 and 1 frame intervals, got {self.at:g}")

    def __bool__(self) -> bool:
        return self.before is not None or self.after is not None
