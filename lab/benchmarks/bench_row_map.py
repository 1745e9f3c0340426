"""Compares the residual of kandula2020-research's row block with that of the true motion.

    python lab/benchmarks/bench_row_map.py PHOTOS [NETWORK]

NETWORK is an exported one; without it, the shipped one is measured.

Each photo of the folder PHOTOS (and below it) is distorted by one random motion, as in training, seed 1.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from unshutter_lab.methods.networks import SIZE
from unshutter_lab.methods.onnx import onnx_runtime
from unshutter_lab.training.motions import draw_motions
from unshutter_lab.training.pixels import load_photos, pixel_grid, rs_positions, synthesise

WEIGHTS = Path(__file__).parents[1] / "src" / "unshutter_lab" / "weights" / "kandula2020-research.onnx"
CANVAS = 356


def main() -> None:
    weights = Path(sys.argv[2]) if len(sys.argv) > 2 else WEIGHTS
    network = onnx_runtime().InferenceSession(weights, providers=["CPUExecutionProvider"])
    generator = torch.Generator().manual_seed(1)
    pairs = [residuals(network, photo, generator) for photo in load_photos(Path(sys.argv[1]), CANVAS)]
    found, true = (np.stack(arrays) for arrays in zip(*pairs, strict=True))
    print(f"{len(pairs)} photos; residual of the row map in rows of {SIZE}")
    for name, values in (("row block", found), ("true motion", true)):
        rms = np.sqrt((values**2).mean((1, 2)))
        print(f"{name}: RMS of a photo, median {np.median(rms):.2f}; largest anywhere {np.abs(values).max():.1f}")
    both = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(found, true, strict=True) if b.std() > 0.1]
    print(f"correlation of the two over a photo's pixels, median {np.median(both):.2f} ({len(both)} photos that turn)")


def residuals(network: Any, photo: np.ndarray, generator: torch.Generator) -> tuple[np.ndarray, np.ndarray]:
    """[r, r] rows: what the row block adds to A, and what the true motion would."""
    top, left = ((length - CANVAS) // 2 for length in photo.shape[1:])
    canvas = torch.from_numpy(np.ascontiguousarray(photo[:, top : top + CANVAS, left : left + CANVAS]))[None]
    samples = synthesise(canvas, *draw_motions(1, generator), SIZE)
    row_map = network.run(["row_map"], {"rs": samples.rs.numpy()})[0][0]
    row = pixel_grid(SIZE, samples.rs)[1].numpy()
    true = rs_positions(torch.stack(samples.row_motion(), 1), None)[1][0].numpy()
    return row_map - row, true - row


if __name__ == "__main__":
    main()
