"""Draws docs/figures/training.svg from the log of kandula2020-research: ``python docs/figures/draw_training.py``.

Needs the extra ``plot``. Another log can be named: ``python docs/figures/draw_training.py runs/NAME/log.csv``.
"""

import csv
import sys
from pathlib import Path

import matplotlib.pyplot as plt

HERE = Path(__file__).parent
LOG = HERE.parent.parent / "lab" / "src" / "unshutter_lab" / "weights" / "kandula2020-research.log.csv"
BATCH = 32  # samples of a step
CURVES = {  # column of the log -> (panel, label, colour)
    "val_epe_median": (0, "photos held out", "#c62828"),
    "train_epe": (0, "training photos, unchanged", "#1565c0"),
    "train_epe_as_seen": (0, "training photos, as training sees them", "#2e7d32"),
    "val_epe_hand": (1, "hand shake", "#6a1b9a"),
    "val_epe_pan": (1, "pans", "#ef6c00"),
}
KINDS = {"val_epe_median": (1, "quadratics of the predecessor", "#c62828")}


def main() -> None:
    """Draws both panels."""
    log = Path(sys.argv[1]) if len(sys.argv) > 1 else LOG
    with log.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("val_epe_median")]
    samples = [int(row["step"]) * BATCH / 1000 for row in rows]
    plt.switch_backend("svg")
    plt.rcParams["svg.hashsalt"] = "unshutter"  # same drawing, same bytes
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.8), sharey=True)
    for column, (panel, label, colour) in [*CURVES.items(), *KINDS.items()]:
        values = [float(row[column]) if row.get(column) else float("nan") for row in rows]
        axes[panel].plot(samples, values, color=colour, label=label, lw=1.6, marker=".")
    axes[0].set(title="seen in training or not", xlabel="thousand samples", ylabel="median EPE [px of 256 rows]")
    axes[1].set(title="kinds of motion, photos held out", xlabel="thousand samples")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.legend(fontsize=9)
    figure.tight_layout()
    figure.savefig(HERE / "training.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
