"""Networks traced into ONNX, and their files made small."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import BinaryIO

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch import Tensor, nn

_SMALL = 256  # numbers: what is smaller is left as it is


def export_onnx(
    network: nn.Module,
    example: tuple[Tensor, ...],
    target: Path | BinaryIO,
    inputs: list[str],
    outputs: list[str],
    free: dict[str, dict[int, str]],
) -> None:
    """Writes a network as ONNX.

    Args:
        network: in evaluation mode, on the CPU.
        example: inputs to trace it with.
        target: file, or a stream to write to.
        inputs, outputs: their names.
        free: name -> axis -> what it counts, for the axes whose length is not fixed.
    """
    with warnings.catch_warnings():  # the tracer's notes about shapes that are fixed, as they should be
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            example,
            str(target) if isinstance(target, Path) else target,  # type: ignore[arg-type]  # a stream works, too
            input_names=inputs,
            output_names=outputs,
            dynamic_axes=free,
            opset_version=18,
            dynamo=False,
        )


def store_small(path: Path, eight_bits: bool = False) -> None:
    """Stores the weights of an exported network in fewer bits; it goes on calculating in 32.

    Args:
        path: of the ONNX file, which is replaced.
        eight_bits: convolutions' weights as 8-bit integers with a scale for each output channel; all others, and all
            weights without it, as 16-bit floating point.
    """
    model = onnx.load(path)
    graph = model.graph
    kernels = {node.input[1] for node in graph.node if node.op_type == "Conv"} if eight_bits else set()
    stored, decoders = [], []
    for weights in graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.dtype != np.float32 or values.size < _SMALL:
            stored.append(weights)
        elif weights.name in kernels:
            scale = np.maximum(np.abs(values).reshape(len(values), -1).max(1), np.finfo(np.float32).tiny) / 127
            steps = np.rint(values / scale.reshape(-1, *[1] * (values.ndim - 1))).astype(np.int8)
            parts = [f"{weights.name}.int8", f"{weights.name}.scale"]
            stored += [numpy_helper.from_array(a, n) for a, n in zip((steps, scale), parts, strict=True)]
            decoders.append(helper.make_node("DequantizeLinear", parts, [weights.name], axis=0))
        else:
            half = f"{weights.name}.float16"
            stored.append(numpy_helper.from_array(values.astype(np.float16), half))
            decoders.append(helper.make_node("Cast", [half], [weights.name], to=onnx.TensorProto.FLOAT))
    nodes = [*decoders, *graph.node]
    del graph.initializer[:], graph.node[:]
    graph.initializer.extend(stored)
    graph.node.extend(nodes)
    onnx.save(model, path)
