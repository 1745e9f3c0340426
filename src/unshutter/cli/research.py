"""Commands for those who measure and train: synthesize, evaluate, models, train."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from unshutter.cli.app import app
from unshutter.errors import UnshutterError

Protocol = Literal["synthetic", "native", "trajectory", "undistorted", "robustness", "pairs", "video"]


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
    from unshutter.estimators.catalogue import as_text, list_models

    print(as_text(list_models()))


@app.command
def train(
    *,
    config: str,
    out: Path = Path("runs"),
    steps: int | None = None,
    device: str = "auto",
    photos: Path | None = None,
    base: str | None = None,
    start: Path | None = None,
) -> int:
    """Train a network as a configuration says (needs the extra `train`).

    Parameters
    ----------
    config
        Name of a configuration that comes with unshutter (docs/training.md lists them), or a TOML file.
    out
        Folder for checkpoints, log and the exported model. A run that is there is resumed.
    steps
        Stop after this many steps in all, instead of the config's.
    device
        auto, cpu or cuda.
    photos
        Folder of photos, for networks that read pixels, instead of the config's.
    base
        Another configuration, by name or file, for what this one does not say itself.
    start
        Checkpoint of another run whose weights this one begins with.
    """
    try:
        from unshutter.learn.train import run
    except ImportError as error:
        raise UnshutterError(f"training needs the extra: pip install 'unshutter[train]' ({error})") from None
    run(config, out, steps, device, base=base, photos=photos, start=start)
    return 0
