"""``unshutter rectify`` and ``unshutter estimate``: process photos."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from unshutter.cli.arguments import Command, as_typed
from unshutter.cli.pipes import PIPE, Pipes, only
from unshutter.errors import UnknownRatioError, UsageError
from unshutter.options import Estimate, Find, Neighbours, Rectify, Run, Save, Undo, option
from unshutter.options.fields import positional
from unshutter.run.commands import Outputs, estimate_files, rectify_files
from unshutter.storage.objects import path_of


@dataclass(frozen=True)
class RectifyPhotos:
    """Arguments of ``unshutter rectify``."""

    photos: list[str] = positional(
        "Photos, or folders of photos, including the folders below; - is one photo from standard input. With the extra "
        "`dask` also URLs (s3://...).",
        "input",
        pipe=True,
    )
    output: str | None = option(
        None,
        "File to write (one photo), or folder (several photos; subfolders are kept); - is standard output. "
        "Default: NAME.rectified.EXT next to each photo (NAME.heic becomes NAME.heic.rectified.avif).",
        short="-o",
        metavar="PATH",
        names="results",
        pipe=True,
    )
    motion: Path | None = option(
        None, "Undo the motion in this JSON file (from {--save-motion}) instead of finding one.", names="input"
    )
    save_motion: str | None = option(
        None, "Also write the motion: a JSON file (one photo) or a folder (several).", metavar="PATH", names="results"
    )
    masks: str | None = option(
        None,
        "Also write a mask of each result's valid pixels into this folder: NAME.EXT.png, as COLMAP expects.",
        metavar="FOLDER",
        names="results",
    )
    find: Find = field(default_factory=Find)
    neighbours: Neighbours = field(default_factory=Neighbours)
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    run: Run = field(default_factory=Run)


def _rectify(arguments: RectifyPhotos) -> int:
    """Rectifies the photos; returns the exit code."""
    with Pipes(only(arguments.photos), arguments.output, "a photo") as pipes:
        if pipes.is_read:
            arguments = replace(arguments, photos=[str(pipes.keep_photo())])
        if not pipes.is_written:
            return _rectify_files(arguments, pipes.is_read)
        if arguments.run.dry_run:
            raise UsageError("{--dry-run} lists files that would be written: leave out - or {--dry-run}")
        if len(arguments.photos) > 1 or Path(arguments.photos[0]).is_dir():
            raise UsageError("several photos need {--output} FOLDER: - is for one")
        pipes.name_results(path_of(arguments.photos[0]), arguments.save.format, arguments.save.keep_names)
        code = _rectify_files(replace(arguments, output=str(pipes.results)), piped=True)
        pipes.send()
        return code


def _rectify_files(arguments: RectifyPhotos, piped: bool = False) -> int:
    options = Rectify(arguments.find, arguments.motion, arguments.undo, arguments.save, arguments.neighbours).settled()
    try:
        into = Outputs.named(arguments.output, arguments.save_motion, arguments.masks)
        levelling = as_typed(arguments, upright="level")
        return rectify_files(arguments.photos, into, options, arguments.run, [] if piped else levelling)
    except UnknownRatioError as error:
        raise error.with_advice("give {--readout-ratio}, or {--readout-ms} with {--fps}") from None


RECTIFY = Command(
    """Straighten photos: write what a global shutter would have seen.

Of several photos into a folder, finished ones are skipped unless the photo or the options changed: run the same command
again to continue a run that was stopped.""",
    RectifyPhotos,
    _rectify,
    essentials={
        "photos": "photos, or folders of photos; -: stdin",
        "output": "a file, or a folder for several photos; -: stdout",
        "moving": "the camera moved: a train, a car, a drone",
        "before": "frame taken just before the photo",
        "after": "frame taken just after it",
        "readout_ratio": "for these: readout time / time between frames",
        "sequence": "the photos are frames of one camera, in order",
        "strength": "how much to undo: 1 is all of it",
        "edges": "auto, keep, crop, fill or borrow",
        "min_confidence": "leave photos alone below this, 0 to 1",
        "overwrite": "replace existing results",
        "preview": "a picture of before and after, side by side",
    },
)


def _estimate(arguments: Estimate) -> int:
    """Estimates the motions; returns the exit code."""
    if str(arguments.output) == PIPE:
        arguments = replace(arguments, output=None, json=True)
    with Pipes(only(arguments.photos), "", "a photo") as pipes:
        if pipes.is_read:
            arguments = replace(arguments, photos=[pipes.keep_photo()])
        return estimate_files(arguments)


ESTIMATE = Command(
    """Find how the camera moved during each photo.

A line says what moved and how sure that is. With --json or -o, the motion is JSON, with numbers for each row.""",
    Estimate,
    _estimate,
    essentials={
        "photos": "photos, or folders of photos; -: stdin",
        "output": "JSON file, or a folder for several photos",
        "json": "print JSON instead of a line",
        "reference": "row that counts as not moving: first, middle or last",
        "plot": "draw the motion of one photo (extra `plot`)",
        "overwrite": "replace existing outputs",
        "focal_px": "focal length in px, if you know it",
        "moving": "the camera moved: a train, a car, a drone",
    },
)
