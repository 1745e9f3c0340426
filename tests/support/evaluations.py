"""Evaluations, run as users run them, and what they left."""

import csv
from pathlib import Path

import numpy as np
import pytest

from unshutter.cli import main
from unshutter.photo import Photo


def run(photos: Path, out: Path, *more: str, estimators: str = "none,segment-transformer", jobs: int = 1) -> int:
    words = ["evaluate", "--data", str(photos), "--estimators", estimators, "-o", str(out), "--jobs", str(jobs)]
    return main([*words, *more])


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "results.csv").read_text().splitlines()))


def cells_of(text: str, name: str, heads: tuple[str, ...]) -> list[str]:
    """Cells of an estimator's row in a Markdown table, under these headings."""
    lines = [[cell.strip(" *") for cell in line.split(" | ")] for line in text.splitlines() if " | " in line]
    rows = {cells[1]: cells for cells in lines}
    return [rows[name][rows["estimator"].index(head)] for head in heads]


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    message = capsys.readouterr().err.strip()
    assert message.startswith("unshutter: ") and "\n" not in message and "Traceback" not in message
    return message


def sequence(folder: Path, frames: int = 1, gs_size: tuple[int, int] = (80, 100)) -> Path:
    folder.mkdir(parents=True)
    noise = np.random.default_rng(0).integers(0, 255, (12, 14, 3), np.uint8).repeat(10, 0).repeat(10, 1)
    for k in range(frames):
        Photo.from_array(noise[k : k + 80, :100]).save(folder / f"rs_{k}.png")
        Photo.from_array(noise[k : k + gs_size[0], : gs_size[1]]).save(folder / f"gs_{k}_middle.png")
    return folder
