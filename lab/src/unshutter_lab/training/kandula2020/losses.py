"""The losses of kandula2020 (paper, "Loss functions").

The paper uses squared L2 norms; here every loss is a mean over valid pixels (and channels), so that the weights
1, 1, 0.5, 0.5 have the same meaning at every picture and batch size.

Masks: a pixel of a warped picture is valid if its sampling position lies inside a valid part of the source, so that
a black pixel of the scene counts. The paper's literal rule, by which every pixel that is not black is valid, is
``mask = "black"``; for the MSE both agree if the scene contains no black.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.errors import UsageError


@dataclass(frozen=True)
class LossConfig:
    """Weights and phases; a weight of 0 omits its loss (ablations)."""

    rectified: float = 1.0  # lambda_1
    regenerated: float = 1.0  # lambda_2
    rectified_edges: float = 0.5  # lambda_3
    regenerated_edges: float = 0.5  # lambda_4
    mask: str = "grid"  # grid | black (the paper's literal rule)
    regress_steps: int = 800  # first phase: number of steps in which the true motion is regressed
    regress_photos: int = 50  # photos of the first phase; 0: all
    # Weight of the regression, chosen so that the gradients of both phases have a similar size: Adam divides by the
    # size it remembers, and with a weight of 1 the second phase's first steps would be several times too long.
    regress: float = 30.0
    regress_norm: str = "square"  # square | distance: mean squared error, or mean distance, less sensitive to outliers
    # Weight of the row map's own error in the first phase; ours: the paper's row block learns from pictures alone.
    row_residual: float = 0.0
    at_a_time: int = 0  # pictures whose losses are computed together, since few fit into a CPU's cache; 0: all
    regress_only: bool = False  # the paper's own ablation: no second phase, all photos

    def __post_init__(self) -> None:
        if self.mask not in ("grid", "black"):
            raise UsageError(f"[loss]: unknown mask '{self.mask}': choose grid or black")
        if self.regress_norm not in ("square", "distance"):
            raise UsageError(f"[loss]: unknown regress_norm '{self.regress_norm}': choose square or distance")


def visible_mse(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Visibility-aware MSE: mean of (warped - mask * target)^2 over the valid pixels.

    Args:
        warped: [B, C, H, W], 0 where invalid.
        target: [B, C, H, W].
        mask: [B, 1, H, W], 1 where valid, otherwise 0.
    """
    return (warped - mask * target).square().sum() / (mask.sum() * warped.shape[1]).clamp(min=1)


def edge_loss(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Mean squared difference of the Sobel edges over the pixels without invalid neighbours.

    The paper's own form, E(warped) - mask * E(target), also penalises the edge at the border of the warped picture,
    which does not exist in the scene; see :func:`literal_edge_loss`.
    """
    inner = 1 - F.max_pool2d(F.pad(1 - mask, (1, 1, 1, 1)), 3, stride=1)
    difference = sobel(warped - target) * inner  # Sobel is linear
    return difference.square().sum() / (inner.sum() * difference.shape[1]).clamp(min=1)


def literal_edge_loss(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """The paper's literal edge loss: (E(warped) - mask * E(target))^2, summed, per valid pixel."""
    difference = sobel(warped) - mask * sobel(target)
    return difference.square().sum() / (mask.sum() * difference.shape[1]).clamp(min=1)


def not_black(warped: Tensor) -> Tensor:
    """Returns the paper's literal mask [B, 1, H, W]: 0 where all channels are 0, otherwise 1."""
    return (warped.detach().sum(1, keepdim=True) != 0).to(warped.dtype)


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
