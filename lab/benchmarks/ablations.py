"""Trains the ablations of kandula2020 on one CPU core, with several seeds: an hour and a half a seed.

    python lab/benchmarks/ablations.py PHOTOS RUNS [--seeds 0 1]

With each seed, all networks but one share a first phase (64,000 samples regressing the true motion), from which each
has 6,400 samples of the second. The network without a trajectory module has a first phase to itself: with the module,
nothing constrains single rows. RUNS/seed0/NAME/model.onnx is what paper_networks.py measures. A run that was
stopped goes on, one that is finished is left alone.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

MOTION, WHOLE = "kandula2020-cpu-motion", "kandula2020-cpu-ablation"  # the first phase, and the second
ALONE = "kandula2020-no-trajectory"
PARTS = [f"kandula2020-{part}" for part in ("row3", "exact-inverse", "no-regeneration", "no-edges", "regressed")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    given = parser.parse_args()
    for seed in given.seeds:
        folder = given.runs / f"seed{seed}"
        first = folder / "first-phase"
        common = ["--photos", str(given.photos), "--seed", str(seed)]
        shared = _train(MOTION, first, common)
        own = _train(ALONE, first, [*common, "--base", MOTION])
        for config in (WHOLE, ALONE, *PARTS):
            start = own if config == ALONE else shared
            base = [] if config == WHOLE else ["--base", WHOLE]
            _train(config, folder, [*common, "--start", str(start / "checkpoint.pt"), *base])


def _train(config: str, out: Path, words: list[str]) -> Path:
    """Trains a network unless that is done; returns the run's folder."""
    folder = out / config
    if not (folder / "model.onnx").exists():
        command = [sys.executable, "-m", "unshutter", "train", "--config", config, "--out", str(out), *words]
        print("+", *command[1:], flush=True)
        if subprocess.run(command).returncode:
            sys.exit(f"ablations: stopped at {config}; run it again to go on")
    return folder


if __name__ == "__main__":
    main()
