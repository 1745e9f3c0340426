r"""A trained network made small enough to ship, without being trained again.

    python -m unshutter.learn.compact --config rengarajan2017-rowcol-bn-cpu --run runs/rengarajan2017-rowcol-bn-cpu \
        --photos FOLDER --rank 32 --eight-bits -o rengarajan2017.onnx

* The outputs of wide fully connected layers vary in few directions: principal component analysis of their outputs for
  training pictures finds these, and the others are left out (``--rank``).
* Weights are stored as 16-bit floating point, with ``--eight-bits`` those of convolutions as 8-bit integers, each
  output channel with a scale of its own. The network calculates in 32 bits as before.

Prints the validation figures of the run's network, and those of the file that is written.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter.learn.checkpoint import load_average
from unshutter.learn.config import load_config
from unshutter.learn.onnx_export import store_small
from unshutter.learn.recipes import Recipe, make_recipe

_PICTURES, _AT_A_TIME, _SEED = 512, 16, 2**40  # of training photos, with motions that no training has drawn


def compact(config: str | Path, run: Path, photos: Path | None, rank: int, eight_bits: bool, target: Path) -> None:
    """Writes the network of a finished run as small ONNX.

    Args:
        config: of the run: a shipped configuration's name, or a TOML file.
        run: its folder, with checkpoint.pt.
        photos: instead of the configuration's folder.
        rank: directions in which the outputs of a wide fully connected layer may vary; 0: all.
        eight_bits: whether convolutions are stored in 8 bits.
        target: file to write.

    Raises:
        UsageError: no such run, a rank that cannot be, or a network that does not read pixels and is to be narrowed.
    """
    if not 0 <= rank < _PICTURES:
        raise UsageError(f"--rank must lie between 0 and {_PICTURES - 1}, got {rank}")
    settings = load_config(config)
    if photos is not None:
        settings = replace(settings, data={**settings.data, "folder": str(photos)})
    recipe = make_recipe(settings, torch.device("cpu"))
    network = recipe.build()
    load_average(network, run / "checkpoint.pt")
    network.eval()
    print("before:", recipe.validate(network))
    if rank:
        narrow(network, _training_pictures(recipe), rank)
    recipe.export(network, target)
    store_small(target, eight_bits)
    print("after:", recipe.validate(Stored(target)))


@torch.no_grad()
def narrow(network: nn.Module, pictures: Iterable[Tensor], rank: int) -> None:
    """Replaces wide fully connected layers by two narrow ones, whose outputs vary in the principal directions alone.

    Args:
        network: in evaluation mode; changed. A layer is wide if both its sides are at least four times the rank.
        pictures: batches to find these directions: together more pictures than the rank.
        rank: number of directions.
    """
    wide = {
        name: layer
        for name, layer in network.named_modules()
        if isinstance(layer, nn.Linear) and min(layer.in_features, layer.out_features) >= 4 * rank
    }
    outputs: dict[str, list[Tensor]] = {name: [] for name in wide}
    hooks = [layer.register_forward_hook(_keeping(outputs[name])) for name, layer in wide.items()]
    for batch in pictures:
        network(batch)
    for hook in hooks:
        hook.remove()
    for name, layer in wide.items():
        parent, _, own = name.rpartition(".")
        setattr(network.get_submodule(parent), own, _narrowed(layer, torch.cat(outputs[name]), rank))


def _keeping(outputs: list[Tensor]) -> Callable[[nn.Module, object, Tensor], None]:
    """A hook that keeps a layer's outputs."""
    return lambda _layer, _given, output: outputs.append(output)


def _narrowed(layer: nn.Linear, outputs: Tensor, rank: int) -> nn.Sequential:
    """Two layers that give the outputs' projection onto their ``rank`` principal directions about their mean."""
    mean = outputs.mean(0)
    directions = torch.linalg.svd(outputs - mean, full_matrices=False).Vh[:rank].T  # [out, rank]
    first = nn.Linear(layer.in_features, rank, bias=False)
    second = nn.Linear(rank, layer.out_features)
    first.weight.copy_(directions.T @ layer.weight)
    second.weight.copy_(directions)
    bias = torch.zeros_like(mean) if layer.bias is None else layer.bias
    second.bias.copy_(mean + directions @ (directions.T @ (bias - mean)))
    return nn.Sequential(first, second)


def _training_pictures(recipe: Recipe) -> Iterable[Tensor]:
    data = getattr(recipe, "data", None)
    if data is None:
        raise UsageError(f"{recipe.config.model} does not read pixels: --rank is for networks that do")
    generator = torch.Generator().manual_seed(_SEED)
    return (data.batch(_AT_A_TIME, generator).rs for _ in range(_PICTURES // _AT_A_TIME))


class Stored(nn.Module):
    """The network of an ONNX file, to be validated as one of torch's."""

    def __init__(self, path: Path):
        import onnxruntime

        super().__init__()
        self._session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])

    def forward(self, *given: Tensor, **_parts: bool) -> Tensor | tuple[Tensor, ...]:
        """The file's outputs; a tuple where it has several."""
        names = [known.name for known in self._session.get_inputs()]
        arrays = [np.asarray(tensor) for tensor in given]
        outputs = tuple(map(torch.from_numpy, self._session.run(None, dict(zip(names, arrays, strict=True)))))
        return outputs[0] if len(outputs) == 1 else outputs


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", required=True)
    parser.add_argument("--run", type=Path, required=True)
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
