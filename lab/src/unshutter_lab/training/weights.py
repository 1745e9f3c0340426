"""Weights of networks in files: exports ONNX by tracing, and loads ONNX or checkpoints for a run that starts from them.

Export merges each batch normalisation into the preceding convolution, and compact.py narrows fully connected layers.
Loading undoes both: a narrow pair is multiplied out, and a batch normalisation gets the mean and spread of its inputs
for training pictures, so that the network computes the same in training and in use.
"""

from __future__ import annotations

import pickle
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError


def export_onnx(network: nn.Module, example: Tensor, path: Path, outputs: list[str], *, any_batch: bool = True) -> None:
    """Writes a network in evaluation mode, on the CPU, as ONNX: input ``rs``; batches of any size, or as the example.

    Args:
        network: rs [B, ...] -> outputs [B, ...].
        example: input for tracing.
        path: file to write.
        outputs: their names.
    """
    with warnings.catch_warnings():  # the tracer's warnings about shapes that are intentionally fixed
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            (example,),
            str(path),
            input_names=["rs"],
            output_names=outputs,
            dynamic_axes={name: {0: "batch"} for name in ["rs", *outputs]} if any_batch else None,
            opset_version=18,
            dynamo=False,
        )


def start_from_checkpoint(network: nn.Module, checkpoint: Path) -> None:
    """Copies the averaged weights of another run's checkpoint where name and shape agree; others are unchanged."""
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)["average"]
    except (OSError, KeyError, RuntimeError, pickle.UnpicklingError):
        raise UsageError(f"cannot start from {checkpoint}: it is not a checkpoint of a run") from None
    load_fitting(network, {name.removeprefix("module."): value for name, value in state.items()}, checkpoint)


def load_fitting(network: nn.Module, weights: dict[str, torch.Tensor], path: Path) -> set[str]:
    """Copies the weights whose name and shape the network knows, and returns their names; there must be some."""
    own = network.state_dict()
    fitting = {name: value for name, value in weights.items() if name in own and own[name].shape == value.shape}
    if not fitting:
        raise UsageError(f"cannot start from {path}: it belongs to another network")
    network.load_state_dict(fitting, strict=False)
    return set(fitting)


_KERNEL_NORM = 3**-0.5  # of each output channel of a new convolution; arbitrary with batch normalisation


def load_exported(network: nn.Module, path: Path, pictures: Tensor) -> None:
    """Copies the weights of an exported network by name; others are left unchanged.

    A network with more channels answers as the exported one does: what they compute has no weight in the answer yet.

    Args:
        network: in training mode; modified in place.
        path: path of the ONNX file.
        pictures: [B, 3, r, r] training pictures as the network reads them.
    """
    own = network.state_dict()
    weights = {name: _widened(torch.tensor(value), own.get(name)) for name, value in exported_weights(path).items()}
    fitting = load_fitting(network, weights, path)
    merged, modules = [], dict(network.named_modules())
    for name, norm in modules.items():
        parent, _, number = name.rpartition(".")
        before = f"{parent}.{int(number) - 1}" if number.isdigit() else ""  # the previous module in a sequence
        convolution = modules.get(before)
        if isinstance(norm, nn.BatchNorm2d) and isinstance(convolution, nn.Conv2d) and f"{before}.weight" in fitting:
            bias = weights[f"{before}.bias"]
            merged.append(_Merged(convolution, norm, F.pad(bias, (0, norm.num_features - len(bias)))))
    _restore(network, merged, pictures)


def _widened(given: Tensor, own: Tensor | None) -> Tensor:
    """Returns a layer's own weights, the first outputs of which are computed from the first inputs as given."""
    if own is None or given.ndim != own.ndim or any(n > m for n, m in zip(given.shape, own.shape, strict=True)):
        return given
    whole = own.clone()
    whole[: len(given)] = 0
    whole[tuple(map(slice, given.shape))] = given
    return whole


def exported_weights(path: Path) -> dict[str, np.ndarray]:
    """Returns weights, biases and buffers in 32 bits, by their names in the network; other constants by the graph's."""
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load(path).graph
    except Exception as error:  # onnx's exceptions have no common base class
        raise UsageError(f"cannot start from {path}: {' '.join(str(error).split())}") from None
    known = {weights.name: numpy_helper.to_array(weights) for weights in graph.initializer}
    narrow: dict[str, np.ndarray] = {}  # output of the first layer of a narrow pair -> its weights
    weights: dict[str, np.ndarray] = {}
    for node in graph.node:
        operands = [known.get(name) for name in node.input]
        if node.op_type in ("Cast", "Identity") and operands[0] is not None:
            known[node.output[0]] = operands[0].astype(np.float32)
        elif node.op_type == "DequantizeLinear" and operands[0] is not None and operands[1] is not None:
            scale = operands[1].reshape(-1, *[1] * (operands[0].ndim - 1))
            known[node.output[0]] = operands[0].astype(np.float32) * scale
        elif node.op_type == "Gemm" and len(node.input) == 2 and operands[1] is not None:
            narrow[node.output[0]] = operands[1]
        elif node.op_type == "MatMul" and operands[1] is not None:
            narrow[node.output[0]] = operands[1].T
        elif node.op_type in ("Conv", "Gemm") and operands[1] is not None:
            first = narrow.get(node.input[0])
            name = _module_of(node.output[0])
            if first is not None:
                name = _layer_of_pair(_module_of(node.input[0]), name)
            weights[f"{name}.weight"] = operands[1] if first is None else operands[1] @ first
            if len(operands) > 2 and operands[2] is not None:
                weights[f"{name}.bias"] = operands[2]
    constants = {name: value.astype(np.float32) for name, value in known.items() if value.dtype.kind == "f"}
    return {**constants, **weights}


def _module_of(output: str) -> str:
    """Converts /network/block/base/base.0/base.0.1/Conv_output_0 to block.base.0.1: dotted scopes repeat parents."""
    *parents, last = [scope for scope in output.strip("/").split("/")[:-1] if scope != "network"]
    root = last.partition(".")[0]
    return ".".join([*(scope for scope in parents if scope.partition(".")[0] != root), last])


def _layer_of_pair(first: str, second: str) -> str:
    """Returns the name of the layer that a narrow pair replaces; the pair may be a sequence, x.0 and x.1 for x."""
    layer = second.removesuffix(".1")
    return layer if first == f"{layer}.0" else second


@dataclass
class _Merged:
    """A convolution and the normalisation that export merged into it."""

    convolution: nn.Conv2d
    norm: Any  # nn.BatchNorm2d
    bias: Tensor  # the bias added by the normalisation
    mean: Tensor = field(default_factory=Tensor)  # of the convolution's outputs for the pictures
    variance: Tensor = field(default_factory=Tensor)

    def only_adds(self) -> None:
        """Temporarily makes the normalisation add the bias and nothing else; the convolution adds none."""
        if self.convolution.bias is not None:
            self.convolution.bias.zero_()
        self.norm.weight.fill_(1.0)
        self.norm.running_mean.fill_(0.0)
        self.norm.running_var.fill_(1.0 - self.norm.eps)
        self.norm.bias.copy_(self.bias)

    def watch(self, _norm: nn.Module, operands: tuple[Tensor, ...]) -> None:
        """Records the statistics of the normalisation's input."""
        self.mean, self.variance = operands[0].mean((0, 2, 3)), operands[0].var((0, 2, 3), correction=0)

    def split(self) -> None:
        """Sets the normalisation to these statistics, and rescales the kernels to the size of new ones."""
        kernel, norm = self.convolution.weight, self.norm
        scale = _KERNEL_NORM / kernel.flatten(1).norm(dim=1).clamp(min=1e-6)
        kernel.mul_(scale[:, None, None, None])
        norm.running_mean.copy_(self.mean * scale)
        norm.running_var.copy_(self.variance * scale**2)
        norm.weight.copy_((self.variance + norm.eps / scale**2).sqrt())
        norm.bias.add_(self.mean)


@torch.no_grad()
def _restore(network: nn.Module, merged: list[_Merged], pictures: Tensor) -> None:
    """Splits merged pairs: each normalisation adopts the mean and spread of its inputs for the pictures."""
    handles = []
    for pair in merged:
        pair.only_adds()
        handles.append(pair.norm.register_forward_pre_hook(pair.watch))
    training = network.training
    network.eval()(pictures)
    network.train(training)
    for handle, pair in zip(handles, merged, strict=True):
        handle.remove()
        pair.split()
