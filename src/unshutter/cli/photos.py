"""Commands for photos: rectify and estimate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from unshutter.cli.app import ReadoutWord, Reference, app
from unshutter.default_estimator import DEFAULT_ESTIMATOR


@app.command
def rectify(
    photos: list[str],
    /,
    *,
    output: Annotated[str | None, Parameter(name=["--output", "-o"])] = None,
    estimator: str = DEFAULT_ESTIMATOR,
    motion: Path | None = None,
    save_motion: str | None = None,
    reference: Reference | None = None,
    strength: float = 1.0,
    edges: Literal["keep", "crop", "fill"] = "keep",
    readout: ReadoutWord = "auto",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    format: Literal["jpeg", "png", "webp", "tiff", "avif"] | None = None,
    quality: int | None = None,
    subsampling: Literal["4:4:4", "4:2:0"] | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    dry_run: Annotated[bool, Parameter(negative="")] = False,
    json_log: Path | None = None,
    max_pixels: int | None = None,
) -> int:
    """Straighten photos: write what a global shutter would have seen.

    Several photos into a folder: what is finished there is not done again unless the photo or the options changed,
    and a run that was stopped goes on when the same command is given again.

    Parameters
    ----------
    photos
        Photos, or folders with photos in them and in folders below. With the extra `dask` also fsspec URLs (s3://...).
    output
        File to write (one photo) or folder (several), which takes on the structure of the given ones.
        Default: NAME.rectified.EXT beside each photo.
    estimator
        Method that finds the camera's motion; `unshutter models` lists them.
    motion
        Undo the motion in this JSON file instead of finding it.
    save_motion
        Also write the motion: a JSON file (one photo) or a folder (several).
    reference
        Row at whose moment the picture is taken. Default: first.
    strength
        How much of the motion to undo, 0 to 1.
    edges
        Places the photo did not see: keep them empty, crop them away, or fill them with the nearest colour.
    readout
        Direction in which the sensor was read, if an editor has turned the file.
    focal_px
        Focal length in px of the photo, for methods that use it. Default: from EXIF, else 0.85 (width + height).
    roll_deg
        How far the camera was turned clockwise from upright, where that is known, for methods that use it.
    tilt_deg
        How far it looked up, -90 being straight down, likewise.
    format
        Format of the results. Default: that of each photo; AVIF for HEIC, 16-bit TIFF for raw files.
    quality
        Quality of JPEG, WebP and AVIF, 1 to 100. Default: like the original.
    subsampling
        Colour at full (4:4:4) or half (4:2:0) resolution in JPEG and AVIF. Default: like the original.
    overwrite
        Replace outputs that exist already, finished ones too.
    jobs
        Work in so many processes, each on one processor. Default: in this one.
    scheduler
        Address (tcp://HOST:PORT) of a Dask scheduler whose workers do the work (needs the extra `dask`).
    dry_run
        Only say what would be done.
    json_log
        Add what happens to this file, one JSON object a line.
    max_pixels
        Refuse photos with more pixels. Default: 1 000 000 000.
    """
    from unshutter import batch

    options = batch.RectifyOptions(
        estimator=estimator,
        motion=motion,
        reference=reference,
        strength=strength,
        edges=edges,
        readout=readout,
        quality=quality,
        overwrite=overwrite,
        focal_px=focal_px,
        roll_deg=roll_deg,
        tilt_deg=tilt_deg,
        format=format,
        subsampling=subsampling,
    )
    how = batch.BatchOptions(jobs, scheduler, dry_run, json_log, max_pixels)
    return batch.rectify_files(photos, output, save_motion, options, how)


@app.command
def estimate(
    photos: list[Path],
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    estimator: str = DEFAULT_ESTIMATOR,
    reference: Reference = "first",
    readout: ReadoutWord = "auto",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    readout_ms: float | None = None,
    plot: Path | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    max_pixels: int | None = None,
) -> int:
    """Find the camera's motion during each photo, as JSON.

    Parameters
    ----------
    photos
        Photos, or folders with photos in them and in folders below.
    output
        JSON file (one photo) or folder (several, one JSON file each). Default: standard output (one photo).
    estimator
        Method that finds the camera's motion; `unshutter models` lists them.
    reference
        Row that counts as not moving.
    readout
        Direction in which the sensor was read, if an editor has turned the file.
    focal_px
        Focal length in px of the photo, for methods that use it. Default: from EXIF, else 0.85 (width + height).
    roll_deg
        How far the camera was turned clockwise from upright, where that is known, for methods that use it.
    tilt_deg
        How far it looked up, -90 being straight down, likewise.
    readout_ms
        Time from the first to the last row; adds the camera's speed to the JSON and the plot.
    plot
        Also draw the motion of one photo into this PNG file (needs the extra `plot`).
    overwrite
        Replace outputs that exist already.
    max_pixels
        Refuse photos with more pixels. Default: 1 000 000 000.
    """
    from unshutter import batch

    return batch.estimate_files(
        photos,
        output,
        plot,
        estimator,
        reference,
        readout,
        overwrite,
        readout_ms=readout_ms,
        max_pixels=max_pixels,
        focal_px=focal_px,
        roll_deg=roll_deg,
        tilt_deg=tilt_deg,
    )
