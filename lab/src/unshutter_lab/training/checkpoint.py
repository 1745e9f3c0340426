"""Checkpoints: the state of a run in a file, from which it can be resumed or another run can start."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import torch
from torch import nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig, as_table

PART = "checkpoint.part"  # next to a checkpoint while it is being written


def save_checkpoint(path: Path, config: TrainConfig, state: dict[str, Any]) -> None:
    """Writes a checkpoint completely or not at all.

    Args:
        path: path of the file; an existing one is replaced.
        config: configuration of the run.
        state: plain values and state_dicts.
    """
    part = path.with_name(PART)
    torch.save({"config": as_table(config), **state}, part)
    os.replace(part, path)


def load_checkpoint(path: Path, config: TrainConfig, device: torch.device) -> dict[str, Any] | None:
    """Returns the state to resume from, or None if there is no checkpoint yet.

    Raises:
        UsageError: the checkpoint belongs to another configuration.
    """
    if not path.exists():
        return None
    state = torch.load(path, map_location=device, weights_only=True)
    if _identity(state["config"]) != _identity(as_table(config)):
        raise UsageError(f"{path.parent} holds a run of another configuration; choose another --out")
    return state


def start_from(network: nn.Module, checkpoint: Path) -> None:
    """Copies the averaged weights of another run's checkpoint where name and shape agree; others are unchanged.

    Raises:
        UsageError: there is no such checkpoint, or none of its weights fits.
    """
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)["average"]
    except (OSError, KeyError, RuntimeError, pickle.UnpicklingError):
        raise UsageError(f"cannot start from {checkpoint}: it is not a checkpoint of a run") from None
    own = network.state_dict()
    known = {name.removeprefix("module."): value for name, value in state.items()}
    fitting = {name: value for name, value in known.items() if name in own and own[name].shape == value.shape}
    if not fitting:
        raise UsageError(f"cannot start from {checkpoint}: it is of another network")
    network.load_state_dict(fitting, strict=False)


def _identity(table: dict[str, Any]) -> dict[str, Any]:
    """Returns the settings that identify a run: all but its length and the location of its photos."""
    whole = {**as_table(TrainConfig(table["model"])), **table}  # older checkpoints lack newer settings
    whole["data"] = {name: value for name, value in whole["data"].items() if name != "folder"}
    return {name: value for name, value in whole.items() if name not in ("steps", "keep_at")}
