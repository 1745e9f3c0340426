"""``unshutter points``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import visible
from unshutter.options import option


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    motion: Path = positional("Motion file (.json) of the photo.", "input")
    table: Path = positional(
        "CSV file with columns x and y, in px of the stored photo; other columns are kept.", "input"
    )
    output: Path = required("CSV file to write.", "output", short="-o")
    inverse: bool = option(False, "From the straightened picture to the photo.")
    first_pixel: Literal["0", "0.5"] = option(
        "0", "Coordinate of the first pixel's centre: 0 (OpenCV) or 0.5 (COLMAP). Default: 0."
    )
    overwrite: bool = option(False, "Replace a file that exists already.")


def run(arguments: Arguments) -> int:
    """Moves the points."""
    from unshutter.export.points import move_file
    from unshutter.motion import Motion
    from unshutter.storage.protection import Protection

    Protection([arguments.motion, arguments.table]).check(arguments.output)
    motion, first = Motion.load(arguments.motion), float(arguments.first_pixel)
    total, unseen = move_file(motion, arguments.table, arguments.output, arguments.inverse, first, arguments.overwrite)
    note = f", {unseen} of them outside the photo" if unseen else ""
    print(visible(f"{arguments.table} -> {arguments.output}: {total} points{note}"), file=sys.stderr)
    return 0


COMMAND = Command("Move points of a photo to where they are in the straightened picture, or back.", Arguments, run)
