"""Networks traced into ONNX, and their files made small."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from onnx import NodeProto

_SMALL = 256  # numbers: what is smaller is left as it is
_MOST_IN_16_BITS = 65_504.0


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
    import onnx  # not above: a machine that only trains does without
    from onnx import numpy_helper

    model = onnx.load(path)
    graph = model.graph
    kernels = {node.input[1] for node in graph.node if node.op_type == "Conv"} if eight_bits else set()
    stored, decoders = [], []
    for weights in graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.dtype != np.float32 or values.size < _SMALL or np.abs(values).max() > _MOST_IN_16_BITS:
            stored.append(weights)
            continue
        parts, decoder = _in_8_bits(weights.name, values) if weights.name in kernels else _in_16(weights.name, values)
        stored += [numpy_helper.from_array(array, name) for name, array in parts.items()]
        decoders.append(decoder)
    nodes = [*decoders, *graph.node]
    del graph.initializer[:], graph.node[:]
    graph.initializer.extend(stored)
    graph.node.extend(nodes)
    part = path.with_name(f"{path.name}.part")
    onnx.save(model, part)
    part.replace(path)


def _in_8_bits(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], NodeProto]:
    """What is stored, by name, and the node that makes the weights [out, ...] of it."""
    from onnx import helper

    scale = np.maximum(np.abs(values).reshape(len(values), -1).max(1), np.finfo(np.float32).tiny) / 127
    steps = np.rint(values / scale.reshape(-1, *[1] * (values.ndim - 1))).astype(np.int8)
    parts = {f"{name}.int8": steps, f"{name}.scale": scale}
    return parts, helper.make_node("DequantizeLinear", list(parts), [name], axis=0)


def _in_16(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], NodeProto]:
    from onnx import TensorProto, helper

    half = f"{name}.float16"
    return {half: values.astype(np.float16)}, helper.make_node("Cast", [half], [name], to=TensorProto.FLOAT)
