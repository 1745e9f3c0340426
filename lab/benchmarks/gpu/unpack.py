"""Unpacks the parcels of a lent machine into runs: RUNS/NAME with its checkpoint and log.

python lab/benchmarks/gpu/unpack.py PARCELS RUNS
unshutter train --config NAME --steps STEPS --out RUNS --photos FOLDER    # of a finished run it only writes model.onnx
"""

from __future__ import annotations

import sys
from pathlib import Path

import parcels
import torch


def main() -> None:
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder, runs = map(Path, sys.argv[1:])
    for name in parcels.names(folder):
        parcels.unpack(name, folder, runs)
        steps = torch.load(runs / name / parcels.CHECKPOINT, weights_only=True)["step"]
        print(f"{runs / name}: {steps} steps")


if __name__ == "__main__":
    main()
