"""What a training run is told: a frozen value read from a TOML file."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from unshutter.errors import UsageError

T = TypeVar("T")


@dataclass(frozen=True)
class TrainConfig:
    """A training run. ``network``, ``data`` and ``loss`` hold what the model's own recipe understands."""

    model: str  # name of a recipe (recipes.py)
    steps: int = 1000
    batch: int = 64  # samples per step and process
    learning_rate: float = 1e-3
    warmup: int = 100  # steps of linear warm-up, then the schedule
    schedule: str = "cosine"  # cosine to zero | constant | stairs: divided by ten every ``stair`` steps
    stair: int = 0
    optimiser: str = "adamw"  # adamw | adam | sgd; the last two take weight_decay as an L2 penalty
    momentum: float = 0.9  # of SGD, or Adam's first beta
    beta2: float = 0.98  # Adam's second
    weight_decay: float = 0.01
    clip: float = 20.0  # largest gradient norm
    average: float = 0.998  # decay of the moving average of the weights, which is what is exported
    seed: int = 0
    bfloat16: bool = False  # convolutions and matrix products in half precision (2.5 times as fast on a CPU with AMX)
    threads: int = 1  # CPU threads per process
    log_every: int = 50  # steps
    validate_every: int = 500  # steps
    checkpoint_minutes: float = 3.0
    keep_at: int = 0  # the checkpoint of this step is kept as checkpoint-STEP.pt, for other runs to start from
    network: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    loss: dict[str, Any] = field(default_factory=dict)


def load_config(path: Path, base: Path | None = None) -> TrainConfig:
    """Reads a TOML file. Its key ``base`` names another, beside it, for all that it does not say itself.

    Args:
        path: of the file.
        base: instead of the one that the file names.

    Raises:
        UsageError: it cannot be read, or has a key or type that does not belong there.
    """
    table = _read(Path(path), base)
    if "model" not in table:
        raise UsageError(f"{path} does not say which model to train (model = ...)")
    return from_table(TrainConfig, table, str(path))


def _read(path: Path, base: Path | None, depth: int = 0) -> dict[str, Any]:
    if depth > 4:
        raise UsageError(f"{path}: too many files, each the base of another")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None
    named = table.pop("base", None)
    if base is None and named is None:
        return table
    if base is None and not isinstance(named, str):
        raise UsageError(f"{path}: 'base' must be the name of a TOML file, got {named!r}")
    below = _read(base or path.parent / str(named), None, depth + 1)
    inner = {name: {**below.get(name, {}), **value} for name, value in table.items() if isinstance(value, dict)}
    return {**below, **table, **inner}


def from_table(kind: type[T], table: dict[str, Any], where: str) -> T:
    """A flat dataclass from a table of the same names; whole numbers may stand for floats.

    Raises:
        UsageError: unknown name or wrong type.
    """
    known: dict[str, Any] = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    values = {}
    for name, value in table.items():
        if name not in known:
            raise UsageError(f"{where}: unknown setting '{name}'; known are {', '.join(known)}")
        wanted = str(known[name].type).partition("[")[0]
        if wanted == "float" and type(value) is int:
            value = float(value)
        if type(value).__name__ != wanted:
            raise UsageError(f"{where}: '{name}' must be of type {wanted}, got {value!r}")
        values[name] = value
    return kind(**values)


def as_table(config: TrainConfig) -> dict[str, Any]:
    """The configuration as plain values."""
    return asdict(config)
