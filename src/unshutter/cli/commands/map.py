"""``unshutter map``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import visible
from unshutter.options import Find, Reference, option


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    source: Path = positional("Photo, or the motion file (.json) of one.", "input")
    output: Path = required(
        "Map to write: .npz (map_x, map_y for cv2.remap), .exr (needs the extra `exr`) or .tif (ST map).",
        "output",
        short="-o",
    )
    inverse: bool = option(False, "The map that distorts: from the straightened picture back to the photo.")
    size: str | None = option(
        None,
        "Width and height of the map, for a scaled copy of the photo. Default: the photo's own.",
        metavar="WxH",
        names="word",
    )
    reference: Reference | None = option(
        None, "Row at whose moment the picture is taken. Default: the motion file's, else first."
    )
    overwrite: bool = option(False, "Replace a map that exists already.")
    find: Find = field(default_factory=Find)


def run(arguments: Arguments) -> int:
    """Writes the map."""
    from unshutter.export.maps import map_file

    motion = map_file(
        arguments.source,
        arguments.output,
        inverse=arguments.inverse,
        size=arguments.size,
        find=arguments.find,
        reference=arguments.reference,
        overwrite=arguments.overwrite,
    )
    note = f" (changes nothing: {motion.reason})" if motion.reason else ""
    print(visible(f"{arguments.source} -> {arguments.output}{note}"), file=sys.stderr)
    return 0


COMMAND = Command(
    "Write a photo's correction as a map for other programs: OpenCV (.npz) or an ST map (.exr, .tif).", Arguments, run
)
