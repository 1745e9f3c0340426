"""Opens exported networks (ONNX), each on one thread, or says in one line why a file is not that network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession


def open_network(
    name: str, weights: Path | None, inputs: Sequence[str], answer: str, opens_fast: bool = False
) -> InferenceSession:
    """Opens the network of an estimator.

    Args:
        name: of the estimator.
        weights: the exported network.
        inputs: names of what it takes.
        answer: name of its first output.
        opens_fast: skip the optimisation of the graph. Right for a small one with a loop: it runs no slower (40 ms
            either way), but opens in 27 ms instead of 95.

    Raises:
        UnshutterError: there is no file, or it is not this network.
    """
    if weights is None:
        raise UnshutterError(f"{name} needs the weights of a network")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 3
    if opens_fast:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_free_dimension_override_by_name("batch_size", 1)  # the more is known, the less there is to plan
        options.enable_mem_reuse = False  # planning it takes a third of the opening, and saves nothing measurable
    try:
        session = onnxruntime.InferenceSession(str(weights), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own kinds have no common parent
        raise UnshutterError(f"cannot use the weights {weights}: {str(error).splitlines()[0]}") from None
    if [i.name for i in session.get_inputs()] != list(inputs) or session.get_outputs()[0].name != answer:
        raise UnshutterError(f"cannot use the weights {weights}: they are not of {name}")
    return session
