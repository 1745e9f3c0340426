"""Losses of kandula2020: how far its two warped pictures, and its row map, are from the true ones.

The paper's losses are squared L2 norms; here each is a mean over valid pixels (and channels), so that the weights
1, 1, 0.5, 0.5 have the same meaning at every picture and batch size. A pixel of a warped picture is valid if its
sampling position lies inside a valid part of the source, so that a black pixel of the scene counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.motion import geometry
from unshutter_lab.training.kandula2020 import rectify, regenerate
from unshutter_lab.training.pixels import Samples, pixel_grid


@dataclass(frozen=True)
class LossConfig:
    """Weights and phases; a weight of 0 omits its loss (ablations)."""

    rectified: float = 1.0  # lambda_1
    regenerated: float = 1.0  # lambda_2
    rectified_edges: float = 0.5  # lambda_3
    regenerated_edges: float = 0.5  # lambda_4
    regress_steps: int = 800  # first phase: steps in which the true motion is regressed
    regress_photos: int = 50  # photos of the first phase; 0: all
    # Weight of the regression, chosen so that the gradients of both phases have a similar size: Adam divides by the
    # size it remembers, and with a weight of 1 the second phase's first steps would be several times too long.
    regress: float = 30.0
    # mean squared error, or mean distance, which is less sensitive to outliers
    regress_norm: Literal["square", "distance"] = "square"
    # Weight of the row map's own error in the first phase; ours: the paper's row block learns from pictures alone.
    row_residual: float = 0.0
    again: float = 0.0  # share of the first phase's pictures that are seen as the network itself rectifies them (ours)
    at_a_time: int = 0  # pictures whose losses are computed together, since few fit into a CPU's cache; 0: all
    regress_only: bool = False  # the paper's own ablation: no second phase, all photos


def visible_mse(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Visibility-aware MSE of [B, C, H, W]: mean of (warped - mask * target)^2 where the mask [B, 1, H, W] is 1."""
    return (warped - mask * target).square().sum() / (mask.sum() * warped.shape[1]).clamp(min=1)


def edge_loss(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Mean squared difference of the Sobel edges over the pixels without invalid neighbours.

    The paper's own form, E(warped) - mask * E(target), also penalises the border of the warped picture.
    """
    inner = 1 - F.max_pool2d(F.pad(1 - mask, (1, 1, 1, 1)), 3, stride=1)
    difference = sobel(warped - target) * inner  # Sobel is linear
    return difference.square().sum() / (inner.sum() * difference.shape[1]).clamp(min=1)


def sobel(picture: Tensor) -> Tensor:
    """Returns Sobel derivatives along columns, then rows: [B, C, H, W] -> [B, 2 C, H, W].

    Weights 1, 2, 1 and -1, 0, 1 without a factor, borders mirrored, as Sobel edges in the paper's framework.
    """
    p = F.pad(picture, (1, 1, 1, 1), mode="reflect")
    across = p[..., 2:] - p[..., :-2]
    down = p[..., 2:, :] - p[..., :-2, :]
    d_col = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    d_row = down[..., :-2] + 2 * down[..., 1:-1] + down[..., 2:]
    return torch.cat([d_col, d_row], 1)


def picture_losses(samples: Samples, motion: Tensor, row_map: Tensor | None, config: LossConfig) -> dict[str, Tensor]:
    """Returns the paper's losses by the name of their weight in LossConfig, except those of weight 0.

    Of trajectories [B, 2, r] and row maps [B, r, r] (None: exact inverse); each a mean over parts of the batch.
    """
    count = len(samples.rs)
    part = config.at_a_time or count
    losses: dict[str, Tensor] = {}
    for first in range(0, count, part):
        some = slice(first, min(first + part, count))
        sampled = _losses_of(samples[some], motion[some], None if row_map is None else row_map[some], config)
        for name, value in sampled.items():
            losses[name] = losses.get(name, 0.0) + value * ((some.stop - some.start) / count)
    return losses


def _losses_of(samples: Samples, motion: Tensor, row_map: Tensor | None, config: LossConfig) -> dict[str, Tensor]:
    losses = {}
    if config.rectified or config.rectified_edges:
        rectified, mask = rectify(samples.rs, samples.rs_valid, motion, row_map)
        losses["rectified"] = visible_mse(rectified, samples.gs, mask)
        losses["rectified_edges"] = edge_loss(rectified, samples.gs, mask)
    if config.regenerated or config.regenerated_edges:
        regenerated, mask = regenerate(samples.gs, motion)
        mask, regenerated = mask * samples.rs_valid, regenerated * samples.rs_valid
        losses["regenerated"] = visible_mse(regenerated, samples.rs, mask)
        losses["regenerated_edges"] = edge_loss(regenerated, samples.rs, mask)
    return {name: value for name, value in losses.items() if getattr(config, name)}


_ROW_STEP = 8  # px between the pixels at which row maps are compared, since the row block's own grid is coarse


def row_map_error(row_map: Tensor, samples: Samples) -> Tensor:
    """Returns the mean distance [rows / 8] of row maps [B, r, r] from the true ones, on every eighth pixel."""
    col, row = (line.flatten()[_ROW_STEP // 2 :: _ROW_STEP] for line in pixel_grid(samples.size, samples.rs))
    _, true = geometry.gs_to_rs(col[None], row[:, None] + 0 * col, samples.motion, samples.center)
    sampled = row_map[:, _ROW_STEP // 2 :: _ROW_STEP, _ROW_STEP // 2 :: _ROW_STEP]
    return (sampled - true).abs().mean() / _ROW_STEP
