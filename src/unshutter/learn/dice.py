"""Random numbers for a batch of drawn things, all from one generator."""

from __future__ import annotations

import torch
from torch import Tensor


class Dice:
    """Random numbers for a batch, on the generator's device."""

    def __init__(self, generator: torch.Generator, batch: int):
        self.generator, self.batch = generator, batch

    def each(self, *shape: int) -> Tensor:
        """[batch, *shape] even between 0 and 1."""
        return torch.rand(self.batch, *shape, generator=self.generator, device=self.generator.device)

    def normal(self, *shape: int) -> Tensor:
        """[batch, *shape] normal."""
        return torch.randn(self.batch, *shape, generator=self.generator, device=self.generator.device)

    def between(self, low: float, high: float, *shape: int) -> Tensor:
        """[batch, *shape] even between two numbers."""
        return low + (high - low) * self.each(*shape)

    def happens(self, probability: float, *shape: int) -> Tensor:
        """[batch, *shape] true with this probability."""
        return self.each(*shape) < probability

    def pick(self, weights: Tensor, count: int) -> Tensor:
        """[B, K] weights -> [B, count] indices."""
        return torch.multinomial(weights, count, replacement=True, generator=self.generator)
