"""The command ``unshutter evaluate``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from unshutter.cli.arguments import Command, required
from unshutter.options import option

ProtocolName = Literal[
    "synthetic",
    "native",
    "trajectory",
    "undistorted",
    "portrait",
    "exposure",
    "attitude",
    "robustness",
    "pairs",
    "video",
    "sequences",
]


@dataclass(frozen=True)
class Arguments:
    """Arguments of the command."""

    data: list[Path] = required(
        "Folders of undistorted photos (for pairs and video: of rs_0.png, gs_0_middle.png); each is a group in the "
        "tables.",
        "input",
    )
    estimators: str = option("all", "Names separated by commas, or all. Default: all.", names="word")
    protocol: ProtocolName = option("synthetic", "What is measured (docs/research/evaluate.md). Default: synthetic.")
    output: Path = option(
        Path("evaluation"),
        "Folder for tables, figures of every picture, plots and contact sheets. A run that was stopped there goes on. "
        "Default: evaluation.",
        short="-o",
        names="output",
    )
    photos: int | None = option(None, "Use at most N photos of each folder, chosen by the seed. Default: all.")
    per_photo: int = option(2, "Random motions for each photo. Default: 2.")
    seed: int = option(0, "Same seed, same figures. Default: 0.")
    trajectory: Path | None = option(
        None,
        "NPZ file of a recorded motion, or a folder of them, for the protocols trajectory and sequences.",
        names="input",
    )
    readout_ratio: list[float] | None = option(
        None,
        "For pairs of consecutive frames: readout time / frame interval, one number for each folder. Then also finds "
        "motion from neighbours.",
    )
    jobs: int | None = option(None, "Number of processes. Default: one per processor.")
    overwrite: bool = option(False, "Delete an earlier run with other settings from the folder.")


def run(arguments: Arguments) -> int:
    """Runs the evaluation; returns the exit code."""
    from unshutter_lab.evaluation.cases.protocols import Request
    from unshutter_lab.evaluation.run import evaluate

    request = Request(
        arguments.protocol,
        tuple(arguments.data),
        arguments.photos,
        arguments.per_photo,
        arguments.seed,
        arguments.trajectory,
    )
    request = replace(request, readout_ratio=tuple(arguments.readout_ratio or ()))
    unusable = evaluate(request, arguments.estimators, arguments.output, arguments.jobs, arguments.overwrite)
    print(f"results: {arguments.output / 'results.md'}, with its plots and pictures; every figure: results.csv")
    return 1 if unusable else 0


COMMAND = Command("Compare methods on the same pictures.", Arguments, run)
