"""Trains any of the models, in one process on a CPU or GPU, or in several processes started by torchrun.

    unshutter train --config segment-transformer --out runs
    torchrun --nproc-per-node 2 -m unshutter_lab.training.train --config segment-transformer --out runs

A run is stored in OUT/NAME-OF-THE-CONFIG: checkpoint.pt, log.csv and, once finished, model.onnx. A run that is started
again resumes from its last checkpoint with the same batches: step k draws its batch from the seed and k alone.
Needs only torch, NumPy and array-api-compat (and onnx for the export), so it also runs on a bare GPU machine.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from itertools import chain
from pathlib import Path

import torch
import torch.distributed as dist
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from unshutter.errors import UnshutterError, UsageError
from unshutter.storage.protection import Protection
from unshutter_lab.training.checkpoint import PART, load_checkpoint, save_checkpoint, start_from
from unshutter_lab.training.config import TrainConfig, find_config, load_config
from unshutter_lab.training.data.pictures import photo_files
from unshutter_lab.training.exported import load_exported
from unshutter_lab.training.log import TrainingLog
from unshutter_lab.training.optimisation import make_optimiser, rate_at
from unshutter_lab.training.recipes import Recipe, make_recipe

_START_PICTURES, _START_SEED = 128, 2**40  # for the input statistics of an exported network's layers
CHECKPOINT, LOG, MODEL = "checkpoint.pt", "log.csv", "model.onnx"


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
        config: name of a shipped configuration, or path of a TOML file.
        out: folder of runs.
        steps: replaces the configuration's.
        device: auto, cpu or cuda.
        minutes: save and stop after this time.
        base: another configuration that supplies missing settings.
        photos: replaces the configuration's ``[data] folder``.
        start: checkpoint or exported network (.onnx, .npz) whose weights, as far as they fit, initialise a new run.
        seed: seed of the initial weights and the batches; replaces the configuration's.

    Returns:
        The run's folder.

    Raises:
        UsageError: the configuration is invalid, or the folder holds a run of another one.
        UnshutterError: the gradient is not finite.
    """
    settings = load_config(config, base)
    if photos is not None:
        settings = replace(settings, data={**settings.data, "folder": str(photos)})
    if steps is not None:
        settings = replace(settings, steps=steps)
    if seed is not None:
        settings = replace(settings, seed=seed)
    torch.set_num_threads(settings.threads)
    torch.set_float32_matmul_precision("high")
    processes = _join_processes(device)
    folder = Path(out) / find_config(config).stem
    _check_outputs(folder, settings, [find_config(config), find_config(base) if base else None, start])
    try:
        trainer = Trainer(settings, folder, _device(device), start)
        folder.mkdir(parents=True, exist_ok=True)
        finished = trainer.train(minutes)
        if finished and trainer.rank == 0:
            trainer.export(folder / MODEL)
        if processes:
            dist.barrier()  # exiting while another process is still working would break its connection
    finally:
        if processes:
            dist.destroy_process_group()
    return folder


def _check_outputs(folder: Path, settings: TrainConfig, files: list[Path | None]) -> None:
    """Raises UnshutterError if a file of the run would replace one that it starts from or trains on."""
    folders = filter(None, (settings.data.get(name) for name in ("folder", "validation_folder")))
    protection = Protection([*files, *chain.from_iterable(photo_files(Path(each)) for each in folders)])
    for name in (CHECKPOINT, PART, f"checkpoint-{settings.keep_at}.pt", LOG, MODEL):
        protection.check(folder / name)


class Trainer:
    """The state of one run, and the loop that advances it.

    Args:
        config: configuration of the run.
        folder: folder of the run; a checkpoint in it is resumed.
        device: device to run on.
        start: checkpoint or exported network of another run, whose weights this one starts with.

    Raises:
        UsageError: the configuration is invalid, or the folder holds a run of another one.
    """

    def __init__(self, config: TrainConfig, folder: Path, device: torch.device, start: Path | None = None):
        if config.continues and start is None and not (folder / CHECKPOINT).exists():
            raise UsageError(
                f"this configuration goes on from a run of {config.continues}: "
                f"--start runs/{config.continues}/{CHECKPOINT}"
            )
        self.config, self.folder, self.device = config, folder, device
        self.rank = dist.get_rank() if dist.is_initialized() else 0
        self.world = dist.get_world_size() if dist.is_initialized() else 1
        torch.manual_seed(config.seed)
        self.recipe: Recipe = make_recipe(config, device)
        self.network = self.recipe.build().to(device)
        if start is not None:
            self._start_from(start)
        self.average = AveragedModel(self.network, multi_avg_fn=get_ema_multi_avg_fn(config.average), use_buffers=True)
        self.optimiser = make_optimiser(self.network, config)
        self.step, self.seconds = 0, 0.0
        self._resume()
        self.stepped: nn.Module = self.network
        if self.world > 1:
            self.stepped = nn.parallel.DistributedDataParallel(self.network)

    def train(self, minutes: float | None = None) -> bool:
        """Runs to the last step, or for a number of minutes; returns whether the last step was reached."""
        started = saved = time.monotonic()
        before = self.seconds
        with TrainingLog(self.folder / LOG, self.step, self.config.steps, quiet=self.rank > 0) as log:
            while self.step < self.config.steps:
                figures = self._one_step()
                self.seconds = before + time.monotonic() - started
                self._log(log, figures)
                out_of_time = self._any_process(minutes is not None and time.monotonic() - started > 60 * minutes)
                overdue = time.monotonic() - saved > 60 * self.config.checkpoint_minutes
                if overdue or out_of_time or self.step == self.config.steps:
                    self._save(CHECKPOINT)
                    saved = time.monotonic()
                if self.step == self.config.keep_at:
                    self._save(f"checkpoint-{self.step}.pt")
                if out_of_time:
                    break
        return self.step >= self.config.steps

    def validate(self) -> dict[str, float]:
        """Returns the recipe's figures for the averaged weights."""
        self.average.eval()
        return self.recipe.validate(self.average.module)

    def export(self, path: Path) -> None:
        """Writes the averaged weights as ONNX."""
        self.average.eval()
        self.recipe.export(self.average.module, path)

    def _start_from(self, start: Path) -> None:
        if start.suffix == ".onnx":
            pictures = self.recipe.pictures(_START_PICTURES, torch.Generator(self.device).manual_seed(_START_SEED))
            load_exported(self.network, start, pictures)
        elif start.suffix == ".npz":
            self.recipe.start_from_stored(self.network, start)
        else:
            start_from(self.network, start)

    def _one_step(self) -> dict[str, float]:
        self.network.train()
        for group in self.optimiser.param_groups:
            group["lr"] = rate_at(self.step, self.config)
        # the batch depends only on seed, step and process, so that a resumed run sees the same ones
        seed = (self.config.seed * 1_000_003 + self.step) * self.world + self.rank
        generator = torch.Generator(self.device).manual_seed(seed)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.config.bfloat16):
            loss, figures = self.recipe.loss(self.stepped, self.step, generator)
        self.optimiser.zero_grad()
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip)
        if not torch.isfinite(norm):  # such a step would make all weights non-finite
            raise UnshutterError(f"training diverged at step {self.step + 1}: try a smaller learning rate, or clip")
        self.optimiser.step()
        self.average.update_parameters(self.network)
        self.step += 1
        return {"loss": loss.item(), **figures, "gradient": norm.item()}

    def _log(self, log: TrainingLog, figures: dict[str, float]) -> None:
        """Adds a row every ``log_every`` steps, and with every validation."""
        log.step(self.step)
        last = self.step == self.config.steps
        validated = last or self.step % self.config.validate_every == 0
        if validated:
            figures = figures | self.validate()
        if validated or self.step % self.config.log_every == 0:
            log.add({"step": self.step, "seconds": round(self.seconds, 1), **figures})

    def _any_process(self, flag: bool) -> bool:
        """Whether any of the processes wants to stop: all must stop at the same step."""
        if self.world == 1:
            return flag
        flags = torch.tensor(float(flag), device=self.device)
        dist.all_reduce(flags)
        return flags.item() > 0

    def _save(self, name: str) -> None:
        if self.rank == 0:
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


def _device(word: str) -> torch.device:
    if word == "auto":
        word = "cuda" if torch.cuda.is_available() else "cpu"
    if word == "cuda" and not torch.cuda.is_available():
        raise UsageError("no CUDA device here; use --device cpu")
    if word not in ("cpu", "cuda"):
        raise UsageError(f"unknown device '{word}': choose auto, cpu or cuda")
    return torch.device(word, int(os.environ.get("LOCAL_RANK", "0")) if word == "cuda" else None)  # type: ignore[arg-type]


def _join_processes(device: str) -> bool:
    """Joins the other processes if torchrun has started several; returns whether it has."""
    if int(os.environ.get("WORLD_SIZE", "1")) < 2:
        return False
    cuda = device != "cpu" and torch.cuda.is_available()
    if cuda:
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    dist.init_process_group("nccl" if cuda else "gloo")
    return True


def main() -> None:
    """Runs the command line of a bare training machine, and of torchrun."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", required=True)
    parser.add_argument("--base")
    parser.add_argument("--out", type=Path, default=Path("runs"))
    parser.add_argument("--steps", type=int)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--start", type=Path)
    parser.add_argument("--seed", type=int)
    try:
        run(**vars(parser.parse_args()))
    except UnshutterError as error:
        parser.exit(2 if isinstance(error, UsageError) else 1, f"unshutter: {error}\n")


if __name__ == "__main__":
    main()
