"""The configuration of a training run: a frozen value, read from a TOML file.

The package includes its own configurations in configs/, which are found by name; other files are found by path.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from unshutter.errors import UsageError
from unshutter.storage.files import read_text

T = TypeVar("T")
_SHIPPED = Path(__file__).parent / "configs"
_MOST_BASES = 8  # in a chain; longer ones are a loop


@dataclass(frozen=True)
class TrainConfig:
    """A training run. ``network``, ``data`` and ``loss`` are interpreted by the model's own recipe."""

    model: str  # name of a recipe (recipes.py)
    steps: int = 1000
    batch: int = 64  # samples per step
    learning_rate: float = 1e-3
    warmup: int = 100  # steps of linear warm-up, then the schedule
    # cosine to zero | constant | stairs: divided by ten every ``stair`` steps | late: constant, then linear to zero
    # over the last ``tail`` of the steps, so that the number of steps may be changed during the run
    schedule: Literal["cosine", "constant", "stairs", "late"] = "cosine"
    stair: int = 0
    tail: float = 0.3
    optimiser: Literal["adamw", "adam", "sgd"] = "adamw"  # the last two take weight_decay as an L2 penalty
    momentum: float = 0.9  # of SGD, or Adam's first beta
    beta2: float = 0.98  # Adam's second
    weight_decay: float = 0.01
    clip: float = 20.0  # largest gradient norm
    average: float = 0.998  # decay of the moving average of the weights, which is exported
    seed: int = 0
    bfloat16: bool = False  # half precision where it is faster: on a GPU, and 2.5 times on a CPU with AMX
    threads: int = 1  # CPU threads
    log_every: int = 50  # steps between two rows of log.csv
    validate_every: int = 500  # steps between two validations, each of which adds a row to log.csv too
    checkpoint_minutes: float = 3.0
    continues: str = ""  # configuration whose finished run this one starts from; it needs --start
    shipped: str = ""  # shipped network with whose weights a new run begins, if it names none
    keep_at: int = 0  # step whose checkpoint is kept as checkpoint-STEP.pt, for other runs to start from
    network: dict[str, Any] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    loss: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "threads", "log_every", "validate_every"):
            if getattr(self, name) < 1:
                raise UsageError(f"'{name}' must be at least 1, got {getattr(self, name)}")
        if not 0 < self.tail <= 1:
            raise UsageError(f"'tail', the share of the steps with a falling rate, must be in 0 ... 1, got {self.tail}")
        if self.schedule == "stairs" and self.stair < 1:
            raise UsageError(f"'stair', the steps from one stair to the next, must be at least 1, got {self.stair}")


def shipped_configs() -> list[str]:
    """Names of the configurations that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def find_config(name: str | Path, folder: Path = Path()) -> Path:
    """Returns the file of a shipped configuration, or of one at a path relative to a folder."""
    if str(name) in shipped_configs():
        return _SHIPPED / f"{name}.toml"
    path = folder / name
    if path.suffix == ".toml" or len(Path(name).parts) > 1 or path.is_file():
        return path
    raise UsageError(
        f"unknown configuration '{name}': give a TOML file, or one of these names: {', '.join(shipped_configs())}"
    )


def load_config(name: str | Path, base: str | Path | None = None) -> TrainConfig:
    """Reads a configuration. Its key ``base`` names another one that supplies missing settings.

    Args:
        name: name of a shipped configuration, or path of a TOML file.
        base: replaces the base named in the file, which is relative to the file's own folder.
    """
    path = find_config(name)
    table = _read(path, None if base is None else find_config(base))
    if "model" not in table:
        raise UsageError(f"{path} does not say which model to train (model = ...)")
    return from_table(TrainConfig, table, str(path))


def _read(path: Path, base: Path | None = None, depth: int = 0) -> dict[str, Any]:
    """Returns the file's table merged over that of its base."""
    if depth > _MOST_BASES:
        raise UsageError(f"{path}: too many files, each the base of another")
    table = _parsed(path)
    named = table.pop("base", None)
    if base is None and named is None:
        return table
    if base is None and not isinstance(named, str):
        raise UsageError(f"{path}: 'base' must be a TOML file or a shipped configuration's name, got {named!r}")
    below = _read(base or find_config(str(named), path.parent), depth=depth + 1)
    inner = {name: {**below.get(name, {}), **value} for name, value in table.items() if isinstance(value, dict)}
    return {**below, **table, **inner}


def _parsed(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        shipped = path.stem in shipped_configs()
        hint = f"; the one that comes with unshutter is called '{path.stem}'" if shipped else ""
        raise UsageError(f"cannot read {path}: {error.strerror}{hint}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None


def from_table(kind: type[T], table: dict[str, Any], where: str) -> T:
    """Creates a flat dataclass from a table with the same names; integers may stand for floats."""
    known = get_type_hints(kind)
    values = {}
    for name, value in table.items():
        if name not in known:
            raise UsageError(f"{where}: unknown setting '{name}'; known are {', '.join(known)}")
        of = get_origin(known[name]) or known[name]
        if of is Literal and value not in get_args(known[name]):
            raise UsageError(f"{where}: unknown {name} '{value}': choose {' or '.join(get_args(known[name]))}")
        if of is float and type(value) is int:
            value = float(value)
        if of is not Literal and type(value) is not of:
            raise UsageError(f"{where}: '{name}' must be of type {of.__name__}, got {value!r}")
        values[name] = value
    return kind(**values)
