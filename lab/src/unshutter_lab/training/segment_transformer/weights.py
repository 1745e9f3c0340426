"""Writes the network's weights as an .npz file, which unshutter runs without onnxruntime.

Every training run writes such a file. To make one from a network that was exported as ONNX:

    python -m unshutter_lab.training.segment_transformer.weights runs/segment-transformer/model.onnx -o model.npz
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch

from unshutter.errors import UsageError
from unshutter.estimators.segment_transformer.weights import Weights, write_weights
from unshutter_lab.training.segment_transformer.network import SegmentTransformer, SegmentTransformerConfig

# stored name -> the network's name; * is the number of a block
_LINEAR = {
    "embedding.hidden": "embed.0",
    "embedding.output": "embed.2",
    "blocks.attention.query": "blocks.*.attention.query",
    "blocks.attention.key_value": "blocks.*.attention.key_value",
    "blocks.attention.output": "blocks.*.attention.out",
    "blocks.mlp.hidden": "blocks.*.mlp.0",
    "blocks.mlp.output": "blocks.*.mlp.2",
    "pooling.query": "pool.query",
    "pooling.key_value": "pool.key_value",
    "pooling.output": "pool.out",
    "head.hidden": "head.1",
    "head.output": "head.3",
}
_NORMS = {
    "blocks.attention.norm": "blocks.*.norm1",
    "blocks.mlp.norm": "blocks.*.norm2",
    "pooling.norm": "pool_norm",
    "head.norm": "head.0",
}
_LATENTS = ("pooling.latents", "latents")


def weights_of(network: SegmentTransformer) -> Weights:
    """Returns the weights of a trained network, by their names in the file."""
    state = {name: value.detach().cpu().numpy() for name, value in network.state_dict().items()}
    return _stored(state, network.config.heads, network.config.iterations_in_use)


def network_of(weights: Weights) -> SegmentTransformer:
    """Returns a trainable network with stored weights."""
    layers, width = weights["blocks.attention.query.weight"].shape[:2]
    latents = len(weights["pooling.latents"])
    heads, iterations = int(weights["heads"]), int(weights["iterations"])
    config = SegmentTransformerConfig(width, layers, heads, latents, iterations_in_use=iterations)
    state = {}
    for stored, own, is_weight in _pairs():
        array = weights[stored]
        for name, one in zip(_numbered(own, layers), array if "*" in own else [array], strict=True):
            state[name] = torch.tensor(one.T if is_weight else one)
    network = SegmentTransformer(config)
    network.load_state_dict(state)
    return network


def _stored(state: Mapping[str, np.ndarray], heads: int, iterations: int) -> Weights:
    layers = sum(name.endswith(".norm1.weight") for name in state)
    weights = {"heads": np.array(heads), "iterations": np.array(iterations)}
    for stored, own, is_weight in _pairs():
        arrays = [state[name].T if is_weight else state[name] for name in _numbered(own, layers)]
        weights[stored] = np.ascontiguousarray(np.stack(arrays) if "*" in own else arrays[0], np.float32)
    return weights


def _pairs() -> Iterator[tuple[str, str, bool]]:
    """Yields each array's name in the file, its name in the network, and whether it is a linear layer's weight."""
    yield (*_LATENTS, False)
    for stored, own in _LINEAR.items():
        yield f"{stored}.weight", f"{own}.weight", True
        yield f"{stored}.bias", f"{own}.bias", False
    for stored, own in _NORMS.items():
        yield f"{stored}.scale", f"{own}.weight", False
        yield f"{stored}.shift", f"{own}.bias", False


def _numbered(own: str, layers: int) -> list[str]:
    return [own.replace("*", str(k)) for k in range(layers)] if "*" in own else [own]


def weights_of_onnx(path: Path, heads: int) -> Weights:
    """Returns the weights of an exported network, which keeps torch's names except those of matrices.

    Args:
        path: file written by onnx_loop.py.
        heads: number of heads, which the file does not contain.

    Raises:
        UsageError: it is not such a file.
    """
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load(path).graph
        arrays = {array.name: numpy_helper.to_array(array) for array in graph.initializer}
        loop = next(node for node in graph.node if node.op_type == "Loop")
        producers = {output: node for node in loop.attribute[0].g.node for output in node.output}
        state = {name.removeprefix("network."): array for name, array in arrays.items() if name.startswith("network.")}
        for node in producers.values():
            factors = producers.get(node.input[-1]) or producers.get(node.input[0]) if node.op_type == "Add" else None
            bias = next((name for name in node.input if name.startswith("network.")), None)
            if bias is not None and factors is not None and factors.op_type == "MatMul" and factors.input[1] in arrays:
                state[bias.removeprefix("network.").replace(".bias", ".weight")] = arrays[factors.input[1]].T
            if node.op_type == "Expand" and node.input[0] in arrays:
                state["latents"] = arrays[node.input[0]][0]
        return _stored(state, heads, int(arrays["iterations"]))
    except Exception as error:  # protobuf's exceptions, and anything missing from the graph
        raise UsageError(f"{path} is not an exported segment-transformer: {' '.join(str(error).split())}") from None


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--heads", type=int, default=SegmentTransformerConfig.heads)
    parser.add_argument("-o", "--output", dest="target", type=Path, required=True)
    arguments = parser.parse_args()
    try:
        write_weights(arguments.target, weights_of_onnx(arguments.model, arguments.heads))
    except UsageError as error:
        parser.exit(2, f"unshutter: {error}\n")


if __name__ == "__main__":
    main()
