"""Trains the ablations of kandula2020 on one CPU core, with several seeds: two hours a seed.

    python benchmarks/ablations.py PHOTOS RUNS [--seeds 0 1]

Each seed has a first phase of its own (64,000 samples regressing the true motion), from which each ablation has 6,400
samples of the second. RUNS/seed0/NAME/model.onnx is what benchmarks/paper_networks.py measures. A run that was stopped
goes on, one that is finished is left alone.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

MOTION, WHOLE = "kandula2020-cpu-motion", "kandula2020-cpu"
MOTION_STEPS, STEPS = 2000, 200  # of 32 samples
PARTS = ("no-trajectory", "row3", "exact-inverse", "no-regeneration", "no-edges", "regressed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    given = parser.parse_args()
    for seed in given.seeds:
        folder = given.runs / f"seed{seed}"
        common = ["--photos", str(given.photos), "--out", str(folder), "--seed", str(seed)]
        _train(MOTION, folder, [*common, "--steps", str(MOTION_STEPS)])
        common += ["--start", str(folder / MOTION / "checkpoint.pt"), "--steps", str(STEPS)]
        _train(WHOLE, folder, common)
        for part in PARTS:
            _train(f"kandula2020-{part}", folder, [*common, "--base", WHOLE])


def _train(config: str, folder: Path, words: list[str]) -> None:
    if (folder / config / "model.onnx").exists():
        return
    command = [sys.executable, "-m", "unshutter", "train", "--config", config, *words]
    print("+", *command[1:], flush=True)
    if subprocess.run(command).returncode:
        sys.exit(f"ablations: stopped at {config}; run it again to go on")


if __name__ == "__main__":
    main()
