"""The command ``unshutter train``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unshutter import installation
from unshutter.cli.arguments import Command, required
from unshutter.errors import UnshutterError
from unshutter.options import option


@dataclass(frozen=True)
class Arguments:
    """Arguments of the command."""

    config: str = required(
        "Name of a configuration that comes with unshutter (docs/research/training.md), or a TOML file.", "input"
    )
    out: Path = option(
        Path("runs"),
        "Folder for checkpoints, log and the exported model. Resumes a run that it holds. Default: runs.",
        names="output",
    )
    steps: int | None = option(None, "Stop after N steps in all, instead of the configuration's number.")
    device: str = option("auto", "auto, cpu or cuda. Default: auto.", names="word")
    photos: Path | None = option(
        None, "Folder of photos, for networks that read pixels, instead of the configuration's.", names="input"
    )
    base: str | None = option(
        None,
        "Configuration (name or file) that supplies all settings missing from this one. Default: its own base.",
        names="input",
    )
    start: Path | None = option(
        None,
        "Begin with the weights of another run: its checkpoint or its exported network (.onnx, .npz).",
        names="input",
    )
    seed: int | None = option(None, "Seed for the initial weights and the batches, instead of the configuration's.")


def run(arguments: Arguments) -> int:
    """Trains the network; returns the exit code."""
    try:
        from unshutter_lab.training import train
    except ImportError as error:
        raise UnshutterError(f"training needs the extra: {installation.lab('train')} ({error})") from None
    folder = train.run(
        arguments.config,
        arguments.out,
        arguments.steps,
        arguments.device,
        base=arguments.base,
        photos=arguments.photos,
        start=arguments.start,
        seed=arguments.seed,
    )
    print(f"model: {folder / train.MODEL}, its log: {folder / train.LOG}")
    return 0


COMMAND = Command("Train a network from a configuration (needs the extra `train`).", Arguments, run)
