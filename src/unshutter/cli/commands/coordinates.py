"""``unshutter map`` and ``unshutter points``: export a correction as a map, or apply it to single points."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import visible
from unshutter.options import Find, Reference, option


@dataclass(frozen=True)
class Map:
    """Arguments of ``unshutter map``."""

    source: Path = positional("Photo, or the motion file (.json) of one.", "input")
    output: Path = required(
        "Map to write: .npz (map_x, map_y for cv2.remap), .exr (needs the extra `exr`) or .tif (ST map).",
        "output",
        short="-o",
    )
    inverse: bool = option(False, "Write the inverse map, from the straightened picture back to the photo.")
    size: str | None = option(
        None,
        "Width and height of the map, for a scaled copy of the photo. Default: same as the photo.",
        metavar="WxH",
        names="word",
    )
    reference: Reference | None = option(
        None, "Row whose capture time the result shows. Default: taken from the motion file, otherwise first."
    )
    overwrite: bool = option(False, "Replace a map that exists already.")
    find: Find = field(default_factory=Find)


def _map(arguments: Map) -> int:
    """Writes the map and reports it; returns the exit code."""
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


MAP = Command(
    "Write a photo's correction as a map for other programs: OpenCV (.npz) or an ST map (.exr, .tif).",
    Map,
    _map,
    when_stopped="no half-written file is left",
    essentials={
        "source": "photo, or the motion file of one",
        "output": "map to write: .npz, .exr (extra `exr`) or .tif",
        "inverse": "from the straightened picture to the photo",
        "size": "of the map, for a scaled copy of the photo",
        "reference": "row of the picture's moment: first, middle or last",
        "overwrite": "replace a map that exists already",
    },
)


@dataclass(frozen=True)
class Points:
    """Arguments of ``unshutter points``."""

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


def _points(arguments: Points) -> int:
    """Moves the points and reports how many; returns the exit code."""
    from unshutter.export.points import move_file
    from unshutter.motion import Motion
    from unshutter.storage.protection import Protection

    Protection([arguments.motion, arguments.table]).check(arguments.output)
    motion, first = Motion.load(arguments.motion), float(arguments.first_pixel)
    total, unseen = move_file(motion, arguments.table, arguments.output, arguments.inverse, first, arguments.overwrite)
    note = f", {unseen} of them outside the photo" if unseen else ""
    print(visible(f"{arguments.table} -> {arguments.output}: {total} points{note}"), file=sys.stderr)
    return 0


POINTS = Command(
    "Move points of a photo to where they are in the straightened picture, or back.",
    Points,
    _points,
    when_stopped="no half-written file is left",
)
