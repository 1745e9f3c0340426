"""What a training run tells: log.csv for later, and a progress bar (on a terminal) or lines (in a file) for now."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any


class TrainingLog:
    """log.csv, one row per logged step; rows beyond the checkpoint that a run resumes from are dropped.

    Args:
        path: of log.csv.
        step, steps: steps done, and in all.
        quiet: tell nothing (all but the first of several processes).
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
        """One more step is done."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=step)

    def add(self, row: dict[str, Any]) -> None:
        """Writes a row; ``step`` and ``seconds`` are among its names."""
        if self._quiet:
            return
        self._rows.append({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})
        names = list(dict.fromkeys(name for r in self._rows for name in r))
        with self._path.open("w", newline="") as file:
            writer = csv.DictWriter(file, names, restval="")
            writer.writeheader()
            writer.writerows(self._rows)
        figures = "  ".join(f"{k} {v}" for k, v in self._rows[-1].items() if k not in ("step", "seconds"))
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], figures=self._shown())
        else:
            left = row["seconds"] / row["step"] * (self._steps - row["step"]) / 60
            print(f"{row['step']}/{self._steps}  {left:.0f} min left  {figures}", flush=True)

    def _shown(self) -> str:
        """The newest loss and the newest validation figures."""
        newest = {name: value for row in self._rows for name, value in row.items() if value != ""}
        wanted = [name for name in newest if name == "loss" or name.startswith("val_")]
        return "  ".join(f"{name} {newest[name]}" for name in wanted)


def _bar(step: int, steps: int) -> Any:
    """Rich's progress bar; None where there is no terminal, or no rich (a bare training machine)."""
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
