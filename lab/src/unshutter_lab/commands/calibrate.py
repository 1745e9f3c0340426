"""The command ``unshutter calibrate``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unshutter.cli.arguments import Command, positional
from unshutter.options import option


@dataclass(frozen=True)
class Arguments:
    """Arguments of the command."""

    data: Path = positional(
        "Folder with undistorted photos in val and train, photos that people took in ordinary, and NPZ files of "
        "recorded motions in trajectories; if you like, also folders of frames in clips, each with the readout time in "
        "frame intervals in readout_ratio.txt.",
        "input",
    )
    output: Path = option(
        Path("calibration"),
        "Folder for calibration.json and for what was measured. A run that was stopped there goes on. Default: "
        "calibration.",
        short="-o",
        names="output",
    )
    photos: int | None = option(None, "Use at most N photos of each folder, chosen by the seed. Default: all.")
    seed: int = option(0, "Same seed and data, same file. Default: 0.")
    jobs: int | None = option(None, "Number of processes. Default: one per processor.")
    overwrite: bool = option(False, "Delete an earlier run with other settings from the folder.")


def run(arguments: Arguments) -> int:
    """Runs the calibration; returns the exit code."""
    from unshutter_lab.calibration import calibrate

    path = calibrate.calibrate(
        arguments.data, arguments.output, arguments.photos, arguments.seed, arguments.jobs, arguments.overwrite
    )
    print(f"calibration: {path}; how it does on photos that it has not seen: {arguments.output / calibrate.REPORT}")
    return 0


COMMAND = Command("Measure the default method's calibration (needs the extra `calibrate`).", Arguments, run)
