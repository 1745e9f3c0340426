"""The list of methods for ``unshutter models``: description, size of the weights, and measured accuracy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from unshutter.estimators.method import Method
from unshutter.estimators.register import method, names
from unshutter.options import DEFAULT_ESTIMATOR


@dataclass(frozen=True)
class Listed:
    """A method as listed by ``unshutter models``.

    Attributes:
        method: the method's entry in the register.
        weights_mb: size of its weights in the package [MB]; 0 if it needs none.
        scores: set of photos -> (median EPE [px at 256 rows], share of photos improved); empty if not measured.
    """

    method: Method
    weights_mb: float
    scores: dict[str, tuple[float, float]]


def list_models() -> list[Listed]:
    """Returns all methods that can be used without further files, the default first."""
    listed = []
    for name in sorted(names(), key=lambda name: name != DEFAULT_ESTIMATOR):
        known = method(name)
        size = known.weights.stat().st_size / 1e6 if known.weights else 0.0
        scores = _scores(known.scores).get(name, {}) if known.scores else {}
        own = {place: (float(s["epe_median"]), float(s["improved"])) for place, s in scores.items()}
        listed.append(Listed(known, size, own))
    return listed


@cache
def _scores(path: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Reads the scores: method -> set of photos -> figures."""
    return json.loads(path.read_text(encoding="utf-8"))


def as_text(listed: list[Listed]) -> str:
    """Formats the list as a table for a terminal, with an explanation of its figures."""
    places = list(dict.fromkeys(place for each in listed for place in each.scores))
    head = ["name", "weights", *places]
    rows = [[each.method.name, _size(each), *(_score(each, place) for place in places)] for each in listed]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in [head, *rows]
    ]
    if places:
        lines += ["", "Median error in px at 256 rows, and the share of photos that got better (docs/results)."]
    lines += ["", *(_line(each.method) for each in listed)]
    return "\n".join(lines)


def _line(known: Method) -> str:
    return f"{known.name}{' (default)' if known.name == DEFAULT_ESTIMATOR else ''}: {known.summary}"


def _size(listed: Listed) -> str:
    return f"{listed.weights_mb:.1f} MB" if listed.weights_mb else "-"


def _score(listed: Listed, place: str) -> str:
    if place not in listed.scores:
        return "-"
    error, improved = listed.scores[place]
    return f"{error:.2f} {100 * improved:.0f} %"
