"""Draws how two real clips wobble, before and after: ``python docs/figures/draw_wobble.py`` (needs the extra ``plot``).

The steps (docs/results/real-clips-steps.csv) are those of the protocol ``real-clips``: skew and stretch together, from
one frame to the next, at the first and last rows, in pixels of the clip.
"""

import csv
from collections import defaultdict
from pathlib import Path

import matplotlib.pyplot as plt

HERE = Path(__file__).parent
STEPS = HERE.parent / "results" / "real-clips-steps.csv"
COLOURS = {"as taken": "#c62828", "straightened": "#1565c0"}


def main() -> None:
    """Writes real_wobble.svg."""
    plt.rcParams["svg.hashsalt"] = "unshutter"  # same drawing, same bytes
    curves: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    with STEPS.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            curves[row["clip"]][row["state"]].append(float(row["step [px]"]))
    figure, axes = plt.subplots(1, len(curves), figsize=(11, 3), constrained_layout=True)
    for axis, (clip, states) in zip(axes, curves.items(), strict=True):
        for state, steps in states.items():
            axis.plot(steps, color=COLOURS[state], lw=1.2, label=state)
        axis.set(title=clip, xlabel="pair of frames that could be followed", ylabel="wobble, px", ylim=(0, None))
        axis.margins(x=0.01)
        axis.legend(frameon=False, fontsize=9)
    figure.savefig(HERE / "real_wobble.svg", metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    plt.switch_backend("svg")
    main()
