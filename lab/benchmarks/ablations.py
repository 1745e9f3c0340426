"""Trains the ablations of kandula2020 on one CPU core, with several seeds: about forty minutes a seed.

    python lab/benchmarks/ablations.py PHOTOS START RUNS [--seeds 0 1 2]

START is the checkpoint that a finished run of kandula2020-cpu-long leaves: the first phase, which all rows share. Each
row then has the same 100 steps (3,200 samples) of the second phase, for each seed the same pictures. The rows that
change a layer which the first phase has trained (the row block's, the trajectory module) relearn it before, in 200
steps of the first phase to themselves. RUNS/seed0/NAME/model.onnx is what paper_networks.py measures. A run that was
stopped goes on, one that is finished is left alone.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

FIRST, WHOLE = "kandula2020-cpu-long", "kandula2020-cpu-long-pictures"  # the first phase, and the second
RELEARNT = ("kandula2020-no-trajectory", "kandula2020-row3")
PARTS = [f"kandula2020-{part}" for part in ("regressed", "exact-inverse", "no-regeneration", "no-edges")]
STEPS, STEPS_BEFORE = 100, 200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("start", type=Path)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    given = parser.parse_args()
    for seed in given.seeds:
        folder = given.runs / f"seed{seed}"
        common = ["--photos", str(given.photos), "--seed", str(seed)]
        for config in (WHOLE, *PARTS, *RELEARNT):
            base = [] if config == WHOLE else ["--base", WHOLE]
            start = given.start
            if config in RELEARNT:
                words = [*common, "--base", FIRST, "--start", str(start), "--steps", str(STEPS_BEFORE)]
                start = _train(config, folder / "first-phase", words) / "checkpoint.pt"
            _train(config, folder, [*common, *base, "--start", str(start), "--steps", str(STEPS)])


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
