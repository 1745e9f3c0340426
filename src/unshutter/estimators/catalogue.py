"""What estimators there are: what each does, how large its weights are, how well it did."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import files
from types import ModuleType

from unshutter.estimators import DEFAULT, ESTIMATORS

SCORES = "scores.json"  # among the weights; written with docs/results, never by hand


@dataclass(frozen=True)
class Model:
    """An estimator as ``unshutter models`` lists it.

    Attributes:
        name: under which it is registered.
        about: one line.
        weights_mb: size of the weights in the package that it runs on [MB]; 0 where it needs none.
        scores: set of photos -> (median EPE [px at 256 rows], share of photos improved); empty if not measured.
    """

    name: str
    about: str
    weights_mb: float
    scores: dict[str, tuple[float, float]]


def list_models() -> list[Model]:
    """All registered estimators, the default first."""
    weights = files("unshutter") / "weights"
    scored = weights / SCORES
    scores = json.loads(scored.read_text(encoding="utf-8")) if scored.is_file() else {}
    names = sorted(ESTIMATORS, key=lambda name: name != DEFAULT)
    models = []
    for name in names:
        module = import_module(ESTIMATORS[name].partition(":")[0])
        network = weights / f"{getattr(module, 'WEIGHTS', name)}.onnx"
        size = len(network.read_bytes()) / 1e6 if network.is_file() else 0.0
        own = {place: (float(s["epe_median"]), float(s["improved"])) for place, s in scores.get(name, {}).items()}
        models.append(Model(name, _about(name, module), size, own))
    return models


def as_text(models: list[Model]) -> str:
    """The list as a table for a terminal, then what its figures mean."""
    places = list(dict.fromkeys(place for model in models for place in model.scores))
    head = ["name", "weights", *places]
    rows = [[m.name, _size(m), *(_score(m, place) for place in places)] for m in models]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in [head, *rows]
    ]
    if places:
        lines += ["", "Median error in px at 256 rows, and the share of photos that got better (docs/results)."]
    lines += ["", *(f"{m.name}{' (default)' if m.name == DEFAULT else ''}: {m.about}" for m in models)]
    return "\n".join(lines)


def _about(name: str, module: ModuleType) -> str:
    """What the first line of the estimator's file says, less its name."""
    first = (module.__doc__ or "").strip().split("\n\n")[0]
    return " ".join(first.removeprefix(f"{name}:").split()).rstrip(".")


def _size(model: Model) -> str:
    return f"{model.weights_mb:.1f} MB" if model.weights_mb else "-"


def _score(model: Model, place: str) -> str:
    if place not in model.scores:
        return "-"
    error, improved = model.scores[place]
    return f"{error:.2f} {100 * improved:.0f} %"
