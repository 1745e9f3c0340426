"""Measures the ablations of the paper's network, and writes docs/results/paper-networks.md.

    python lab/benchmarks/paper_networks.py DATA RUNS [--jobs 2]

DATA as for results.py. RUNS holds what ablations.py leaves: RUNS/seedN/NAME/model.onnx. Their weights are
not part of the repository, so ``make results`` leaves this page as it is.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from results import REAL, TEST

from unshutter_lab.evaluation.results import Results

DOCS = Path("docs/results")
PAGE = DOCS / "paper-networks.md"  # written by hand up to its first heading of a table, which is kept
WHOLE = "whole"  # the row that others are compared with
NAMES = {"kandula2020-cpu-long-pictures": WHOLE, "kandula2020-": ""}  # of networks -> of rows
RESEARCH = "kandula2020-research"  # it runs networks with a row block
DRAWS = 4000  # of photos and seeds, for an interval


def epe(results: Results, network: str, folder: str) -> dict[str, list[float]]:
    """Photo -> errors [px] of its pictures."""
    records = results.chosen(estimator=network, group=folder, suite="256 px")
    return records.groupby("photo", sort=False)["epe"].apply(list).to_dict()


def gain_db(results: Results, network: str, folder: str) -> dict[str, list[float]]:
    """Photo -> gains [dB] of its pictures."""
    records = results.chosen(estimator=network, group=folder, suite="middle row").dropna(subset="psnr")
    return (records["psnr"] - records["psnr_input"]).groupby(records["photo"], sort=False).apply(list).to_dict()


Figure = Callable[[Results, str, str], dict[str, list[float]]]
# protocol -> (title, folders, options, figure, mean of a folder's figures, how it is written)
RUNS: dict[str, tuple[str, list[str], list[str], Figure, Callable[..., Any], str]] = {
    "synthetic": (
        "Synthetic motions: median EPE [px of 256 rows]",
        TEST,
        ["--photos", "40", "--per-photo", "2"],
        epe,
        np.median,
        "{:.2f}",
    ),
    "pairs": ("Real pairs, middle row: mean gain in PSNR [dB]", REAL, [], gain_db, np.mean, "{:+.2f}"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--jobs", default="2")
    given = parser.parse_args()
    networks = sorted(given.runs.glob("seed*/*/model.onnx"))
    if not networks:
        sys.exit(f"paper_networks: no {given.runs}/seedN/NAME/model.onnx: lab/benchmarks/ablations.py trains them")
    parts = [PAGE.read_text().partition("\n## ")[0].strip()]
    for protocol, (title, folders, options, figure, middle, form) in RUNS.items():
        words = ["evaluate", "--protocol", protocol, "--data", *(str(given.data / folder) for folder in folders)]
        estimators = ["none", RESEARCH, *(f"{RESEARCH}@{path}" for path in networks)]
        words += [*options, "--estimators", ",".join(estimators)]
        output = Path("build", "paper-networks", protocol)
        command = [sys.executable, "-m", "unshutter", *words, "-o", str(output), "--jobs", given.jobs, "--overwrite"]
        if subprocess.run(command).returncode:
            sys.exit(f"paper_networks: stopped; what was measured is kept in {output}")
        parts += [f"## {title}", table(Results.load(output / "results.json"), networks, figure, middle, form)]
    PAGE.write_text("\n\n".join(parts) + "\n\n[All results](index.md)\n")
    print(f"wrote {PAGE}")


def table(results: Results, networks: list[Path], figure: Figure, middle: Callable[..., Any], form: str) -> str:
    """A row for each network: its figures, means of the seeds, and its difference from the whole network."""
    folders = results.distinct("group")
    rows: dict[str, list[str]] = {name: [name] for name in ("none", RESEARCH)}
    for path in networks:
        rows.setdefault(row_name(path.parent.name), []).append(f"{RESEARCH}@{path}")
    values = {row: [[figure(results, n, folder) for folder in folders] for n in seeds] for row, seeds in rows.items()}
    lines = ["| | " + " | ".join([*folders, "mean", "difference from whole"]) + " |", "|---" * (len(folders) + 3) + "|"]
    for row, seeds in values.items():
        of_folders = [np.mean([middle(_all(of_seed[k])) for of_seed in seeds]) for k in range(len(folders))]
        cells = [form.format(value) for value in (*of_folders, np.mean(of_folders))]
        is_ablation = row != WHOLE and len(seeds) == len(values.get(WHOLE, [])) > 1
        cells.append(_difference(seeds, values[WHOLE]) if is_ablation else "")
        lines.append(f"| {row} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _all(values: dict[str, list[float]]) -> list[float]:
    return [value for of_photo in values.values() for value in of_photo]


def _difference(row: list[list[dict[str, list[float]]]], whole: list[list[dict[str, list[float]]]]) -> str:
    """Mean difference, paired by photo and seed, and its 95 % interval: photos and seeds drawn with replacement."""
    differences = np.array(
        [
            [
                np.mean(of_row[photo]) - np.mean(of_whole[photo])
                for of_row, of_whole in zip(*pair, strict=True)
                for photo in of_whole
            ]
            for pair in zip(row, whole, strict=True)
        ]
    )
    dice = np.random.default_rng(0)
    seeds, photos = differences.shape
    drawn = [
        differences[dice.integers(seeds, size=seeds)][:, dice.integers(photos, size=photos)].mean()
        for _ in range(DRAWS)
    ]
    low, high = np.percentile(drawn, (2.5, 97.5))
    return f"{differences.mean():+.2f} ({low:+.2f} to {high:+.2f})"


def row_name(network: str) -> str:
    for start, short in NAMES.items():
        if network.startswith(start):
            return short + network.removeprefix(start)
    return network


if __name__ == "__main__":
    main()
