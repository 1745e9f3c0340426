"""Runs exported networks (ONNX), each time in a process of its own: ``python -m unshutter_lab.methods.onnx``.

This is the only module that imports onnxruntime, which from version 1.31 on contains a telemetry client that must be
disabled before the import.
"""

from __future__ import annotations

import io
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.errors import WeightsError
from unshutter.single.own_process import answer, run_in_own_process


def run_network(
    name: str, weights: Path | None, rs: np.ndarray, first: str, *shapes: tuple[int, ...]
) -> list[np.ndarray]:
    """Runs an estimator's network once.

    Args:
        name: name of the estimator.
        weights: the network's file.
        rs: its only input, of that name.
        first: name of its first output.
        shapes: expected shapes of the outputs. There may be fewer outputs than shapes, but at least one.

    Returns:
        The outputs, float64.
    """
    if weights is None:
        raise WeightsError(f"{name} needs the weights of a network")
    request = io.BytesIO()
    np.save(request, rs)
    words = json.dumps({"name": name, "first": first, "shapes": shapes})
    done = run_in_own_process("unshutter_lab.methods.onnx", weights, words, request.getvalue())
    with np.load(io.BytesIO(done), allow_pickle=False) as outputs:
        return [outputs[key] for key in outputs]


def onnx_runtime() -> Any:
    """Returns the module onnxruntime, with telemetry disabled."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read when the library is loaded
    import onnxruntime

    return onnxruntime


def _outputs(weights: Path, words: str) -> bytes:
    """Runs the network on the array in the standard input."""
    expected = json.loads(words)
    rs = np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False)
    onnxruntime = onnx_runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_inputs()], session.get_outputs()[0].name
    if names != (["rs"], expected["first"]):
        raise ValueError(f"they are not {expected['name']} weights")
    outputs = [np.asarray(output) for output in session.run(None, {"rs": rs})]
    if [list(output.shape) for output in outputs] != expected["shapes"][: len(outputs)]:
        raise ValueError(f"they are not {expected['name']} weights")
    if not all(output.dtype.kind == "f" and np.isfinite(output).all() for output in outputs):
        raise ValueError("its answer is not a number")
    stored = io.BytesIO()
    np.savez(stored, *(output.astype(np.float64) for output in outputs))
    return stored.getvalue()


if __name__ == "__main__":
    answer(_outputs)
