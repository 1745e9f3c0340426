"""``unshutter estimate``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional
from unshutter.options import MAX_PIXELS, Find, Reference, option


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    photos: list[Path] = positional("Photos, or folders of photos, including the folders below.", "input")
    output: Path | None = option(
        None,
        "JSON file (one photo) or folder (several, one JSON file each). Default: standard output (one photo).",
        short="-o",
        names="output",
    )
    reference: Reference = option("first", "Row that counts as not moving. Default: first.")
    plot: Path | None = option(
        None,
        "Also draw the motion of one photo into this PNG file (needs the extra `plot`).",
        metavar="FILE",
        names="output",
    )
    overwrite: bool = option(False, "Replace outputs that exist already.")
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    find: Find = field(default_factory=Find)


def run(arguments: Arguments) -> int:
    """Estimates the motions; returns the exit code."""
    from unshutter.batch.commands import Estimates, estimate_files

    request = Estimates(arguments.find, arguments.reference, arguments.plot)
    return estimate_files(arguments.photos, arguments.output, request, arguments.overwrite, arguments.max_pixels)


COMMAND = Command("Find the camera's motion during each photo, as JSON.", Arguments, run)
