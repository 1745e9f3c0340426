"""Random motions in batches: the predecessor's quadratics."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from unshutter.geometry import rows as geometry
from unshutter.learn.data.dice import Dice

_FIRST, _SPAN = 50 / 356, 256 / 356  # the middle 256 of the 356 canvas rows: canvas row / 356 = _FIRST + _SPAN * u


def draw_motions(
    batch: int, generator: torch.Generator, still: float = 0.0, small: float = 0.0
) -> tuple[Tensor, Tensor]:
    """The quadratics of Rengarajan et al. 2017 on their canvas, expanded anew from the picture's first row.

    A sixth of the motions only turn, another sixth only translate.

    Args:
        batch: how many.
        generator: of the numbers.
        still: share of pictures without any motion.
        small: share of the others whose motion is multiplied by a random factor below 1.

    Returns:
        (tx, rz): [B, 3] coefficients of u, u^2, u^3 with u = row / rows; t_x in rows of the picture, r_z in radians.
    """
    dice = Dice(generator, batch)

    def in_u(linear: Tensor, square: Tensor) -> Tensor:
        return torch.stack([_SPAN * (linear + 2 * _FIRST * square), _SPAN**2 * square, torch.zeros_like(square)], -1)

    kind = dice.each()
    has_tx = (kind >= 1 / 6).float()[:, None]
    has_rz = ((kind < 1 / 6) | (kind >= 2 / 6)).float()[:, None]
    tx = in_u(5 * dice.between(-6, 6), 25 * dice.between(-3, 3)) / 256
    rz = in_u(dice.between(-0.4, 0.4), dice.between(-0.4, 0.4)) * (math.pi / 8)
    size = torch.where(dice.happens(small), dice.each(), 1.0)
    size = torch.where(dice.happens(still), 0.0, size)[:, None]
    return tx * has_tx * size, rz * has_rz * size


def cubic_motion(tx: Tensor, rz: Tensor) -> geometry.MotionAtRow:
    """Row motion of a batch: coefficients [B, 3] of u, u^2, u^3, for centred row coordinates [B, N] in rows."""
    constant = torch.zeros_like(tx[:, :1])
    full = [torch.cat([constant, c], -1)[:, None] for c in (tx, rz)]  # [B, 1, 4]
    return geometry.row_motion_from_polynomial(*full, first=-0.5, last=0.5)
