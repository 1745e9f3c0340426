"""The command line: what each command is called, takes and prints. The work is done elsewhere."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from unshutter.errors import UnshutterError, UsageError
from unshutter.version import __version__

ReadoutWord = Literal["auto", "top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]
Reference = Literal["first", "middle", "last"]
Protocol = Literal["synthetic", "native", "trajectory", "undistorted", "robustness", "pairs", "video"]

app = App(
    name="unshutter",
    version=__version__,
    help="Undoes rolling-shutter distortion (skew, wobble) in a single photo. Originals are never touched.",
)


@app.command
def rectify(
    photos: list[str],
    /,
    *,
    output: Annotated[str | None, Parameter(name=["--output", "-o"])] = None,
    estimator: str = "segment-transformer",
    motion: Path | None = None,
    save_motion: str | None = None,
    reference: Reference | None = None,
    strength: float = 1.0,
    edges: Literal["keep", "crop", "fill"] = "keep",
    readout: ReadoutWord = "auto",
    focal_px: float | None = None,
    quality: int | None = None,
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
    quality
        Quality of JPEG, WebP and AVIF, 1 to 100. Default: like the original.
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

    options = batch.RectifyOptions(estimator, motion, reference, strength, edges, readout, quality, overwrite, focal_px)
    how = batch.BatchOptions(jobs, scheduler, dry_run, json_log, max_pixels)
    return batch.rectify_files(photos, output, save_motion, options, how)


@app.command
def estimate(
    photos: list[Path],
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    estimator: str = "segment-transformer",
    reference: Reference = "first",
    readout: ReadoutWord = "auto",
    focal_px: float | None = None,
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
        photos, output, plot, estimator, reference, readout, overwrite, readout_ms, max_pixels, focal_px
    )


@app.command(name="map")
def write_map(
    source: Path,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    inverse: Annotated[bool, Parameter(negative="")] = False,
    size: str | None = None,
    estimator: str = "segment-transformer",
    readout: ReadoutWord = "auto",
    reference: Reference | None = None,
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
    overwrite
        Replace a map that exists already.
    """
    from unshutter.maps import map_file

    options = {"inverse": inverse, "size": size, "estimator": estimator, "readout": readout}
    motion = map_file(source, output, **options, reference=reference, overwrite=overwrite)
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
    from unshutter.motion import Motion
    from unshutter.points import move_file

    total, unseen = move_file(Motion.load(motion), table, output, inverse, float(first_pixel), overwrite)
    note = f", {unseen} of them outside the photo" if unseen else ""
    print(f"{table} -> {output}: {total} points{note}", file=sys.stderr)
    return 0


@app.command
def synthesize(
    photos: list[Path],
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    per_photo: int = 1,
    seed: int = 0,
    motion: Literal["quadratic", "trajectory"] = "quadratic",
    trajectory: Path | None = None,
    readout_ms: float | None = None,
    focal_px: float | None = None,
    size: int = 256,
    canvas: int = 356,
) -> int:
    """Make rolling-shutter pictures with known motion from undistorted photos.

    Parameters
    ----------
    photos
        Photos, or folders of photos.
    output
        New folder; gets rs/, gs/, motion/ and manifest.json.
    per_photo
        Pictures made from each photo.
    seed
        Same seed, same pictures.
    motion
        quadratic: the random motions of Rengarajan 2017. trajectory: windows of a recorded camera motion.
    trajectory
        NPZ file with t_s and gyro_rad_s, or t_s, position_m and quaternion_wxyz.
    readout_ms
        Time from the first to the last row, for trajectories.
    focal_px
        Focal length in px of the finished picture, for trajectories.
    size
        Side of the finished pictures in px.
    canvas
        Side of the picture that is distorted before its middle is cut out, in px.
    """
    from unshutter import batch

    return batch.synthesize_files(
        photos, output, per_photo, seed, motion, trajectory, readout_ms, focal_px, size, canvas
    )


@app.command
def evaluate(
    *,
    data: Annotated[list[Path], Parameter(consume_multiple=True, negative="")],
    estimators: str = "all",
    protocol: Protocol = "synthetic",
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("evaluation"),
    photos: int | None = None,
    per_photo: int = 2,
    seed: int = 0,
    trajectory: Path | None = None,
    jobs: int | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Measure methods side by side on the same pictures (needs the extra `plot`).

    Parameters
    ----------
    data
        Folders, each a group in the tables: of undistorted photos; for pairs and video of rs_0.png, gs_0_middle.png ...
    estimators
        Names with commas between them, or all.
    protocol
        What is measured; docs/use.md says how.
    output
        Folder for tables, figures of every picture, plots and contact sheets. A run that was stopped there goes on.
    photos
        At most so many photos of each folder, chosen by the seed. Default: all.
    per_photo
        Random motions for each photo.
    seed
        Same seed, same figures.
    trajectory
        NPZ file of a recorded motion, or a folder of them, for the protocol of that name.
    jobs
        Processes. Default: one for each processor.
    overwrite
        Throw away a run with other settings that is in the folder.
    """
    from unshutter.evaluation.run import Request, evaluate

    request = Request(protocol, tuple(data), photos, per_photo, seed, trajectory)
    return 1 if evaluate(request, estimators, output, jobs, overwrite) else 0


@app.command
def models() -> None:
    """List the estimators: what each does, how large it is, how well it did."""
    from unshutter.models import as_text, list_models

    print(as_text(list_models()))


@app.command
def train(
    *,
    config: Path,
    out: Path = Path("runs"),
    steps: int | None = None,
    device: str = "auto",
    photos: Path | None = None,
    base: Path | None = None,
    start: Path | None = None,
) -> int:
    """Train a network as a TOML file says (needs the extra `train`).

    Parameters
    ----------
    config
        TOML file; configs/ in the repository has those of the shipped models.
    out
        Folder for checkpoints, log and the exported model. A run that is there is taken up again.
    steps
        Stop after this many steps in all instead of the config's.
    device
        auto, cpu or cuda.
    photos
        Folder of photos, for networks that read pixels; instead of the config's.
    base
        Another TOML file for what the config does not say itself.
    start
        Checkpoint of another run whose weights this one begins with.
    """
    try:
        from unshutter.learn.train import run
    except ImportError as error:
        raise UnshutterError(f"training needs the extra: pip install 'unshutter[train]' ({error})") from None
    run(config, out, steps, device, base=base, photos=photos, start=start)
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 something failed, 2 wrong usage."""
    # NumPy's own threads are hardly used, but while it is imported they spin on the cores that decode.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    atexit.register(gc.freeze)  # else the interpreter ends by looking for cycles among all that was imported
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        return result if isinstance(result, int) else 0
    except CycloptsError as error:
        return _say(f"{' '.join(str(error).split())} (see unshutter --help)", 2)
    except UsageError as error:
        return _say(str(error), 2)
    except UnshutterError as error:
        return _say(str(error), 1)
    except BrokenPipeError:  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except MemoryError:
        return _say("not enough memory", 1)
    except KeyboardInterrupt:
        return _say("stopped; what was finished is kept", 130)


def _say(message: str, code: int) -> int:
    print(f"unshutter: {message}", file=sys.stderr)
    return code
