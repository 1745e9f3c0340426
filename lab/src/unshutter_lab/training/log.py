"""Records a training run: log.csv, and a progress bar (on a terminal) or lines (elsewhere)."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any


class TrainingLog:
    """Writes log.csv, with one row per logged step.

    Rows beyond the checkpoint from which a run resumes are dropped.

    Args:
        path: path of log.csv.
        step: steps done so far.
        steps: total number of steps.
        quiet: write and show nothing (for all but the first of several processes).
    """

    def __init__(self, path: Path, step: int, steps: int, quiet: bool):
        self._path, self._steps, self._quiet = path, steps, quiet
        self._rows: list[dict[str, Any]] = []
        self._bar = None if quiet else _bar(step, steps)
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
        if self._quiet:
            return
        self._rows.append({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})
        columns = list(dict.fromkeys(name for r in self._rows for name in r))
        with self._path.open("w", newline="") as file:
            writer = csv.DictWriter(file, columns, restval="")
            writer.writeheader()
            writer.writerows(self._rows)
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], figures=self._newest())
        else:
            left = row["seconds"] / row["step"] * (self._steps - row["step"]) / 60
            figures = "  ".join(f"{k} {v}" for k, v in self._rows[-1].items() if k not in ("step", "seconds"))
            print(f"{row['step']}/{self._steps}  {left:.0f} min left  {figures}", flush=True)

    def _newest(self) -> str:
        """Returns the latest loss and validation figures."""
        newest = {name: value for row in self._rows for name, value in row.items() if value != ""}
        columns = [name for name in newest if name == "loss" or name.startswith("val_")]
        return "  ".join(f"{name} {newest[name]}" for name in columns)


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
