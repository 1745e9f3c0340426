"""Training, for every model: one process on a CPU or GPU, or several started by torchrun.

    unshutter train --config configs/segment-transformer.toml --out runs
    torchrun --nproc-per-node 2 -m unshutter.learn.train --config configs/segment-transformer.toml --out runs

A run lives in OUT/NAME-OF-THE-CONFIG: checkpoint.pt, log.csv and, when finished, model.onnx. Started again
it goes on where the last checkpoint was, with the same batches: step k draws its batch from seed and k alone.
Needs torch and NumPy only (and onnx for the export), so that it runs on a bare GPU machine.
"""

from __future__ import annotations

import argparse
import math
import os
import pickle
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from unshutter.errors import UsageError
from unshutter.learn.config import TrainConfig, as_table, load_config
from unshutter.learn.log import TrainingLog
from unshutter.learn.recipes import Recipe, make_recipe


def run(
    config_path: Path,
    out: Path,
    steps: int | None = None,
    device: str = "auto",
    minutes: float | None = None,
    *,
    base: Path | None = None,
    photos: Path | None = None,
    start: Path | None = None,
) -> Path:
    """Trains to the end, or for so many minutes; takes up a run that is there.

    Args:
        config_path: TOML file (config.py).
        out: folder of runs.
        steps: overrides the configuration's.
        device: auto, cpu or cuda.
        minutes: save and stop after this time.
        base: another file for what the configuration does not say itself.
        photos: overrides the configuration's ``[data] folder``.
        start: checkpoint whose weights, where they fit, a new run begins with.

    Returns:
        The run's folder.

    Raises:
        UsageError: bad configuration, or the folder holds a run of another one.
    """
    config = load_config(config_path, base)
    config = replace(config, data={**config.data, "folder": str(photos)}) if photos else config
    config = replace(config, steps=steps) if steps else config
    torch.set_num_threads(config.threads)
    torch.set_float32_matmul_precision("high")
    processes = _join_processes(device)
    folder = Path(out) / Path(config_path).stem
    folder.mkdir(parents=True, exist_ok=True)
    try:
        trainer = Trainer(config, folder, _device(device), start)
        finished = trainer.train(minutes)
        if finished and trainer.rank == 0:
            trainer.export(folder / "model.onnx")
        if processes:
            dist.barrier()  # leaving while another still works would break its connection
    finally:
        if processes:
            dist.destroy_process_group()
    return folder


class Trainer:
    """The state of one run and the loop that advances it."""

    def __init__(self, config: TrainConfig, folder: Path, device: torch.device, start: Path | None = None):
        self.config, self.folder, self.device = config, folder, device
        self.rank = dist.get_rank() if dist.is_initialized() else 0
        self.world = dist.get_world_size() if dist.is_initialized() else 1
        torch.manual_seed(config.seed)
        self.recipe: Recipe = make_recipe(config, device)
        self.network = self.recipe.build().to(device)
        if start is not None:
            begin_with(self.network, start)
        self.average = AveragedModel(self.network, multi_avg_fn=get_ema_multi_avg_fn(config.average), use_buffers=True)
        self.optimiser = _optimiser(self.network, config)
        self.step, self.seconds = 0, 0.0
        self._resume()
        self.stepped: nn.Module = self.network
        if self.world > 1:
            self.stepped = nn.parallel.DistributedDataParallel(self.network)

    def train(self, minutes: float | None = None) -> bool:
        """Runs to the last step or for so many minutes; returns whether the last step was reached."""
        started, saved = time.monotonic(), time.monotonic()
        before = self.seconds
        with TrainingLog(self.folder / "log.csv", self.step, self.config.steps, quiet=self.rank > 0) as rows:
            while self.step < self.config.steps:
                log = self._one_step()
                self.seconds = before + time.monotonic() - started
                rows.step(self.step)
                last = self.step == self.config.steps
                if self.step % self.config.log_every == 0 or last:
                    if self.step % self.config.validate_every == 0 or last:
                        log |= self.validate()
                    rows.add({"step": self.step, "seconds": round(self.seconds, 1), **log})
                out_of_time = minutes is not None and time.monotonic() - started > 60 * minutes
                if self.world > 1:  # all processes stop together
                    flag = torch.tensor(float(out_of_time), device=self.device)
                    dist.all_reduce(flag)
                    out_of_time = flag.item() > 0
                if last or out_of_time or time.monotonic() - saved > 60 * self.config.checkpoint_minutes:
                    self._save()
                    saved = time.monotonic()
                if self.step == self.config.keep_at:
                    self._save(f"checkpoint-{self.step}.pt")
                if out_of_time:
                    break
        return self.step >= self.config.steps

    def validate(self) -> dict[str, float]:
        """The recipe's figures for the averaged weights."""
        self.average.eval()
        return self.recipe.validate(self.average.module)

    def export(self, path: Path) -> None:
        """Writes the averaged weights as ONNX."""
        self.average.eval()
        self.recipe.export(self.average.module, path)

    def _one_step(self) -> dict[str, float]:
        self.network.train()
        for group in self.optimiser.param_groups:
            group["lr"] = self.config.learning_rate * _schedule(self.step, self.config)
        # the batch depends on seed, step and process only: a resumed run sees what it would have seen
        seed = (self.config.seed * 1_000_003 + self.step) * self.world + self.rank
        generator = torch.Generator(self.device).manual_seed(seed)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.config.bfloat16):
            loss, log = self.recipe.loss(self.stepped, self.step, generator)
        self.optimiser.zero_grad()
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip)
        self.optimiser.step()
        self.average.update_parameters(self.network)
        self.step += 1
        return {"loss": loss.item(), **log, "gradient": norm.item()}

    def _save(self, name: str = "checkpoint.pt") -> None:
        if self.rank > 0:
            return
        state = {
            "config": as_table(self.config),
            "step": self.step,
            "seconds": self.seconds,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }
        temporary = self.folder / "checkpoint.part"
        torch.save(state, temporary)
        os.replace(temporary, self.folder / name)

    def _resume(self) -> None:
        path = self.folder / "checkpoint.pt"
        if not path.exists():
            return
        state = torch.load(path, map_location=self.device, weights_only=True)
        if _identity(state["config"]) != _identity(as_table(self.config)):
            raise UsageError(f"{self.folder} holds a run of another configuration; choose another --out")
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.seconds = state["step"], state["seconds"]


def begin_with(network: nn.Module, checkpoint: Path) -> None:
    """Sets the weights that a checkpoint has in the same shape to its averaged ones; the others stay.

    Raises:
        UsageError: no such checkpoint, or none of its weights fits.
    """
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)["average"]
    except (OSError, KeyError, RuntimeError, pickle.UnpicklingError):
        raise UsageError(f"cannot start from {checkpoint}: it is no checkpoint of a run") from None
    own = network.state_dict()
    known = {name.removeprefix("module."): value for name, value in state.items()}
    fitting = {name: value for name, value in known.items() if name in own and own[name].shape == value.shape}
    if not fitting:
        raise UsageError(f"cannot start from {checkpoint}: it is of another network")
    network.load_state_dict(fitting, strict=False)


def _identity(table: dict[str, Any]) -> dict[str, Any]:
    """What makes a run this one: not its length, nor where its photos lie."""
    whole = {**as_table(TrainConfig(table["model"])), **table}  # settings younger than the checkpoint
    whole["data"] = {name: value for name, value in whole["data"].items() if name != "folder"}
    return {name: value for name, value in whole.items() if name not in ("steps", "keep_at")}


def _optimiser(network: nn.Module, config: TrainConfig) -> torch.optim.Optimizer:
    weights, rate, decay = network.parameters(), config.learning_rate, config.weight_decay
    betas = (config.momentum, config.beta2)
    if config.optimiser == "adamw":
        return torch.optim.AdamW(weights, rate, betas, weight_decay=decay)
    if config.optimiser == "adam":
        return torch.optim.Adam(weights, rate, betas, weight_decay=decay)
    if config.optimiser == "sgd":
        return torch.optim.SGD(weights, rate, config.momentum, weight_decay=decay)
    raise UsageError(f"unknown optimiser '{config.optimiser}': choose adamw, adam or sgd")


def _schedule(step: int, config: TrainConfig) -> float:
    """Share of the learning rate: linear warm-up, then as ``config.schedule`` says."""
    ramp = min(1.0, (step + 1) / max(config.warmup, 1))
    if config.schedule == "cosine":
        return ramp * (0.5 + 0.5 * math.cos(math.pi * step / config.steps))
    if config.schedule == "constant":
        return ramp
    if config.schedule == "stairs" and config.stair > 0:
        return ramp * 0.1 ** (step // config.stair)
    raise UsageError(f"unknown schedule '{config.schedule}': choose cosine, constant, or stairs with stair > 0 steps")


def _device(word: str) -> torch.device:
    if word == "auto":
        word = "cuda" if torch.cuda.is_available() else "cpu"
    if word == "cuda" and not torch.cuda.is_available():
        raise UsageError("no CUDA device here; use --device cpu")
    if word not in ("cpu", "cuda"):
        raise UsageError(f"unknown device '{word}': choose auto, cpu or cuda")
    return torch.device(word, int(os.environ.get("LOCAL_RANK", "0")) if word == "cuda" else None)  # type: ignore[arg-type]


def _join_processes(device: str) -> bool:
    """Joins the others when torchrun started us; returns whether it did."""
    if int(os.environ.get("WORLD_SIZE", "1")) < 2:
        return False
    cuda = device != "cpu" and torch.cuda.is_available()
    if cuda:
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    dist.init_process_group("nccl" if cuda else "gloo")
    return True


def main() -> None:
    """The command line of a bare training machine (and of torchrun)."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("runs"))
    parser.add_argument("--steps", type=int)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--minutes", type=float)
    for name in ("base", "photos", "start"):
        parser.add_argument(f"--{name}", type=Path)
    given = parser.parse_args()
    try:
        run(**{"config_path": given.__dict__.pop("config"), **vars(given)})
    except UsageError as error:
        parser.exit(2, f"unshutter: {error}\n")


if __name__ == "__main__":
    main()
