"""What can be asked for: one frozen value for each kind of question, checked once, when it is made.

The Python API, the command line, batches and their workers pass these values on as they are. A field's ``help`` is what
``unshutter COMMAND --help`` prints; its flag is its name with dashes. To add an option, add a field here and use it
where the work is done.

Nothing here imports NumPy: a photo is being decoded before that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from unshutter.errors import UsageError
from unshutter.geometry.readout import Readout

DEFAULT_ESTIMATOR = "segment-manhattan"
MOST_ROLL_DEG, MOST_TILT_DEG = 45, 90  # beyond, up is no longer up
_LONGEST_TIMEOUT_S = 86_400  # a day
MIN_CONFIDENCE = 0.02  # of a motion that is undone, unless a user says otherwise
LEAST_AUTO_CROP = 0.8  # of a photo's area: automatic edges do not crop away more than a fifth
MAX_PIXELS = 1_000_000_000  # of a photo, unless a user allows more

Reference = Literal["first", "middle", "last"]
Edges = Literal["auto", "keep", "crop", "fill", "borrow"]
FrameModel = Literal["camera", "dense"]
PictureFormat = Literal["jpeg", "png", "webp", "tiff", "avif"]
Subsampling = Literal["4:4:4", "4:2:0"]


def option(default: Any, help: str, **more: Any) -> Any:
    """A field with its help; ``more`` is for the command line (cli/arguments.py)."""
    return field(default=default, metadata={"help": help, **more})


def check_time(name: str, time: float | None, unit: str) -> None:
    """Raises UsageError where this is neither None nor a positive time."""
    if time is not None and not 0 < time < math.inf:
        raise UsageError(f"the {name} must take a positive time, got {time:g} {unit}")


@dataclass(frozen=True)
class Camera:
    """What you know of the camera, beside the photo itself.

    Attributes:
        readout: direction in which the stored pixels were read; ``auto`` is top-to-bottom, unless the photo shows that
            its pixels were turned.
        focal_px: focal length [px of the full-size photo]; None: EXIF's, else a guess.
        roll_deg: how far the camera was turned clockwise, as its user sees it, from upright; None: unknown.
        tilt_deg: how far it looked up, -90 is straight down; None: unknown.
        exposure_s: how long each line was exposed [s]; None: as EXIF says, if it does.
        readout_ms: time from the first line read to the last [ms]; None: as is usual for the kind of camera.
        moving: whether the camera was on the move (in a train, on a car, in the air), so that motion is likely.

    Raises:
        UsageError: an unknown direction, a focal length or time that is not positive, an angle out of range.
    """

    readout: str = option(
        "auto",
        "Direction in which the sensor was read, if an editor has turned the file. Default: what the photo shows, else "
        "top-to-bottom.",
        choices=("auto", *Readout),
    )
    focal_px: float | None = option(
        None,
        "Focal length in px of the photo, for methods that use it. Default: EXIF's, else 0.85 (width + height).",
    )
    roll_deg: float | None = option(
        None, "How far the camera was turned clockwise from upright, if you know it, for methods that use it."
    )
    tilt_deg: float | None = option(None, "How far the camera looked up, if you know it; -90 is straight down.")
    exposure_s: float | None = option(
        None, "Exposure time of the photo, in seconds. Default: EXIF's.", metavar="SECONDS"
    )
    readout_ms: float | None = option(
        None,
        "Readout time, from the first row to the last, in milliseconds. Default: what is usual for such cameras.",
        metavar="MS",
    )
    moving: bool = option(False, "The camera was on the move: in a train, on a car, on a drone.")

    def __post_init__(self) -> None:
        Readout.parse(self.readout)
        if self.focal_px is not None and not 0 < self.focal_px < math.inf:
            raise UsageError(f"the focal length must be positive, got {self.focal_px:g} px")
        for name, time, unit in (("exposure", self.exposure_s, "s"), ("readout", self.readout_ms, "ms")):
            check_time(name, time, unit)
        for name, angle, most in (("roll", self.roll_deg, MOST_ROLL_DEG), ("tilt", self.tilt_deg, MOST_TILT_DEG)):
            if angle is not None and not -most <= angle <= most:
                raise UsageError(f"the camera's {name} must lie between -{most} and {most} degrees, got {angle:g}")

    @property
    def direction(self) -> Readout:
        """The readout direction, ``auto`` resolved."""
        return Readout.parse(self.readout)

    def check_unused(self) -> None:
        """Raises UsageError where more than the readout direction is given although no motion is to be found."""
        if self != Camera(self.readout):
            raise UsageError(
                "focal length, roll, tilt, exposure, readout time and --moving are for finding a motion: "
                "leave them out when you give one"
            )


@dataclass(frozen=True)
class Find:
    """How a photo's motion is found.

    Attributes:
        estimator: name of the method, or NAME@FILE with weights of your own.
        camera: what is known of the camera.
    """

    estimator: str = option(DEFAULT_ESTIMATOR, "Method that finds the camera's motion; `unshutter models` lists them.")
    camera: Camera = field(default_factory=Camera)


def check_edges(edges: str) -> None:
    """Raises UsageError where nothing is known of such edges, or they need more than the photo."""
    if edges not in get_args(Edges) or edges == "borrow":
        raise UsageError(f"unknown edges '{edges}': choose auto, keep, crop or fill")


@dataclass(frozen=True)
class Undo:
    """How a motion is undone.

    Attributes:
        reference: row at whose moment the picture is taken; None: the motion's own.
        strength: 0 (nothing) to 1 (the whole motion).
        edges: ``keep`` leaves places that the photo did not see black (and transparent where it has alpha),
            ``crop`` cuts to the largest rectangle of the same aspect without them, ``fill`` repeats the edge;
            ``auto`` crops where that leaves at least 80 % of the area, else keeps; ``borrow`` takes them from the
            photo's neighbours.
        min_confidence: a photo whose motion is less sure is left as it is; 0 leaves none. Motions without a confidence
            are undone.

    Raises:
        UsageError: a value that is none of its choices.
    """

    reference: Reference | None = option(None, "Row at whose moment the picture is taken. Default: first.")
    strength: float = option(1.0, "How much of the motion to undo, 0 to 1.")
    edges: Edges = option(
        "auto",
        "Places the photo did not see: keep them empty, crop them away, or fill them with the nearest colour. auto "
        "crops if that leaves at least 80 % of the photo, and keeps them otherwise and with --masks or --save-motion. "
        "borrow takes them from the frames of --before and --after. Default: auto.",
    )
    min_confidence: float = option(
        MIN_CONFIDENCE,
        "Leave a photo as it is if its motion is less sure than this; 0 switches this off. Default: "
        f"{MIN_CONFIDENCE:g}.",
    )

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UsageError(f"strength must lie between 0 and 1, got {self.strength:g}")
        if not 0 <= self.min_confidence <= 1:
            raise UsageError(f"the least confidence must lie between 0 and 1, got {self.min_confidence:g}")
        if self.edges != "borrow":
            check_edges(self.edges)
        if self.reference not in (None, *get_args(Reference)):
            raise UsageError(f"unknown reference row '{self.reference}': choose first, middle or last")

    def keeping_coordinates(self) -> Undo:
        """The same, but that automatic edges are kept: for results of which coordinates are wanted."""
        return replace(self, edges="keep") if self.edges == "auto" else self

    def of_given_motion(self) -> Undo:
        """The same for a motion that the user gives, which is undone however sure its estimator was.

        Raises:
            UsageError: a least confidence is asked for, too.
        """
        if self.min_confidence not in (0, MIN_CONFIDENCE):
            raise UsageError("a given motion is undone whatever its confidence: leave out the least confidence")
        return replace(self, min_confidence=0)


@dataclass(frozen=True)
class Save:
    """How a picture is written.

    Attributes:
        format: of the file; None: the photo's own, AVIF for HEIC, 16-bit TIFF for raw files.
        quality: of JPEG, WebP and AVIF, 1 to 100; None: like the original.
        subsampling: of the chroma of JPEG and AVIF; None: like the original.
        keep_times: whether the file gets the access and modification time of the original.
        only_changed: photos that are left as they are are not written.
        keep_names: results get the names of their photos; only into another folder.

    Raises:
        UsageError: a value that is none of its choices.
    """

    format: PictureFormat | None = option(
        None, "Format of the results. Default: the photo's own; AVIF for HEIC, 16-bit TIFF for raw files."
    )
    quality: int | None = option(None, "Quality of JPEG, WebP and AVIF, 1 to 100. Default: like the original.")
    subsampling: Subsampling | None = option(
        None, "Colour at full (4:4:4) or half (4:2:0) resolution in JPEG and AVIF. Default: like the original."
    )
    keep_times: bool = option(False, "Give each result the access and modification time of its photo.")
    only_changed: bool = option(False, "Write only photos that change. Default: copy the others.")
    keep_names: bool = option(False, "Give results the names of their photos, in the folder that --output names.")

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
        UsageError: both ways at once, or numbers that cannot be.
    """

    readout_ratio: float | None = option(
        None, "Time to read out a frame / time from frame to frame, 0 to 1. --sequence finds it if it can."
    )
    fps: float | None = option(None, "Frames per second; with --readout-ms, instead of the ratio.", metavar="N")
    readout_ms: float | None = None  # a flag of the camera's

    def __post_init__(self) -> None:
        if self.readout_ratio is not None and self.fps is not None:
            raise UsageError("say either --readout-ratio, or --readout-ms with --fps")
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
        return self.readout_ratio is not None or (self.readout_ms is not None and self.fps is not None)

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
                "say how long a readout takes: --readout-ratio (readout time / time from frame to frame), or "
                "--readout-ms with --fps"
            )
        return self.readout_ms * self.fps / 1000


def model_for(model: FrameModel | None, at: float | None, undo: Undo) -> FrameModel | None:
    """How motion is described: as asked for, else as other options need it; None: as the frames say.

    Raises:
        UsageError: an unknown model, or options of which no one model can do all.
    """
    if model not in (None, *get_args(FrameModel)):
        raise UsageError(f"unknown model '{model}': choose camera or dense")
    dense, camera = at is not None or undo.edges == "borrow", undo.strength != 1
    if dense and (camera or model == "camera"):
        wrong = "--model camera" if model == "camera" else "--strength"
        raise UsageError(f"--at and --edges borrow are for --model dense: leave out {wrong}")
    if camera and model == "dense":
        raise UsageError("--model dense undoes the whole motion: leave out --strength")
    return "dense" if dense else "camera" if camera else model


@dataclass(frozen=True)
class Neighbours:
    """Frames taken just before and after the photo.

    Attributes:
        before, after: their files.
        sequence: whether the photos are frames of one camera, in order, each the neighbour of the next.
        clock: how fast frames were taken and read out.
        at: moment of the picture, in frame intervals from the photo's first row; None: the reference row's.
        model: how motion is described; None: as the frames bear out.
        fallback: whether the photo alone is asked where its neighbours say nothing.

    Raises:
        UsageError: options for neighbours without any.
    """

    before: Path | None = option(None, "Frame taken just before the photo by the same camera; shows what moved.")
    after: Path | None = option(None, "Frame taken just after the photo; one of the two is enough.")
    sequence: bool = option(
        False,
        "The photos are frames of one camera at even intervals, in the order given (in folders: by name). Finds their "
        "motions from each other, and the readout ratio, too, if you do not give it.",
    )
    clock: Clock = field(default_factory=Clock)
    at: float | None = option(
        None,
        "Moment of the picture, instead of a reference row, in frame intervals from the photo's first row: with "
        "--after, 0.5 is halfway to the next frame.",
    )
    model: FrameModel | None = option(
        None,
        "camera: one motion for the whole picture. dense: near and far move differently. Default: the one that fits "
        "the frames.",
    )
    fallback: bool = option(
        False, "If the neighbours show no motion, use the photo alone. Default: leave the photo as it is."
    )

    def __post_init__(self) -> None:
        if self.sequence and self:
            raise UsageError("--sequence already gives each photo its neighbours: leave out --before and --after")
        others = self.clock != Clock() or self.at is not None or self.model is not None or self.fallback
        if not (self or self.sequence) and others:
            raise UsageError(
                "--readout-ratio, --fps, --at, --model and --fallback are for a photo with neighbours: "
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
        UsageError: a motion, and beside it a focal length, roll, tilt or least confidence, which are for finding one;
            neighbours, and what does not go with them.
    """

    find: Find = field(default_factory=Find)
    motion: Path | None = None
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    neighbours: Neighbours = field(default_factory=Neighbours)

    def __post_init__(self) -> None:
        if self.motion is not None:
            self.find.camera.check_unused()
            object.__setattr__(self, "undo", self.undo.of_given_motion())
        if self.neighbours or self.neighbours.sequence:
            self._check_neighbours()
        elif self.undo.edges == "borrow":
            raise UsageError("--edges borrow needs a neighbour: name one with --before or --after")
        if self.neighbours.sequence:
            object.__setattr__(self, "undo", self.undo.keeping_coordinates())

    def _check_neighbours(self) -> None:
        camera, given = self.find.camera, self.neighbours
        if self.motion is not None:
            raise UsageError("--before, --after and --sequence are for finding a motion: leave out --motion")
        if replace(camera, readout_ms=None, focal_px=None) != Camera(camera.readout) and not given.fallback:
            raise UsageError("roll, tilt, exposure and --moving are for single photos: leave them out")
        if given.at is not None and self.undo.reference is not None:
            raise UsageError("--at and --reference both set the moment of the picture: choose one")
        if (camera.readout_ms is None) != (given.clock.fps is None) and not given.fallback:
            raise UsageError("--readout-ms and --fps go together: what counts is their product")
        _ = self.clock  # raises where the numbers cannot be
        model_for(given.model, given.at, self.undo)

    @property
    def clock(self) -> Clock:
        """How fast the neighbours were taken and read out."""
        return replace(self.neighbours.clock, readout_ms=self.find.camera.readout_ms)

    @property
    def find_alone(self) -> Find | None:
        """How the motion is found from each photo alone; None: it is not."""
        return None if self.motion is not None or self.neighbours or self.neighbours.sequence else self.find


@dataclass(frozen=True)
class Run:
    """How a command works through its photos; none of this changes the results.

    Attributes:
        overwrite: whether outputs that exist may be replaced; originals never are.
        jobs: processes on this machine; None: this one.
        scheduler: address of a Dask scheduler; None: none.
        dry_run: only say what would be done.
        json_log: file to add what happens to, one JSON object a line.
        preview: picture to make of all photos, before and after side by side.
        max_pixels: photos with more are refused.
        timeout: time after which a photo is given up [s]; None: half an hour where processes do the work, else no
            limit. With a limit, but without ``jobs``, one other process does the work: a decoder that hangs cannot be
            stopped in this one.

    Raises:
        UsageError: a number below 1, both ``jobs`` and ``scheduler``, or a time limit for a scheduler's workers.
    """

    overwrite: bool = option(False, "Replace outputs that exist already, finished ones too.")
    jobs: int | None = option(None, "Number of processes, each on one processor. Default: this one alone.")
    scheduler: str | None = option(
        None, "Address (tcp://HOST:PORT) of a Dask scheduler; its workers do the work (needs the extra `dask`)."
    )
    dry_run: bool = option(False, "Say what would be done, and write nothing.")
    json_log: Path | None = option(None, "Append what happens to this file, one JSON object a line.")
    preview: Path | None = option(
        None,
        "Also make this picture: before and after, side by side; for a folder, a sheet of all its photos.",
        metavar="FILE",
    )
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    timeout: float | None = option(
        None,
        "Give up on a photo that takes longer, and go on with the next. Default: 1800 with --jobs, else none.",
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
            raise UsageError("--jobs is for this machine, --scheduler for a cluster: choose one")


@dataclass(frozen=True)
class Synthesize:
    """How rolling-shutter pictures are made from undistorted photos.

    Attributes:
        per_photo: pictures made from each photo.
        seed: 0 or more.
        motion: ``quadratic`` or ``trajectory`` (synthesis/row_motions.py).
        trajectory: NPZ file (synthesis/rotation_log.py); for ``trajectory`` only, which needs it and the next two.
        readout_ms: time in which a picture is read out [ms]; needed by ``trajectory`` and by an exposure.
        exposure_s: how long each row is exposed [s], which blurs it by the motion and is written into EXIF; None: for
            no time.
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
    readout_ms: float | None = option(
        None, "Time from the first to the last row, for trajectories and exposures.", metavar="MS"
    )
    exposure_s: float | None = option(
        None,
        "Exposure time of each row, which its own motion blurs; written into EXIF. Default: sharp.",
        metavar="SECONDS",
    )
    focal_px: float | None = option(None, "Focal length in px of the finished picture, for trajectories.", metavar="PX")
    size: int = option(256, "Side of the finished pictures in px. Default: 256.", metavar="PX")
    canvas: int = option(
        356, "Side in px of the picture that is distorted; its middle is cut out. Default: 356.", metavar="PX"
    )

    def __post_init__(self) -> None:
        if self.per_photo < 1 or self.seed < 0:
            raise UsageError(
                f"--per-photo must be at least 1 and --seed at least 0, got {self.per_photo} and {self.seed}"
            )
        for name, time, unit in (("exposure", self.exposure_s, "s"), ("readout", self.readout_ms, "ms")):
            check_time(name, time, unit)
        if self.exposure_s is not None and self.readout_ms is None:
            raise UsageError("--exposure-s needs --readout-ms: the blur of a row depends on both")
        if self.motion == "quadratic" and not (self.trajectory is self.focal_px is None):
            raise UsageError("--trajectory and --focal-px are for --motion trajectory only")
        if self.motion == "quadratic" and self.exposure_s is None and self.readout_ms is not None:
            raise UsageError("--readout-ms is for --motion trajectory and --exposure-s only")
        if self.motion == "trajectory" and None in (self.trajectory, self.readout_ms, self.focal_px):
            raise UsageError("--motion trajectory needs --trajectory, --readout-ms and --focal-px")
        if self.motion not in ("quadratic", "trajectory"):
            raise UsageError(f"unknown motion '{self.motion}': choose quadratic or trajectory")

    @property
    def exposure(self) -> float:
        """How long a row is exposed, in times of the readout; 0 without an exposure."""
        if self.exposure_s is None or self.readout_ms is None:
            return 0.0
        return 1000 * self.exposure_s / self.readout_ms
