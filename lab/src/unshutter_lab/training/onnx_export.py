"""Exports networks to ONNX by tracing."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import BinaryIO

import torch
from torch import Tensor, nn


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
        example: inputs for tracing.
        target: file, or a stream to write to.
        inputs, outputs: their names.
        free: name -> axis -> name of the dimension, for axes of variable length.
    """
    with warnings.catch_warnings():  # the tracer's warnings about shapes that are intentionally fixed
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
