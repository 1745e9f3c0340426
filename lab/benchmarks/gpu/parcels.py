"""Packs runs into files small enough for a machine that is lent for minutes and transfers little.

A parcel is one run: log, settings and weights; of a run that is under way the optimiser's state, too. Matrices and
kernels have 16 bits (the optimiser's bfloat16, whose range is that of 32 bits). Fully connected layers with more than
four million weights would not fit: of a finished run they travel as their 256 strongest directions, an unfinished run
stays behind and is trained from its beginning.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

CHECKPOINT, LOG = "checkpoint.pt", "log.csv"
PART = 15 * 2**20  # bytes of a file
_WIDE, _DIRECTIONS = 4_000_000, 256


def pack(run: Path, parcels: Path, finished: bool) -> bool:
    """Writes a run's parcel, NAME.0, NAME.1, ...; returns whether it fitted."""
    state = torch.load(run / CHECKPOINT, map_location="cpu", weights_only=True)
    wide = any(is_wide(value) for value in state["average"].values())
    remove(run.name, parcels)
    if wide and not finished:
        return False
    kept = {name: state[name] for name in ("config", "step", "seconds")}
    kept["average"] = {name: shrunk(value) for name, value in state["average"].items()}
    kept["optimiser"] = {"state": {}, "param_groups": state["optimiser"]["param_groups"]}
    if not finished:
        kept["network"] = {name: shrunk(value) for name, value in state["network"].items()}
        kept["optimiser"] = _with_tensors(state["optimiser"], _in_bfloat16)
    kept["log"] = (run / LOG).read_text()
    stream = io.BytesIO()
    torch.save(kept, stream)
    whole = stream.getvalue()
    parcels.mkdir(parents=True, exist_ok=True)
    for number, first in enumerate(range(0, len(whole), PART)):
        (parcels / f"{run.name}.{number}").write_bytes(whole[first : first + PART])
    return True


def unpack(name: str, parcels: Path, runs: Path) -> bool:
    """Writes the run of a parcel, so that training resumes it; returns whether there was one."""
    parts = _parts(name, parcels)
    if not parts:
        return False
    stream = io.BytesIO(b"".join(part.read_bytes() for part in parts))
    state = torch.load(stream, map_location="cpu", weights_only=True)
    state["average"] = {name: grown(value) for name, value in state["average"].items()}
    network = state.get("network") or {
        name.removeprefix("module."): value for name, value in state["average"].items() if name != "n_averaged"
    }
    state["network"] = {name: grown(value) for name, value in network.items()}
    state["optimiser"] = _with_tensors(state["optimiser"], grown)
    folder = runs / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / LOG).write_text(state.pop("log"))
    torch.save(state, folder / CHECKPOINT)
    return True


def remove(name: str, parcels: Path) -> None:
    """Deletes a run's parcel, if there is one."""
    for part in _parts(name, parcels):
        part.unlink()


def names(parcels: Path) -> list[str]:
    """Names of the runs whose parcels a folder holds."""
    return sorted({part.stem for part in parcels.glob("*.[0-9]*")})


def is_wide(value: Tensor) -> bool:
    """Whether an array is a matrix too large to be transferred whole."""
    return value.ndim == 2 and value.numel() > _WIDE


def shrunk(value: Tensor) -> Tensor | dict[str, Tensor]:
    """Half precision for matrices and kernels, factors of wide matrices; vectors and numbers as they are."""
    if is_wide(value):
        left, strength, right = torch.svd_lowrank(value.float(), q=_DIRECTIONS, niter=4)
        return {"left": (left * strength).half(), "right": right.half()}
    return value.half() if value.ndim > 1 and value.is_floating_point() else value


def grown(value: Tensor | dict[str, Tensor]) -> Tensor:
    """Restores what :func:`shrunk` was given, in 32 bits."""
    if isinstance(value, dict):
        return value["left"].float() @ value["right"].float().T
    return value.float() if value.is_floating_point() else value


def _in_bfloat16(value: Tensor) -> Tensor:
    return value.bfloat16() if value.ndim > 1 else value


def _with_tensors(tree: Any, change: Any) -> Any:
    """A tree of dictionaries and lists with every tensor changed."""
    if isinstance(tree, Tensor):
        return change(tree)
    if isinstance(tree, dict):
        return {name: _with_tensors(value, change) for name, value in tree.items()}
    return [_with_tensors(value, change) for value in tree] if isinstance(tree, list) else tree


def _parts(name: str, parcels: Path) -> list[Path]:
    parts = [part for part in parcels.glob(f"{name}.*") if part.suffix[1:].isdigit()]
    return sorted(parts, key=lambda part: int(part.suffix[1:]))
