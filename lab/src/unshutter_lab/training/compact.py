"""Makes a trained network small enough to ship, without training it again.

    python -m unshutter_lab.training.compact runs/rengarajan2017-rowcol-bn-cpu/model.onnx --rank 32 --eight-bits \
        --config rengarajan2017-rowcol-bn-cpu --photos FOLDER -o rengarajan2017.onnx

* The outputs of wide fully connected layers vary in few directions. Principal component analysis of their outputs for
  training pictures finds these directions; the others are dropped (``--rank``).
* Weights are stored as 16-bit floating point. With ``--eight-bits``, those of convolutions are stored as 8-bit
  integers, with a scale for each output channel. The network still computes in 32 bits.

Prints the validation figures of both files. For networks that read pixels (``rs``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import ModelProto, NodeProto, helper, numpy_helper
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.methods.onnx import onnx_runtime
from unshutter_lab.training.config import load_config
from unshutter_lab.training.recipes import PixelRecipe, make_recipe

_PICTURES, _AT_A_TIME, _SEED = 512, 16, 2**40  # of training photos, with motions not drawn in training
_SMALL, _MOST_IN_16_BITS = 256, 65_504.0  # fewest numbers, and largest value; other weights are unchanged


def compact(model: Path, config: str | Path, photos: Path | None, rank: int, eight_bits: bool, target: Path) -> None:
    """Writes an exported network as a small file.

    Args:
        model: the network as exported by training.
        config: configuration of its training: a shipped name, or a TOML file.
        photos: replaces the configuration's folder.
        rank: number of directions in which the outputs of a wide fully connected layer may vary; 0 for all.
        eight_bits: whether convolutions are stored in 8 bits.
        target: file to write.
    """
    if not 0 <= rank < _PICTURES:
        raise UsageError(f"--rank must lie between 0 and {_PICTURES - 1}, got {rank}")
    settings = load_config(config)
    if photos is not None:
        settings = replace(settings, data={**settings.data, "folder": str(photos)})
    recipe = make_recipe(settings, torch.device("cpu"))
    if not isinstance(recipe, PixelRecipe):
        raise UsageError(f"{settings.model} does not read pixels")
    generator = torch.Generator().manual_seed(_SEED)
    stored = Stored(model)
    if stored.size != recipe.data.config.size:
        sizes = f"{model} reads pictures of {stored.size} px, the configuration trains on {recipe.data.config.size} px"
        raise UsageError(f"{sizes}: give the configuration of the same size")
    print("before:", recipe.validate(stored))
    network = onnx.load(model)
    if rank:
        count = 1 if stored.one_at_a_time else _AT_A_TIME
        batches = (recipe.pictures(count, generator).numpy() for _ in range(_PICTURES // count))
        narrow(network, batches, rank)
    store_in_fewer_bits(network, eight_bits)
    part = target.with_name(f"{target.name}.part")
    onnx.save(network, part)
    part.replace(target)
    print("after:", recipe.validate(Stored(target)))


class Stored(nn.Module):
    """The network of an ONNX file as a torch module, for validation."""

    def __init__(self, path: Path):
        super().__init__()
        if not path.is_file():
            raise UsageError(f"no such file: {path}")
        try:
            self._session = onnx_runtime().InferenceSession(path, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's exceptions have no common base class
            raise UsageError(f"{path} contains no network: {' '.join(str(error).split())}") from None
        self._is_motion = self._session.get_outputs()[0].name == "motion"
        batch, *_, self.size = self._session.get_inputs()[0].shape
        self.one_at_a_time = batch == 1

    def forward(self, rs: Tensor, rows: bool = True) -> Tensor | tuple[Tensor, Tensor | None]:
        """Returns the file's output; for kandula2020 also its row map, if it has one and that is requested."""
        parts = rs.split(1) if self.one_at_a_time else [rs]
        answers = [self._session.run(None, {"rs": part.numpy()}) for part in parts]
        first, *more = (torch.from_numpy(np.concatenate(outputs)) for outputs in zip(*answers, strict=True))
        if not self._is_motion:
            return first
        return first, more[0] if more and rows else None


def narrow(model: ModelProto, pictures: Iterable[np.ndarray], rank: int) -> None:
    """Replaces wide fully connected layers by pairs of narrow ones that only produce ``rank`` principal directions.

    A layer is wide if both its sides are at least four times the rank. The directions are those of batches [B, ...] of
    pictures, more in total than the rank.
    """
    known = {weights.name: weights for weights in model.graph.initializer}
    wide = [
        node
        for node in model.graph.node
        if node.op_type == "Gemm" and node.input[1] in known and min(known[node.input[1]].dims) >= 4 * rank
    ]
    outputs = _outputs_of(wide, model, pictures)
    narrowed: dict[str, list[str]] = {}  # weights of a wide layer, which nodes may share -> those of its pair
    for name, bias in dict.fromkeys((node.input[1], node.input[2]) for node in wide):
        seen = np.concatenate([outputs[node.output[0]] for node in wide if node.input[1] == name])
        given = numpy_helper.to_array(known.pop(name)), numpy_helper.to_array(known.pop(bias))
        parts = _narrowed(*given, seen, rank)
        narrowed[name] = [f"{name}.{part}" for part in ("projected", "directions", "bias")]
        known |= {each: numpy_helper.from_array(part, each) for each, part in zip(narrowed[name], parts, strict=True)}
    nodes = []
    for node in model.graph.node:
        if node not in wide:
            nodes.append(node)
            continue
        names, between = narrowed[node.input[1]], f"{node.output[0]}.{rank}"
        nodes.append(helper.make_node("Gemm", [node.input[0], names[0]], [between], transB=1))
        nodes.append(helper.make_node("Gemm", [between, names[1], names[2]], list(node.output), transB=1))
    _rebuild(model, nodes, list(known.values()))


def _outputs_of(nodes: list[NodeProto], model: ModelProto, pictures: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Returns the outputs of these nodes for the pictures [N, out], by name."""
    names = [node.output[0] for node in nodes]
    probed = ModelProto()
    probed.CopyFrom(model)
    probed.graph.output.extend(helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in names)
    session = onnx_runtime().InferenceSession(probed.SerializeToString(), providers=["CPUExecutionProvider"])
    outputs = [[np.asarray(output) for output in session.run(names, {"rs": batch})] for batch in pictures]
    return {name: np.concatenate([batch[k] for batch in outputs]) for k, name in enumerate(names)}


def _narrowed(weights: np.ndarray, bias: np.ndarray, outputs: np.ndarray, rank: int) -> tuple[np.ndarray, ...]:
    """Returns the weights of two layers and the bias of the second, which project onto ``rank`` directions."""
    mean = outputs.mean(0)
    directions = np.linalg.svd(outputs - mean, full_matrices=False)[2][:rank].T  # [out, rank]
    return directions.T @ weights, directions, mean + directions @ (directions.T @ (bias - mean))


def store_in_fewer_bits(model: ModelProto, eight_bits: bool = False) -> None:
    """Stores a network's weights in fewer bits; it still computes in 32 bits."""
    kernels = {node.input[1] for node in model.graph.node if node.op_type == "Conv"} if eight_bits else set()
    stored, decoders = [], []
    for weights in model.graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.dtype != np.float32 or values.size < _SMALL or np.abs(values).max() > _MOST_IN_16_BITS:
            stored.append(weights)
            continue
        parts, decoder = _in_8_bits(weights.name, values) if weights.name in kernels else _in_16(weights.name, values)
        stored += [numpy_helper.from_array(array, name) for name, array in parts.items()]
        decoders.append(decoder)
    _rebuild(model, [*decoders, *model.graph.node], stored)


def _in_8_bits(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], NodeProto]:
    """Returns the stored arrays, by name, and the node that decodes them to the weights [out, ...]."""
    scale = np.maximum(np.abs(values).reshape(len(values), -1).max(1), np.finfo(np.float32).tiny) / 127
    steps = np.rint(values / scale.reshape(-1, *[1] * (values.ndim - 1))).astype(np.int8)
    parts = {f"{name}.int8": steps, f"{name}.scale": scale}
    return parts, helper.make_node("DequantizeLinear", list(parts), [name], axis=0)


def _in_16(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], NodeProto]:
    half = f"{name}.float16"
    return {half: values.astype(np.float16)}, helper.make_node("Cast", [half], [name], to=onnx.TensorProto.FLOAT)


def _rebuild(model: ModelProto, nodes: list[NodeProto], weights: list[onnx.TensorProto]) -> None:
    del model.graph.node[:], model.graph.initializer[:]
    model.graph.node.extend(nodes)
    model.graph.initializer.extend(weights)


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--config", required=True)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--eight-bits", action="store_true")
    parser.add_argument("-o", "--output", dest="target", type=Path, required=True)
    try:
        compact(**vars(parser.parse_args()))
    except UsageError as error:
        parser.exit(2, f"unshutter: {error}\n")


if __name__ == "__main__":
    main()
