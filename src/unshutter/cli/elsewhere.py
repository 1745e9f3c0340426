"""Commands that take a correction to other programs: map and points."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from unshutter.cli.app import ReadoutWord, Reference, app
from unshutter.default_estimator import DEFAULT_ESTIMATOR


@app.command(name="map")
def write_map(
    source: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    inverse: Annotated[bool, Parameter(negative="")] = False,
    size: str | None = None,
    estimator: str = DEFAULT_ESTIMATOR,
    readout: ReadoutWord = "auto",
    reference: Reference | None = None,
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Write a photo's correction as a map for other programs: OpenCV (.npz) or an ST map (.exr, .tif).

    Parameters
    ----------
    source
        Photo, or the motion file (.json) of one.
    output
        Map to write: .npz (map_x, map_y for cv2.remap), .exr (needs the extra `exr`) or .tif (ST map).
    inverse
        The map that distorts: from the straightened picture back to the photo.
    size
        WxH of the map, for a scaled copy of the photo. Default: the photo's own.
    estimator
        Method that finds the camera's motion; `unshutter models` lists them.
    readout
        Direction in which the sensor was read, if an editor has turned the file.
    reference
        Row at whose moment the picture is taken. Default: the motion file's, else first.
    focal_px
        Focal length in px of the photo, for methods that use it. Default: from EXIF, else 0.85 (width + height).
    roll_deg
        How far the camera was turned clockwise from upright, where that is known, for methods that use it.
    tilt_deg
        How far it looked up, -90 being straight down, likewise.
    overwrite
        Replace a map that exists already.
    """
    from unshutter.export.maps import map_file

    motion = map_file(
        source,
        output,
        inverse=inverse,
        size=size,
        estimator=estimator,
        readout=readout,
        reference=reference,
        overwrite=overwrite,
        focal_px=focal_px,
        roll_deg=roll_deg,
        tilt_deg=tilt_deg,
    )
    note = f" (changes nothing: {motion.reason})" if motion.reason else ""
    print(f"{source} -> {output}{note}", file=sys.stderr)
    return 0


@app.command
def points(
    motion: Path,
    table: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    inverse: Annotated[bool, Parameter(negative="")] = False,
    first_pixel: Literal["0", "0.5"] = "0",
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Move points of a photo to where they are in the straightened picture, or back.

    Parameters
    ----------
    motion
        Motion file (.json) of the photo.
    table
        CSV file with columns x and y, in px of the stored photo; other columns are kept.
    output
        CSV file to write.
    inverse
        From the straightened picture to the photo.
    first_pixel
        Coordinate of the first pixel's centre: 0 (OpenCV) or 0.5 (COLMAP).
    overwrite
        Replace a file that exists already.
    """
    from unshutter.export.points import move_file
    from unshutter.motion import Motion

    total, unseen = move_file(Motion.load(motion), table, output, inverse, float(first_pixel), overwrite)
    note = f", {unseen} of them outside the photo" if unseen else ""
    print(f"{table} -> {output}: {total} points{note}", file=sys.stderr)
    return 0
