"""Recipes: what a network learns from, what it is told off for, and how it leaves the workshop.

To add one: write a class that fulfils :class:`Recipe`, and add its line to ``RECIPES``.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter.learn.config import TrainConfig

RECIPES = {
    "kandula2020": "unshutter.learn.kandula2020.recipe:KandulaRecipe",
    "rengarajan2017": "unshutter.learn.rengarajan2017.recipe:RengarajanRecipe",
    "segment-transformer": "unshutter.learn.segment_transformer.recipe:SegmentRecipe",
}


class Recipe(Protocol):
    """Everything about a training that depends on the model. Made from the configuration and the device."""

    def __init__(self, config: TrainConfig, device: torch.device): ...

    def build(self) -> nn.Module:
        """A new network, initialised from torch's global generator."""
        ...

    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Loss on a fresh batch drawn with ``generator``, and numbers for the log."""
        ...

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Figures on data that training never sees; the same data at each call."""
        ...

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes the network as ONNX."""
        ...


def make_recipe(config: TrainConfig, device: torch.device) -> Recipe:
    """The recipe that the configuration names.

    Raises:
        UsageError: there is none of that name.
    """
    if config.model not in RECIPES:
        raise UsageError(f"unknown model '{config.model}': choose one of {', '.join(RECIPES)}")
    module, _, name = RECIPES[config.model].partition(":")
    return getattr(import_module(module), name)(config, device)
