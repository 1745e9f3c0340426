"""What can be asked for: one frozen value for each kind of question, checked once, when it is made.

The Python API, the command line, batches and their workers pass these values on as they are. A field's ``help`` is what
``unshutter COMMAND --help`` prints; its flag is its name with dashes. To add an option, add a field here and use it
where the work is done.

Nothing here imports NumPy: a photo is being decoded before that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from unshutter.errors import UsageError
from unshutter.geometry.readout import Readout

DEFAULT_ESTIMATOR = "segment-manhattan"
MOST_ROLL_DEG, MOST_TILT_DEG = 45, 90  # beyond, up is no longer up
_LONGEST_TIMEOUT_S = 86_400  # a day
MAX_PIXELS = 1_000_000_000  # of a photo, unless a user allows more

Reference = Literal["first", "middle", "last"]
Edges = Literal["keep", "crop", "fill", "borrow"]
FrameModel = Literal["dense"]
PictureFormat = Literal["jpeg", "png", "webp", "tiff", "avif"]
Subsampling = Literal["4:4:4", "4:2:0"]


def option(default: Any, help: str, **more: Any) -> Any:
    """A field with its help; ``more`` is for the command line (cli/arguments.py)."""
    return field(default=default, metadata={"help": help, **more})


@dataclass(frozen=True)
class Camera:
    """What is known of the camera beside the photo itself.

    Attributes:
        readout: direction in which the stored pixels were read; ``auto`` is top-to-bottom.
        focal_px: focal length [px of the full-size photo]; None: EXIF's, else a guess.
        roll_deg: how far the camera was turned clockwise, as its user sees it, from upright; None: unknown.
        tilt_deg: how far it looked up, -90 is straight down; None: unknown.

    Raises:
        UsageError: an unknown direction, a focal length that is not positive, an angle out of range.
    """

    readout: str = option(
        "auto",
        "Direction in which the sensor was read, if an editor has turned the file. Default: top-to-bottom.",
        choices=("auto", *Readout),
    )
    focal_px: float | None = option(
        None,
        "Focal length in px of the photo, for methods that use it. Default: EXIF's, else 0.85 (width + height).",
    )
    roll_deg: float | None = option(
        None, "How far the camera was turned clockwise from upright, where you know it, for methods that use it."
    )
    tilt_deg: float | None = option(None, "How far it looked up, where you know it; -90 is straight down.")

    def __post_init__(self) -> None:
        Readout.parse(self.readout)
        if self.focal_px is not None and not 0 < self.focal_px < math.inf:
            raise UsageError(f"the focal length must be positive, got {self.focal_px:g} px")
        for name, angle, most in (("roll", self.roll_deg, MOST_ROLL_DEG), ("tilt", self.tilt_deg, MOST_TILT_DEG)):
            if angle is not None and not -most <= angle <= most:
                raise UsageError(f"the camera's {name} must lie between -{most} and {most} degrees, got {angle:g}")

    @property
    def direction(self) -> Readout:
        """The readout direction, ``auto`` resolved."""
        return Readout.parse(self.readout)

    def check_unused(self) -> None:
        """Raises UsageError where focal length, roll or tilt are given although no motion is to be found."""
        if not (self.focal_px is self.roll_deg is self.tilt_deg is None):
            raise UsageError("focal length, roll and tilt are for finding a motion: leave them out when it is given")


@dataclass(frozen=True)
class Find:
    """How a photo's motion is found.

    Attributes:
        estimator: name of the method, or NAME@FILE with weights of your own.
        camera: what is known of the camera.
    """

    estimator: str = option(DEFAULT_ESTIMATOR, "Method that finds the camera's motion; `unshutter models` lists them.")
    camera: Camera = field(default_factory=Camera)


@dataclass(frozen=True)
class Undo:
    """How a motion is undone.

    Attributes:
        reference: row at whose moment the picture is taken; None: the motion's own.
        strength: 0 (nothing) to 1 (the whole motion).
        edges: ``keep`` leaves places that the photo did not see black (and transparent where it has alpha),
            ``crop`` cuts to the largest rectangle of the same aspect without them, ``fill`` repeats the edge,
            ``borrow`` takes them from the photo's neighbours.

    Raises:
        UsageError: a value that is none of its choices.
    """

    reference: Reference | None = option(None, "Row at whose moment the picture is taken. Default: first.")
    strength: float = option(1.0, "How much of the motion to undo, 0 to 1.")
    edges: Edges = option(
        "keep",
        "Places the photo did not see: keep them empty, crop them away, fill them with the nearest colour, or borrow "
        "them from the frames of --before and --after.",
    )

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UsageError(f"strength must lie between 0 and 1, got {self.strength:g}")
        if self.edges not in get_args(Edges):
            raise UsageError(f"unknown edges '{self.edges}': choose keep, crop, fill or borrow")
        if self.reference not in (None, *get_args(Reference)):
            raise UsageError(f"unknown reference row '{self.reference}': choose first, middle or last")


@dataclass(frozen=True)
class Save:
    """How a picture is written.

    Attributes:
        format: of the file; None: the photo's own, AVIF for HEIC, 16-bit TIFF for raw files.
        quality: of JPEG, WebP and AVIF, 1 to 100; None: like the original.
        subsampling: of the chroma of JPEG and AVIF; None: like the original.

    Raises:
        UsageError: a value that is none of its choices.
    """

    format: PictureFormat | None = option(
        None, "Format of the results. Default: that of each photo; AVIF for HEIC, 16-bit TIFF for raw files."
    )
    quality: int | None = option(None, "Quality of JPEG, WebP and AVIF, 1 to 100. Default: like the original.")
    subsampling: Subsampling | None = option(
        None, "Colour at full (4:4:4) or half (4:2:0) resolution in JPEG and AVIF. Default: like the original."
    )

    def __post_init__(self) -> None:
        if self.quality is not None and not 1 <= self.quality <= 100:
            raise UsageError(f"quality must lie between 1 and 100, got {self.quality}")
        if self.subsampling not in (None, *get_args(Subsampling)):
            choices = ", ".join(get_args(Subsampling))
            raise UsageError(f"unknown subsampling '{self.subsampling}': choose one of {choices}")
        if self.format not in (None, *get_args(PictureFormat)):
            choices = ", ".join(get_args(PictureFormat))
            raise UsageError(f"unknown picture format '{self.format}': choose one of {choices}")


@dataclass(frozen=True)
class Clock:
    """How fast frames were taken and read out.

    Attributes:
        readout_ratio: time in which a frame is read out / time from frame to frame.
        readout_ms, fps: the same by readout time [ms] and frames per second.

    Raises:
        UsageError: both ways at once, half of one, or numbers that cannot be.
    """

    readout_ratio: float | None = option(
        None, "Time in which a frame is read out / time from frame to frame, 0 to 1. --sequence finds it where it can."
    )
    readout_ms: float | None = option(None, "Instead of the ratio: time in which a frame is read out.", metavar="MS")
    fps: float | None = option(None, "With --readout-ms: frames taken in a second.", metavar="N")

    def __post_init__(self) -> None:
        if self.readout_ratio is not None and (self.readout_ms is not None or self.fps is not None):
            raise UsageError("say either --readout-ratio, or --readout-ms with --fps")
        if (self.readout_ms is None) != (self.fps is None):
            raise UsageError("--readout-ms and --fps go together")
        for each in (self.readout_ms, self.fps):
            if each is not None and not 0 < each < math.inf:
                raise UsageError(f"readout time and frame rate must be positive, got {each:g}")
        if self.is_known and not 0 < self.ratio <= 1:
            raise UsageError(
                "the readout ratio (readout time / time from frame to frame) must be above 0 and at most 1, "
                f"got {self.ratio:g}"
            )

    @property
    def is_known(self) -> bool:
        """Whether the ratio was given, in one way or the other."""
        return self.readout_ratio is not None or self.readout_ms is not None

    @property
    def ratio(self) -> float:
        """Readout time / frame interval.

        Raises:
            UsageError: it was not given.
        """
        if self.readout_ratio is not None:
            return self.readout_ratio
        if self.readout_ms is None or self.fps is None:
            raise UsageError(
                "say how long a frame is read out: --readout-ratio (readout time / time from frame to frame), or "
                "--readout-ms with --fps"
            )
        return self.readout_ms * self.fps / 1000


@dataclass(frozen=True)
class Neighbours:
    """Frames that were taken just before and after the photo.

    Attributes:
        before, after: their files.
        sequence: whether the photos are frames of one camera, in order, each the neighbour of the next.
        clock: how fast frames were taken and read out.
        at: moment of the picture, in frame intervals from the photo's first row; None: the reference row's.
        model: how motion is described.

    Raises:
        UsageError: options for neighbours without any.
    """

    before: Path | None = option(None, "Frame taken just before the photo, by the same camera: says how it moved.")
    after: Path | None = option(None, "Frame taken just after the photo; one of the two is enough.")
    sequence: bool = option(
        False,
        "The photos are frames of one camera at even intervals, in the order given (in folders: of their names). Their "
        "motions are found from each other; the readout ratio, too, where it is not given.",
    )
    clock: Clock = field(default_factory=Clock)
    at: float | None = option(
        None,
        "Moment of the picture instead of a reference row, in frame intervals from the photo's first row: with --after,"
        " 0.5 lies halfway to the next frame.",
    )
    model: FrameModel | None = option(None, "How the motion is described. dense: near and far move differently.")

    def __post_init__(self) -> None:
        if self.sequence and (self or self.at is not None or self.model == "dense"):
            raise UsageError("--sequence is for the camera's motion: leave out --before, --after, --at and --model")
        if not (self or self.sequence) and (self.clock.is_known or self.at is not None or self.model is not None):
            raise UsageError(
                "--readout-ratio, --readout-ms, --fps, --at and --model are for a photo with neighbours: "
                "name one with --before or --after, or several with --sequence"
            )
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"--at must lie between -1 and 1 frame intervals, got {self.at:g}")

    def __bool__(self) -> bool:
        return self.before is not None or self.after is not None


@dataclass(frozen=True)
class Rectify:
    """What is done to a photo: its motion found or given, undone, and the picture written.

    Attributes:
        find: how the motion is found.
        motion: motion file to undo instead; None: the motion is found.
        undo: how it is undone.
        save: how the picture is written.
        neighbours: frames before and after that say how the camera moved; without them, the photo alone does.

    Raises:
        UsageError: a motion, and beside it a focal length, roll or tilt, which only serve to find one; or neighbours
            and what does not go with them.
    """

    find: Find = field(default_factory=Find)
    motion: Path | None = None
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    neighbours: Neighbours = field(default_factory=Neighbours)

    def __post_init__(self) -> None:
        if self.motion is not None or self.neighbours:
            self.find.camera.check_unused()
        if self.neighbours.sequence and not (self.find.camera.roll_deg is self.find.camera.tilt_deg is None):
            raise UsageError("roll and tilt are for single photos: leave them out with --sequence")
        if (self.neighbours or self.neighbours.sequence) and self.motion is not None:
            raise UsageError("--before, --after and --sequence are for finding a motion: leave out --motion")
        if self.neighbours and self.neighbours.at is not None and self.undo.reference is not None:
            raise UsageError("--at and --reference both say the moment of the picture: choose one of them")
        if self.neighbours and self.undo.strength != 1:
            raise UsageError("with neighbours, the whole motion is undone: leave out --strength")
        if self.undo.edges == "borrow" and not self.neighbours:
            raise UsageError("--edges borrow takes from neighbours: name one with --before or --after")

    @property
    def find_alone(self) -> Find | None:
        """How the motion is found from each photo alone; None: it is not."""
        return None if self.motion is not None or self.neighbours or self.neighbours.sequence else self.find


@dataclass(frozen=True)
class Run:
    """How a command works through its photos, which changes nothing about its results.

    Attributes:
        overwrite: whether outputs that exist may be replaced; originals never are.
        jobs: processes on this machine; None: this one.
        scheduler: address of a Dask scheduler; None: none.
        dry_run: only say what would be done.
        json_log: file to add what happens to, one JSON object a line.
        max_pixels: photos with more are refused.
        timeout: time after which a photo is given up [s]; None: half an hour where processes do the work, else no
            limit. With a limit, but without ``jobs``, one other process does the work: a decoder that hangs cannot be
            stopped in this one.

    Raises:
        UsageError: a number below 1, both ``jobs`` and ``scheduler``, or a time limit for a scheduler's workers.
    """

    overwrite: bool = option(False, "Replace outputs that exist already, finished ones too.")
    jobs: int | None = option(None, "Work in so many processes, each on one processor. Default: in this one.")
    scheduler: str | None = option(
        None, "Address (tcp://HOST:PORT) of a Dask scheduler whose workers do the work (needs the extra `dask`)."
    )
    dry_run: bool = option(False, "Only say what would be done.")
    json_log: Path | None = option(None, "Add what happens to this file, one JSON object a line.")
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    timeout: float | None = option(
        None,
        "Give up on a photo that takes longer, and go on. Default: 1800 with --jobs, else none.",
        metavar="SECONDS",
    )

    def __post_init__(self) -> None:
        if self.timeout is not None and not 0 < self.timeout <= _LONGEST_TIMEOUT_S:
            raise UsageError(f"--timeout must lie between 0 and {_LONGEST_TIMEOUT_S} s, got {self.timeout:g}")
        if self.timeout is not None and self.scheduler is not None:
            raise UsageError("--timeout is for this machine: the workers of a scheduler have limits of their own")
        if self.jobs is not None and self.jobs < 1:
            raise UsageError(f"--jobs must be at least 1, got {self.jobs}")
        if self.max_pixels < 1:
            raise UsageError(f"--max-pixels must be at least 1, got {self.max_pixels}")
        if self.jobs is not None and self.scheduler is not None:
            raise UsageError("--jobs is for this machine, --scheduler for a cluster: choose one of them")


@dataclass(frozen=True)
class Synthesize:
    """How rolling-shutter pictures are made from undistorted photos.

    Attributes:
        per_photo: pictures made from each photo.
        seed: 0 or more.
        motion: ``quadratic`` or ``trajectory`` (synthesis/row_motions.py).
        trajectory: NPZ file (synthesis/rotation_log.py); for ``trajectory`` only, which needs it and the next two.
        readout_ms: time in which a picture is read out [ms].
        focal_px: focal length [px of the finished picture].
        size: side of the finished pictures [px].
        canvas: side of the canvas [px].

    Raises:
        UsageError: a number that cannot be, or options that do not fit together.
    """

    per_photo: int = option(1, "Pictures made from each photo. Default: 1.")
    seed: int = option(0, "Same seed, same pictures. Default: 0.")
    motion: Literal["quadratic", "trajectory"] = option(
        "quadratic",
        "quadratic: the random motions of Rengarajan 2017. trajectory: windows of a recorded camera motion.",
    )
    trajectory: Path | None = option(
        None, "NPZ file with t_s and gyro_rad_s, or t_s, position_m and quaternion_wxyz.", metavar="FILE"
    )
    readout_ms: float | None = option(None, "Time from the first to the last row, for trajectories.", metavar="MS")
    focal_px: float | None = option(None, "Focal length in px of the finished picture, for trajectories.", metavar="PX")
    size: int = option(256, "Side of the finished pictures in px. Default: 256.", metavar="PX")
    canvas: int = option(
        356, "Side of the picture that is distorted before its middle is cut out, in px. Default: 356.", metavar="PX"
    )

    def __post_init__(self) -> None:
        if self.per_photo < 1 or self.seed < 0:
            raise UsageError(
                f"needs at least one picture per photo and a seed of 0 or more, got {self.per_photo} and {self.seed}"
            )
        recorded = (self.trajectory, self.readout_ms, self.focal_px)
        if self.motion == "quadratic" and any(value is not None for value in recorded):
            raise UsageError("trajectory, readout and focal length are for --motion trajectory only")
        if self.motion == "trajectory" and None in recorded:
            raise UsageError("--motion trajectory needs --trajectory, --readout-ms and --focal-px")
        if self.motion not in ("quadratic", "trajectory"):
            raise UsageError(f"unknown motion '{self.motion}': choose quadratic or trajectory")
