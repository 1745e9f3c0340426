"""Groups the options of photo_options.py for the commands, and adds how a command works through its photos."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from unshutter.errors import UsageError
from unshutter.options.fields import check_count, option, positional
from unshutter.options.photo_options import Camera, Find, Neighbours, Reference, Save, Undo, model_for
from unshutter.readout_time import ReadoutRatio


@dataclass(frozen=True)
class Rectify:
    """What is done to a photo: its motion found or given, undone, and the picture written."""

    find: Find = field(default_factory=Find)  # how the motion is found
    # motion file to undo; None: the motion is found
    motion: Path | None = field(default=None, metadata={"names": "input"})
    undo: Undo = field(default_factory=Undo)  # how the motion is undone
    save: Save = field(default_factory=Save)  # how the picture is written
    # frames before and after that show how the camera moved; without them, only the photo is used
    neighbours: Neighbours = field(default_factory=Neighbours)

    def settled(self) -> Rectify:
        """Returns the options after applying the consequences that some have for others.

        A given motion is undone regardless of its confidence, results of a sequence keep their coordinates, and a least
        confidence of 0 accepts the likeliest motion.
        """
        find = self.find
        undo = self.undo
        if self.motion is not None:
            undo = undo.at_any_confidence()
        if self.neighbours.sequence:
            undo = undo.keeping_coordinates()
        if self.find_alone is not None or self.neighbours.fallback:
            find = find.for_least_confidence(undo.min_confidence)
        return replace(self, find=find, undo=undo)

    def __post_init__(self) -> None:
        if self.motion is not None:
            self.find.check_unused()
        if self.neighbours or self.neighbours.sequence:
            self._check_neighbours()
        elif self.undo.edges == "borrow":
            raise UsageError("{--edges} borrow needs a neighbour: name one with {--before} or {--after}")

    def _check_neighbours(self) -> None:
        camera = self.find.camera
        neighbours = self.neighbours
        if self.motion is not None:
            raise UsageError("{--before}, {--after} and {--sequence} are for finding a motion: leave out {--motion}")
        alone = replace(camera, readout_ms=None, focal_px=None) != Camera(camera.readout)
        if (alone or self.find.candidate is not None) and not neighbours.fallback:
            raise UsageError(
                "{--roll-deg}, {--tilt-deg}, {--exposure-s} and {--moving} are for single photos: leave them out"
            )
        if self.undo.upright:
            raise UsageError(
                "{--upright} is for single photos: leave it out, or {--before}, {--after} and {--sequence}"
            )
        if neighbours.at is not None and self.undo.reference is not None:
            raise UsageError("{--at} and {--reference} both set the moment of the picture: choose one")
        if (camera.readout_ms is None) != (neighbours.clock.fps is None) and not neighbours.fallback:
            raise UsageError("give both {--readout-ms} and {--fps}, or neither")
        _ = self.stated_ratio  # raises for impossible numbers
        model_for(neighbours.model, neighbours.at, self.undo)

    @property
    def stated_ratio(self) -> ReadoutRatio | None:
        """The stated readout time of neighbouring frames, as a share of the time between them; None if not stated."""
        return replace(self.neighbours.clock, readout_ms=self.find.camera.readout_ms).stated_ratio

    @property
    def find_alone(self) -> Find | None:
        """Options for finding the motion from each photo alone; None if it is not found that way."""
        return None if self.motion is not None or self.neighbours or self.neighbours.sequence else self.find


_LONGEST_TIMEOUT_S = 86_400  # one day
MAX_PIXELS = 1_000_000_000  # per photo, unless the user allows more


@dataclass(frozen=True)
class Run:
    """How a command works through its photos; none of this changes the results."""

    overwrite: bool = option(False, "Replace existing outputs, including finished ones.")
    jobs: int | None = option(None, "Number of processes, each on one processor. Default: a single process.")
    scheduler: str | None = option(
        None,
        "Address (tcp://HOST:PORT) of a Dask scheduler; its workers do the work (needs the extra `dask`).",
        names="word",
    )
    verbose: bool = option(
        False, "Print all details of each photo of a folder. Default: only the most important one.", short="-v"
    )
    dry_run: bool = option(False, "List what would be done without writing anything.")
    json_log: Path | None = option(
        None, "Append a log of the run to this file, one JSON object per line.", names="output"
    )
    manifest: str | None = option(
        None,
        "Folder for the list of finished results (unshutter-manifest.jsonl). Default: that of the results.",
        metavar="FOLDER",
        names="results",
    )
    preview: Path | None = option(
        None,
        "Also write before and after, side by side; for a folder, a contact sheet of all its photos.",
        metavar="FILE",
        names="output",
    )
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    timeout: float | None = option(
        None,
        "Give up on a photo that takes longer. Default: 1800 with {--jobs}, else none.",
        metavar="SECONDS",
    )

    def __post_init__(self) -> None:
        if self.timeout is not None and not 0 < self.timeout <= _LONGEST_TIMEOUT_S:
            raise UsageError(f"{{--timeout}} must lie between 0 and {_LONGEST_TIMEOUT_S} s, got {self.timeout:g}")
        if self.timeout is not None and self.scheduler is not None:
            raise UsageError("{--timeout} does not apply to the workers of a scheduler: leave it out")
        check_count("jobs", self.jobs)
        check_count("max-pixels", self.max_pixels)
        if self.jobs is not None and self.scheduler is not None:
            raise UsageError("{--jobs} is for this machine, {--scheduler} for a cluster: choose one")


@dataclass(frozen=True)
class Estimate:
    """Arguments of ``unshutter estimate``."""

    photos: list[Path] = positional(
        "Photos, or folders of photos, including the folders below; - is one photo from standard input.",
        "input",
        pipe=True,
    )
    output: Path | None = option(
        None,
        "JSON file (one photo) or folder (several); - is standard output. Default: print a line for each photo.",
        short="-o",
        names="results",
        pipe=True,
    )
    reference: Reference = option("first", "Row that the motion is measured from. Default: first.")
    candidates: bool = option(
        False,
        "List all motions that fit each photo, with kind, probability and expected error. `rectify --candidate N` "
        "undoes one of them.",
    )
    json: bool = option(
        False, "Without {--output}, print the motion of one photo as JSON; with {--candidates}, those of all photos."
    )
    plot: Path | None = option(
        None,
        "Also draw the motion of one photo into this PNG file (needs the extra `plot`).",
        metavar="FILE",
        names="output",
    )
    lines: Path | None = option(
        None,
        "Find the photo's motion from lines that you drew in it (JSON, docs/guide/by-hand.md).",
        metavar="FILE",
        names="input",
    )
    overwrite: bool = option(False, "Replace existing outputs.")
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    find: Find = field(default_factory=Find)

    def __post_init__(self) -> None:
        check_count("max-pixels", self.max_pixels)
        if self.candidates and (self.plot or self.find.candidate is not None):
            raise UsageError("{--candidates} lists all motions: leave out {--plot} and {--candidate}")
        if self.candidates and self.lines:
            raise UsageError("{--lines} gives a single motion: leave out {--candidates} or {--lines}")
