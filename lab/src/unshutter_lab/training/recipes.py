"""Recipes: a network's training data, loss, validation and export.

To add a network, create a folder with its network.py and a recipe.py that implements :class:`Recipe`, and add the
recipe's line to ``RECIPES``. Such a folder imports the modules of this folder, never those of another network's folder.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from pathlib import Path

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig

# model of the configuration -> module:class, imported only when trained
RECIPES = {
    "kandula2020": "unshutter_lab.training.kandula2020.recipe:KandulaRecipe",
    "rengarajan2017": "unshutter_lab.training.rengarajan2017.recipe:RengarajanRecipe",
    "segment-transformer": "unshutter_lab.training.segment_transformer.recipe:SegmentRecipe",
}


class Recipe(ABC):
    """The model-specific part of training.

    Args:
        config: configuration of the run.
        device: device of network and data.
    """

    def __init__(self, config: TrainConfig, device: torch.device):
        self.config, self.device = config, device

    @abstractmethod
    def build(self) -> nn.Module:
        """Returns a new network, initialised from torch's global generator."""

    @abstractmethod
    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the loss on a new batch drawn with ``generator``, and figures for the log."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns figures on data not used in training, the same at each call."""

    @abstractmethod
    def export(self, network: nn.Module, path: Path) -> None:
        """Writes the network as ONNX."""

    def pictures(self, count: int, generator: torch.Generator) -> Tensor:
        """Returns training pictures as the network reads them, [count, 3, r, r] in 0 ... 1.

        Raises:
            UsageError: it does not read pictures.
        """
        raise UsageError(f"{self.config.model} does not read pixels")

    def start_from_stored(self, network: nn.Module, weights: Path) -> None:
        """Copies the weights of an .npz file, as shipped with unshutter, into a network.

        Raises:
            UsageError: this model's weights are not stored in this form, or belong to a network of another size.
            WeightsError: they cannot be read.
        """
        raise UsageError(f"cannot start from {weights}: weights of {self.config.model} are not stored as .npz")


def make_recipe(config: TrainConfig, device: torch.device) -> Recipe:
    """Returns the recipe named in the configuration.

    Raises:
        UsageError: there is no recipe with that name.
    """
    if config.model not in RECIPES:
        raise UsageError(f"unknown model '{config.model}': choose one of {', '.join(RECIPES)}")
    module, _, name = RECIPES[config.model].partition(":")
    return getattr(import_module(module), name)(config, device)
