"""Recipes: what a network learns from, its loss, its validation and its export.

To add a network, make a folder with its network.py and a recipe.py that implements :class:`Recipe`, and add the
recipe's line to ``RECIPES``. Such a folder imports the modules of this folder, never another network's folder.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from pathlib import Path

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig

# model of the configuration -> module:class, imported only when it is trained
RECIPES = {
    "kandula2020": "unshutter_lab.training.kandula2020.recipe:KandulaRecipe",
    "rengarajan2017": "unshutter_lab.training.rengarajan2017.recipe:RengarajanRecipe",
    "segment-transformer": "unshutter_lab.training.segment_transformer.recipe:SegmentRecipe",
}


class Recipe(ABC):
    """Everything about a training that depends on the model.

    Args:
        config: of the run.
        device: where network and data lie.
    """

    def __init__(self, config: TrainConfig, device: torch.device):
        self.config, self.device = config, device

    @abstractmethod
    def build(self) -> nn.Module:
        """A new network, initialised from torch's global generator."""

    @abstractmethod
    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Loss on a fresh batch drawn with ``generator``, and figures for the log."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Figures on data that training never sees, the same data at each call."""

    @abstractmethod
    def export(self, network: nn.Module, path: Path) -> None:
        """Writes the network as ONNX."""

    def pictures(self, count: int, generator: torch.Generator) -> Tensor:
        """Training pictures as the network reads them, [count, 3, r, r] in 0 ... 1.

        Raises:
            UsageError: it reads none.
        """
        raise UsageError(f"{self.config.model} does not read pixels")

    def start_from_stored(self, network: nn.Module, weights: Path) -> None:
        """Copies the weights of an .npz, as unshutter ships them, into a network.

        Raises:
            UsageError: this model's weights are not stored so, or are those of a network of another size.
            WeightsError: they cannot be read.
        """
        raise UsageError(f"cannot start from {weights}: weights of {self.config.model} are not stored as .npz")


def make_recipe(config: TrainConfig, device: torch.device) -> Recipe:
    """The recipe that the configuration names.

    Raises:
        UsageError: there is none of that name.
    """
    if config.model not in RECIPES:
        raise UsageError(f"unknown model '{config.model}': choose one of {', '.join(RECIPES)}")
    module, _, name = RECIPES[config.model].partition(":")
    return getattr(import_module(module), name)(config, device)
