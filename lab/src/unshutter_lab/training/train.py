"""Trains any of the models, on a CPU or GPU.

    unshutter train --config segment-transformer --out runs

A run is stored in OUT/NAME-OF-THE-CONFIG: checkpoint.pt, log.csv and, once finished, model.onnx or model.npz. A run
that is started again resumes from its last checkpoint with the same batches: step k draws its batch from the seed and
k alone. Needs only torch, NumPy, OpenCV and array-api-compat (and onnx for the export), so it also runs on a bare
GPU machine.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from unshutter.errors import UnshutterError, UsageError
from unshutter.single.register import method
from unshutter.storage.locations import RunFiles
from unshutter_lab.training.config import TrainConfig, find_config, load_config
from unshutter_lab.training.pixels import photo_files
from unshutter_lab.training.recipes import make_recipe

CHECKPOINT, LOG = "checkpoint.pt", "log.csv"
MODELS = ("model.npz", "model.onnx")  # of recipes (Recipe.model_file)
PART = "checkpoint.part"  # next to a checkpoint while it is being written
_LOCATIONS = ("folder", "validation_folder")  # settings of [data] that say where pictures are


def make_optimiser(network: nn.Module, config: TrainConfig) -> torch.optim.Optimizer:
    """Returns AdamW, Adam or SGD with momentum."""
    weights, rate, decay = network.parameters(), config.learning_rate, config.weight_decay
    if config.optimiser == "sgd":
        return torch.optim.SGD(weights, rate, config.momentum, weight_decay=decay)
    adam = torch.optim.AdamW if config.optimiser == "adamw" else torch.optim.Adam
    return adam(weights, rate, (config.momentum, config.beta2), weight_decay=decay)


def rate_at(step: int, config: TrainConfig) -> float:
    """Returns the learning rate of a step: a linear warm-up times the schedule."""
    warmup, share = min(1.0, (step + 1) / max(config.warmup, 1)), 1.0
    if config.schedule == "cosine":
        share = 0.5 + 0.5 * math.cos(math.pi * step / config.steps)
    elif config.schedule == "stairs":
        share = 0.1 ** (step // config.stair)
    elif config.schedule == "late":
        share = min(1.0, (1 - step / config.steps) / config.tail)
    return config.learning_rate * warmup * share


def run(
    config: str | Path,
    out: Path,
    steps: int | None = None,
    device: str = "auto",
    minutes: float | None = None,
    *,
    base: str | Path | None = None,
    photos: Path | None = None,
    start: Path | None = None,
    seed: int | None = None,
) -> Path:
    """Trains to the end, or for a number of minutes; resumes an existing run.

    Args:
        config: name of a shipped configuration, or path of a TOML file; ``base`` supplies the settings missing there,
            ``steps``, ``photos`` ([data] folder) and ``seed`` replace some of them.
        out: folder of runs.
        steps, base, photos, seed: see config.
        device: auto, cpu or cuda.
        minutes: save, export and stop after this time.
        start: checkpoint or exported network (.onnx, .npz) whose weights, as far as they fit, initialise a new run.

    Returns:
        The run's folder.
    """
    settings = load_config(config, base)
    if photos is not None:
        settings = replace(settings, data={**settings.data, "folder": str(photos)})
    given = {"steps": steps, "seed": seed}
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    torch.set_num_threads(settings.threads)
    torch.set_float32_matmul_precision("high")
    folder = Path(out) / find_config(config).stem
    _check_outputs(folder, settings, [find_config(config), find_config(base) if base else None, start])
    is_new = not (folder / CHECKPOINT).exists()
    if is_new and start is None and settings.shipped:
        start = method(settings.shipped).weights
    begun = f"a new run{f' from {start}' if start else ''}" if is_new else "the run continues"
    print(f"{folder}: {begun}; preparing the pictures", flush=True)
    trainer = Trainer(settings, folder, _device(device), start)
    folder.mkdir(parents=True, exist_ok=True)
    trainer.train(minutes)
    trainer.export()
    return folder


def _check_outputs(folder: Path, settings: TrainConfig, files: list[Path | None]) -> None:
    """Raises UnshutterError if a file of the run would replace one that it starts from or trains on."""
    folders = filter(None, (settings.data.get(name) for name in ("folder", "validation_folder")))
    run_files = RunFiles(reads=[*files, *chain.from_iterable(photo_files(Path(each)) for each in folders)])
    for name in (CHECKPOINT, PART, f"checkpoint-{settings.keep_at}.pt", LOG, *MODELS):
        run_files.check(folder / name)


class Trainer:
    """The state of one run, and the loop that advances it.

    A checkpoint in the run's folder is resumed; a new run begins with the weights of ``start``, if given.
    """

    def __init__(self, config: TrainConfig, folder: Path, device: torch.device, start: Path | None = None):
        if config.continues and start is None and not (folder / CHECKPOINT).exists():
            raise UsageError(
                f"this configuration continues a run of {config.continues}: "
                f"--start runs/{config.continues}/{CHECKPOINT}"
            )
        self.config, self.folder, self.device = config, folder, device
        torch.manual_seed(config.seed)
        self.recipe = make_recipe(config, device)
        self.network = self.recipe.build().to(device)
        if start is not None:
            self.recipe.start(self.network, start)
        self.average = AveragedModel(self.network, multi_avg_fn=get_ema_multi_avg_fn(config.average), use_buffers=True)
        self.optimiser = make_optimiser(self.network, config)
        self._in_half = config.bfloat16 and _is_fast_at_half(device)
        self.step, self.seconds = 0, 0.0
        self.before_step: Callable[[], None] | None = None  # what a caller wants to be done, such as new pictures
        self._resume()

    def train(self, minutes: float | None = None) -> bool:
        """Runs to the last step, or for a number of minutes; returns whether the last step was reached."""
        started = saved = time.monotonic()
        before, first = self.seconds, self.step + 1
        with TrainingLog(self.folder / LOG, self.step, self.config.steps) as log, _Interrupt() as interrupt:
            while self.step < self.config.steps:
                if self.before_step is not None:
                    self.before_step()
                figures = self._one_step()
                self.seconds = before + time.monotonic() - started
                if self.step == first:
                    print(f"step {first} of {self.config.steps} took {self.seconds - before:.1f} s", flush=True)
                out_of_time = minutes is not None and time.monotonic() - started > 60 * minutes
                self._log(log, figures, is_last=out_of_time or interrupt.number is not None)
                overdue = time.monotonic() - saved > 60 * self.config.checkpoint_minutes
                if overdue or out_of_time or interrupt.number or self.step == self.config.steps:
                    self._save(CHECKPOINT)
                    saved = time.monotonic()
                if self.step == self.config.keep_at:
                    self._save(f"checkpoint-{self.step}.pt")
                if out_of_time or interrupt.number:
                    break
        return self.step >= self.config.steps

    def export(self) -> None:
        """Writes the averaged weights as the file that estimators run."""
        self.average.eval()
        self.recipe.export(self.average.module, self.folder / self.recipe.model_file)

    def _one_step(self) -> dict[str, float]:
        self.network.train()
        for group in self.optimiser.param_groups:
            group["lr"] = rate_at(self.step, self.config)
        seed = self.config.seed * 1_000_003 + self.step  # a resumed run sees the same batches
        generator = torch.Generator(self.device).manual_seed(seed)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self._in_half):
            loss, figures = self.recipe.loss(self.network, self.step, generator)
        self.optimiser.zero_grad()
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip)
        if not torch.isfinite(norm):  # such a step would make all weights non-finite
            raise UnshutterError(f"training diverged at step {self.step + 1}: try a smaller learning rate, or clip")
        self.optimiser.step()
        self.average.update_parameters(self.network)
        self.step += 1
        return {"loss": loss.item(), **figures, "gradient": norm.item()}

    def _log(self, log: TrainingLog, figures: dict[str, float], *, is_last: bool) -> None:
        """Adds a row every ``log_every`` steps, with every validation, and before a stop."""
        log.step(self.step)
        validated = self.step == self.config.steps or self.step % self.config.validate_every == 0
        if validated:
            self.average.eval()
            figures = figures | self.recipe.validate(self.average.module)
        if validated or is_last or self.step % self.config.log_every == 0:
            log.add({"step": self.step, "seconds": round(self.seconds, 1), **figures})

    def _save(self, name: str) -> None:
        parts = {"network": self.network, "average": self.average, "optimiser": self.optimiser}
        states = {part: holder.state_dict() for part, holder in parts.items()}
        save_checkpoint(self.folder / name, self.config, {"step": self.step, "seconds": self.seconds, **states})

    def _resume(self) -> None:
        state = load_checkpoint(self.folder / CHECKPOINT, self.config, self.device)
        if state is not None:
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step, self.seconds = state["step"], state["seconds"]


class _Interrupt:
    """Holds Ctrl-C and SIGTERM back until a step is done and saved; a second one takes effect at once."""

    def __init__(self) -> None:
        self.number: int | None = None  # of the signal that came
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> _Interrupt:
        if threading.current_thread() is threading.main_thread():
            self._handlers = {each: signal.signal(each, self._note) for each in (signal.SIGINT, signal.SIGTERM)}
        return self

    def _note(self, number: int, _frame: object) -> None:
        self.number = number
        self._restore()

    def _restore(self) -> None:
        for each, handler in self._handlers.items():
            signal.signal(each, handler)

    def __exit__(self, *error: object) -> None:
        self._restore()
        if self.number is not None and error[0] is None:
            signal.raise_signal(self.number)


def _device(word: str) -> torch.device:
    if word == "auto":
        word = "cuda" if torch.cuda.is_available() else "cpu"
    if word == "cuda" and not torch.cuda.is_available():
        raise UsageError("no CUDA device here; use --device cpu")
    if word not in ("cpu", "cuda"):
        raise UsageError(f"unknown device '{word}': choose auto, cpu or cuda")
    return torch.device(word)


def _is_fast_at_half(device: torch.device) -> bool:
    """Whether half precision is faster on a device; processors without AVX-512 take eight times as long."""
    return device.type != "cpu" or "AVX512" in torch.backends.cpu.get_cpu_capability()


def save_checkpoint(path: Path, config: TrainConfig, state: dict[str, Any]) -> None:
    """Writes a checkpoint completely or not at all."""
    part = path.with_name(PART)
    torch.save({"config": asdict(config), **state}, part)
    os.replace(part, path)


def load_checkpoint(path: Path, config: TrainConfig, device: torch.device) -> dict[str, Any] | None:
    """Returns the state to resume from, or None if there is no checkpoint yet."""
    if not path.exists():
        return None
    state = torch.load(path, map_location=device, weights_only=True)
    if _identity(state["config"]) != _identity(asdict(config)):
        raise UsageError(f"{path.parent} contains a run of another configuration: choose another --out")
    return state


def _identity(table: dict[str, Any]) -> dict[str, Any]:
    """Returns the settings that identify a run: all but its length and the location of its pictures."""
    whole = {**asdict(TrainConfig(table["model"])), **table}  # older checkpoints lack newer settings
    whole["data"] = {name: value for name, value in whole["data"].items() if name not in _LOCATIONS}
    if "places" in whole["data"]:
        whole["data"]["places"] = {**whole["data"]["places"], "folder": ""}
    return {name: value for name, value in whole.items() if name not in ("steps", "keep_at")}


class TrainingLog:
    """Writes log.csv, with one row per logged step, and shows a progress bar (on a terminal) or lines (elsewhere).

    Args:
        path: path of log.csv. Rows beyond the checkpoint from which a run resumes are dropped.
        step: steps done so far.
        steps: total number of steps.
    """

    def __init__(self, path: Path, step: int, steps: int):
        self._path, self._steps = path, steps
        self._rows: list[dict[str, Any]] = []
        self._bar = _bar(step, steps)
        if path.exists():
            with path.open(newline="") as file:
                self._rows = [row for row in csv.DictReader(file) if int(row["step"]) <= step]

    def __enter__(self) -> TrainingLog:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def step(self, step: int) -> None:
        """Advances the progress bar."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=step)

    def add(self, row: dict[str, Any]) -> None:
        """Writes a row, whose columns include ``step`` and ``seconds``."""
        self._rows.append({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})
        newest = {name: value for each in self._rows for name, value in each.items() if value != ""}
        with self._path.open("w", newline="") as file:
            columns = dict.fromkeys(name for each in self._rows for name in each)
            writer = csv.DictWriter(file, list(columns), restval="")
            writer.writeheader()
            writer.writerows(self._rows)
        if self._bar is not None:
            figures = "  ".join(f"{k} {v}" for k, v in newest.items() if k == "loss" or k.startswith("val_"))
            self._bar.update(self._bar.task_ids[0], figures=figures)
        else:
            left = row["seconds"] / row["step"] * (self._steps - row["step"]) / 60
            figures = "  ".join(f"{k} {v}" for k, v in self._rows[-1].items() if k not in ("step", "seconds"))
            print(f"{row['step']}/{self._steps}  {left:.0f} min left  {figures}", flush=True)


def _bar(step: int, steps: int) -> Any:
    """Returns Rich's progress bar, or None without a terminal or without rich (on a bare training machine)."""
    if not sys.stdout.isatty():
        return None
    try:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    except ImportError:
        return None
    bar = Progress(BarColumn(20), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.fields[figures]}"))
    bar.add_task("training", total=steps, completed=step, figures="")
    bar.start()
    return bar


def main() -> None:
    """Runs the command line of a bare training machine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", required=True)
    parser.add_argument("--out", type=Path, default=Path("runs"))
    parser.add_argument("--device", default="auto")
    kinds = {"base": str, "steps": int, "minutes": float, "photos": Path, "start": Path, "seed": int}
    for name, kind in kinds.items():
        parser.add_argument(f"--{name}", type=kind)
    try:
        run(**vars(parser.parse_args()))
    except UnshutterError as error:
        parser.exit(2 if isinstance(error, UsageError) else 1, f"unshutter: {error}\n")


if __name__ == "__main__":
    main()
