"""The optimiser and the learning-rate schedule of a configuration."""

from __future__ import annotations

import math

import torch
from torch import nn

from unshutter_lab.training.config import TrainConfig


def make_optimiser(network: nn.Module, config: TrainConfig) -> torch.optim.Optimizer:
    """Returns AdamW, Adam or SGD with momentum."""
    weights, rate, decay = network.parameters(), config.learning_rate, config.weight_decay
    betas = (config.momentum, config.beta2)
    if config.optimiser == "adamw":
        return torch.optim.AdamW(weights, rate, betas, weight_decay=decay)
    if config.optimiser == "adam":
        return torch.optim.Adam(weights, rate, betas, weight_decay=decay)
    return torch.optim.SGD(weights, rate, config.momentum, weight_decay=decay)


def rate_at(step: int, config: TrainConfig) -> float:
    """Returns the learning rate of a step: a linear warm-up times the schedule."""
    warmup = min(1.0, (step + 1) / max(config.warmup, 1))
    if config.schedule == "cosine":
        share = 0.5 + 0.5 * math.cos(math.pi * step / config.steps)
    elif config.schedule == "stairs":
        share = 0.1 ** (step // config.stair)
    elif config.schedule == "late":
        share = min(1.0, (1 - step / config.steps) / config.tail)
    else:
        share = 1.0
    return config.learning_rate * warmup * share
