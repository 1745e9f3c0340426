"""``unshutter rectify``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional
from unshutter.errors import UnknownRatioError
from unshutter.options import Find, Neighbours, Rectify, Run, Save, Undo, option


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    photos: list[str] = positional(
        "Photos, or folders of photos, including the folders below. With the extra `dask` also URLs (s3://...).",
        "input",
    )
    output: str | None = option(
        None,
        "File to write (one photo), or folder (several), which gets the structure of the given ones. "
        "Default: NAME.rectified.EXT beside each photo.",
        short="-o",
        metavar="PATH",
        names="output",
    )
    motion: Path | None = option(None, "Undo the motion in this JSON file instead of finding it.", names="input")
    save_motion: str | None = option(
        None, "Also write the motion: a JSON file (one photo) or a folder (several).", metavar="PATH", names="output"
    )
    masks: str | None = option(
        None,
        "Also write masks of the pixels that the photo saw into this folder: NAME.EXT.png, as COLMAP reads them.",
        metavar="FOLDER",
        names="output",
    )
    find: Find = field(default_factory=Find)
    neighbours: Neighbours = field(default_factory=Neighbours)
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    run: Run = field(default_factory=Run)


def run(arguments: Arguments) -> int:
    """Rectifies the photos; returns the exit code."""
    from unshutter.batch.commands import Outputs, rectify_files

    options = Rectify.of(arguments.find, arguments.motion, arguments.undo, arguments.save, arguments.neighbours)
    try:
        return rectify_files(
            arguments.photos, Outputs(arguments.output, arguments.save_motion, arguments.masks), options, arguments.run
        )
    except UnknownRatioError as error:
        raise error.with_advice("say --readout-ratio, or --readout-ms with --fps") from None


COMMAND = Command(
    """Straighten photos: write what a global shutter would have seen.

Several photos into a folder: what is finished there is not done again unless the photo or the options changed,
and a run that was stopped goes on when the same command is given again.""",
    Arguments,
    run,
)
