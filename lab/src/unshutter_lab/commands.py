"""The commands ``unshutter calibrate``, ``evaluate``, ``synthesize`` and ``train``."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Literal

from unshutter import version
from unshutter.cli.arguments import Command
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import option
from unshutter.options.fields import positional
from unshutter_lab.synthesis.options import Synthesize, SynthesizeClip


@dataclass(frozen=True)
class CalibrateArguments:
    """Arguments of the command."""

    data: Path = positional(
        "Folder with val, train, ordinary, trajectories and, if you like, clips "
        "(docs/research/own-model-calibration.md).",
        "input",
    )
    output: Path = option(
        Path("calibration"),
        "Folder for calibration.json and a report. Resumes a run that was stopped there. Default: calibration.",
        short="-o",
        names="results",
    )
    photos: int | None = option(None, "Use at most N photos of each folder, chosen by the seed. Default: all.")
    seed: int = option(0, "Same seed and data, same file. Default: 0.")
    jobs: int | None = option(None, "Number of processes. Default: one per processor.")
    overwrite: bool = option(False, "Delete an earlier run with other settings from the folder.")


def run_calibrate(arguments: CalibrateArguments) -> int:
    """Runs the calibration; returns the exit code."""
    from unshutter_lab.calibration import calibrate

    path = calibrate.calibrate(**vars(arguments))
    print(f"calibration: {path}; how it does on photos that it has not seen: {arguments.output / calibrate.REPORT}")
    return 0


CALIBRATE = Command(
    "Measure the default method's calibration (needs the extra `calibrate`).", CalibrateArguments, run_calibrate
)


_Photos = Literal["synthetic", "native", "trajectory", "undistorted", "portrait", "exposure", "attitude", "robustness"]
ProtocolName = Literal["places", _Photos, "pairs", "video", "sequences", "rendered-clips", "real-clips"]


@dataclass(frozen=True)
class EvaluateArguments:
    """Arguments of the command."""

    data: list[Path] | None = option(
        None,
        "Folders of undistorted photos (for pairs and video: of rs_0.png, gs_0_middle.png; for places: of cube maps; "
        "for real-clips: of clips); each is a group in the tables. places and rendered-clips bring their own.",
        names="input",
    )
    estimators: str = option(
        "all",
        "Names separated by commas, or all; for real-clips and rendered-clips what these compare. Default: all.",
        names="word",
    )
    protocol: ProtocolName = option("synthetic", "What is measured (docs/research/evaluate.md). Default: synthetic.")
    output: Path = option(
        Path("evaluation"),
        "Folder for tables, plots and contact sheets. Resumes a run that was stopped there. Default: evaluation.",
        short="-o",
        names="results",
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
    answers: list[Path] | None = option(
        None,
        "Folders of motion files named like the pictures (PICTURE.json), each the answers of a method of yours.",
        names="input",
    )
    pictures_only: bool = option(
        False,
        "Write the pictures that methods see to the folder --output, for programs that cannot be called from here, and "
        "measure nothing.",
    )
    jobs: int | None = option(None, "Number of processes. Default: one per processor.")
    overwrite: bool = option(False, "Delete an earlier run with other settings from the folder.")


def run_evaluate(arguments: EvaluateArguments) -> int:
    """Runs the evaluation; returns the exit code."""
    from unshutter_lab.evaluation.answers import write_pictures
    from unshutter_lab.evaluation.protocols import PROTOCOLS, Request
    from unshutter_lab.evaluation.run import evaluate

    given = dict(vars(arguments))
    how = {name: given.pop(name) for name in ("estimators", "output", "jobs", "overwrite", "answers")}
    given |= {"data": tuple(arguments.data or ()), "readout_ratio": tuple(arguments.readout_ratio or ())}
    pictures_only = given.pop("pictures_only")
    request = Request(**given)
    if pictures_only:
        count = write_pictures(PROTOCOLS[request.protocol].cases(request), arguments.output)
        print(f"pictures: {count} in {arguments.output}")
        return 0
    unusable = evaluate(request, **{**how, "answers": tuple(arguments.answers or ())})
    print(f"results: {arguments.output / 'results.md'}, with its plots and pictures; every figure: results.csv")
    return 1 if unusable else 0


EVALUATE = Command("Compare methods on the same pictures.", EvaluateArguments, run_evaluate)


@dataclass(frozen=True)
class SynthesizeArguments:
    """Arguments of the command."""

    photos: list[Path] = positional("Photos, or folders of photos.", "input")
    output: Path = option(MISSING, "New folder; gets rs/, gs/, motion/ and manifest.json.", names="results", short="-o")
    pictures: Synthesize = field(default_factory=Synthesize)
    clip: SynthesizeClip = field(default_factory=SynthesizeClip)


def run_synthesize(arguments: SynthesizeArguments) -> int:
    """Synthesises the pictures or the clip; returns the exit code."""
    if arguments.clip.video:
        from unshutter_lab.synthesis.clip import synthesize_clip

        if len(arguments.photos) != 1:
            raise UsageError("--video makes one clip: name one photo")
        synthesize_clip(arguments.photos[0], arguments.output, arguments.pictures, arguments.clip)
        return 0
    from unshutter_lab.synthesis.pairs import synthesize_files

    return synthesize_files(arguments.photos, arguments.output, arguments.pictures)


SYNTHESIZE = Command(
    "Make rolling-shutter pictures with a known motion from undistorted photos.", SynthesizeArguments, run_synthesize
)


@dataclass(frozen=True)
class TrainArguments:
    """Arguments of the command."""

    config: str = option(
        "own-photos",
        "Name of a configuration that comes with unshutter (docs/research/training.md), or a TOML file. Default: "
        "own-photos, which trains the shipped kandula2020 further.",
        names="input",
    )
    out: Path = option(
        Path("runs"),
        "Folder for checkpoints, log and the exported model. Resumes a run that it holds. Default: runs.",
        names="results",
    )
    steps: int | None = option(None, "Stop after N steps in all, instead of the configuration's number.")
    minutes: float | None = option(None, "Stop after this time; the same command continues the run.")
    device: str = option("auto", "auto, cpu or cuda. Default: auto.", names="word")
    photos: Path | None = option(
        None, "Folder of photos, for networks that read pixels, instead of the configuration's.", names="input"
    )
    base: str | None = option(
        None,
        "Configuration (name or file) that supplies missing settings. Default: its own base.",
        names="input",
    )
    start: Path | None = option(
        None,
        "Begin with the weights of another run: its checkpoint or its exported network (.onnx, .npz).",
        names="input",
    )
    seed: int | None = option(None, "Seed for the initial weights and the batches, instead of the configuration's.")


def run_train(arguments: TrainArguments) -> int:
    """Trains the network; returns the exit code."""
    print(f"training {arguments.config} in {arguments.out}: loading", flush=True)  # importing torch takes seconds
    try:
        from unshutter_lab.training import train
    except ImportError as error:
        raise UnshutterError(f"training needs the extra: {version.lab('train')} ({error})") from None
    folder = train.run(**vars(arguments))
    model = next(folder / name for name in train.MODELS if (folder / name).exists())
    print(f"model: {model}, its log: {folder / train.LOG}")
    return 0


TRAIN = Command(
    "Train a network from a configuration (needs the extra `train`).",
    TrainArguments,
    run_train,
    when_stopped="the same command continues from the last checkpoint",
)
