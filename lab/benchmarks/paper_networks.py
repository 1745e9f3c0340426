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

import numpy as np
from results import REAL, TEST

from unshutter_lab.evaluation.results import Results

DOCS = Path("docs/results")
PAGE, READING = DOCS / "paper-networks.md", DOCS / "paper-networks-reading.md"  # the reading is written by hand
NAMES = {"kandula2020-cpu-ablation": "whole", "kandula2020-": ""}  # of networks -> of rows


def median_epe(results: Results, network: str, folder: str) -> float:
    return float(np.median(results.values("epe", estimator=network, group=folder, suite="256 px")))


def gain_db(results: Results, network: str, folder: str) -> float:
    of_row = results.chosen(estimator=network, group=folder, suite="middle row")
    pictures = [r for r in of_row if r.get("psnr") is not None]
    return float(np.mean([r["psnr"] - r["psnr_input"] for r in pictures]))


Figure = Callable[[Results, str, str], float]
# protocol -> (title, folders, options, figure, how it is written)
RUNS: dict[str, tuple[str, list[str], list[str], Figure, str]] = {
    "synthetic": ("Synthetic motions: median EPE", TEST, ["--photos", "40", "--per-photo", "2"], median_epe, "{:.2f}"),
    "pairs": ("Real pairs, middle row: mean gain in PSNR [dB]", REAL, [], gain_db, "{:+.2f}"),
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
    parts = [READING.read_text().strip()]
    for protocol, (title, folders, options, figure, form) in RUNS.items():
        words = ["evaluate", "--protocol", protocol, "--data", *(str(given.data / folder) for folder in folders)]
        estimators = ["none", "kandula2020", *(f"kandula2020@{path}" for path in networks)]
        words += [*options, "--estimators", ",".join(estimators)]
        output = Path("build", "paper-networks", protocol)
        command = [sys.executable, "-m", "unshutter", *words, "-o", str(output), "--jobs", given.jobs, "--overwrite"]
        if subprocess.run(command).returncode:
            sys.exit(f"paper_networks: stopped; what was measured is kept in {output}")
        parts += [f"## {title}", table(Results.load(output / "results.json"), networks, figure, form)]
    PAGE.write_text("\n\n".join(parts) + "\n\n[All results](index.md)\n")
    print(f"wrote {PAGE}")


def table(results: Results, networks: list[Path], figure: Figure, form: str) -> str:
    """A row for each network, in a column for each folder its figure for each seed, and the mean of them all."""
    folders = results.distinct("group")
    rows: dict[str, list[str]] = {name: [name] for name in ("none", "kandula2020")}
    for path in networks:
        rows.setdefault(row_name(path.parent.name), []).append(f"kandula2020@{path}")
    lines = ["| | " + " | ".join([*folders, "mean"]) + " |", "|---" * (len(folders) + 2) + "|"]
    for row, seeds in rows.items():
        values = np.array([[figure(results, network, folder) for network in seeds] for folder in folders])
        cells = [" / ".join(form.format(value) for value in of_seeds) for of_seeds in [*values, values.mean(0)]]
        lines.append(f"| {row} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def row_name(network: str) -> str:
    for start, short in NAMES.items():
        if network.startswith(start):
            return short + network.removeprefix(start)
    return network


if __name__ == "__main__":
    main()
