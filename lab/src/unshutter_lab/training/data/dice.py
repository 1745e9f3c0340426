"""Random numbers for a whole batch at once."""

from __future__ import annotations

import torch
from torch import Tensor


class Dice:
    """Random draws for a batch, from one generator and on its device.

    Args:
        generator: random number generator.
        batch: size B of the first dimension.
    """

    def __init__(self, generator: torch.Generator, batch: int):
        self.generator, self.batch = generator, batch

    def each(self, *shape: int) -> Tensor:
        """Returns [B, *shape] uniform in 0 ... 1."""
        return torch.rand(self.batch, *shape, generator=self.generator, device=self.generator.device)

    def normal(self, *shape: int) -> Tensor:
        """Returns [B, *shape] from a standard normal distribution."""
        return torch.randn(self.batch, *shape, generator=self.generator, device=self.generator.device)

    def between(self, low: float, high: float, *shape: int) -> Tensor:
        """Returns [B, *shape] uniform in low ... high."""
        return low + (high - low) * self.each(*shape)

    def happens(self, probability: float, *shape: int) -> Tensor:
        """Returns [B, *shape], True with the given probability."""
        return self.each(*shape) < probability

    def pick(self, weights: Tensor, count: int) -> Tensor:
        """Returns indices [B, count] drawn with weights [B, K]."""
        return torch.multinomial(weights, count, replacement=True, generator=self.generator)
