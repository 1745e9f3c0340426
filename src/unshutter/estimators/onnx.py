"""Exported networks (ONNX): opened on one thread, refused in one line when they are not what they should be."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

_SHIPPED = Path(__file__).parents[1] / "weights"  # importlib.resources says the same, but takes 10 ms to import


def open_network(
    name: str,
    inputs: Sequence[str],
    answer: str,
    weights: str | os.PathLike[str] | None = None,
    opens_fast: bool = False,
) -> InferenceSession:
    """The network of an estimator.

    Args:
        name: of the estimator.
        inputs: names of what it takes.
        answer: name of its first output.
        weights: path of an exported network; by default the package's own.
        opens_fast: take the graph as it is. Right for a small one with a loop: it runs no slower (40 ms either way),
            but is open in 27 instead of 95 ms.

    Raises:
        UnshutterError: the file holds no network of this kind.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 3
    if opens_fast:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_free_dimension_override_by_name("batch_size", 1)  # the more is known, the less there is to plan
        options.enable_mem_reuse = False  # planning it takes a third of the opening, and saves nothing measurable
    path = weights or _SHIPPED / f"{name}.onnx"
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own kinds have no common parent
        raise UnshutterError(f"cannot use the weights {path}: {str(error).splitlines()[0]}") from None
    if [i.name for i in session.get_inputs()] != list(inputs) or session.get_outputs()[0].name != answer:
        raise UnshutterError(f"cannot use the weights {path}: they are not of {name}")
    return session
