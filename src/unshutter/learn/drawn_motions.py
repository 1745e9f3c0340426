"""Row motions for drawn scenes and for photos distorted in training: polynomials of u = row coordinate + 1/2.

t_x in rows of the picture, r_z in radians, zero at the first row.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from unshutter import geometry
from unshutter.learn.dice import Dice

if TYPE_CHECKING:
    from unshutter.learn.scenes import SceneConfig


def draw_motions(batch: int, config: SceneConfig, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Motions of all kinds: the predecessor's quadratics at full size, smaller or nought, even pans, cubics by hand.

    Returns:
        (tx, rz): [B, 3] coefficients of u, u^2, u^3.
    """
    dice = Dice(generator, batch)
    tx, rz = _quadratics(dice)
    size = torch.where(dice.happens(config.small_motion), dice.each(), 1.0)
    size = torch.where(dice.happens(config.zero_motion), 0.0, size)[:, None]
    tx, rz = tx * size, rz * size
    kind = dice.each()[:, None]
    for share, other in ((config.steady_motion, _steady(dice)), (config.hand_motion, _by_hand(dice))):
        tx, rz = (torch.where(kind < share, new, old) for new, old in zip(other, (tx, rz), strict=True))
        kind = torch.where(kind < share, 2.0, kind - share)
    return tx, rz


def draw_quadratics(batch: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """The predecessor's quadratics alone; see :func:`draw_motions`."""
    return _quadratics(Dice(generator, batch))


def row_motion(tx: Tensor, rz: Tensor) -> geometry.RowMotion:
    """Coefficients [B, 3] of u, u^2, u^3 -> row motion for row coordinates [B, N] in units of rows."""
    constant = torch.zeros_like(tx[:, :1])
    full = [torch.cat([constant, c], -1)[:, None] for c in (tx, rz)]  # [B, 1, 4]
    return geometry.row_motion_from_polynomial(*full, first=-0.5, last=0.5)


def _quadratics(dice: Dice) -> tuple[Tensor, Tensor]:
    """Rengarajan 2017 over the middle 256 of 356 canvas rows, re-expanded in u."""
    first, span = 50 / 356, 256 / 356  # canvas row / 356 = first + span * u, first row as the reference

    def in_u(linear: Tensor, square: Tensor) -> Tensor:
        return torch.stack([span * (linear + 2 * first * square), span**2 * square, torch.zeros_like(square)], -1)

    kind = dice.each()
    has_tx = (kind >= 1 / 6).float()[:, None]
    has_rz = ((kind < 1 / 6) | (kind >= 2 / 6)).float()[:, None]
    tx = in_u(5 * dice.between(-6, 6), 25 * dice.between(-3, 3)) / 256
    rz = in_u(dice.between(-0.4, 0.4), dice.between(-0.4, 0.4)) * (math.pi / 8)
    return tx * has_tx, rz * has_rz


def _steady(dice: Dice) -> tuple[Tensor, Tensor]:
    """An even pan of up to 45 px of 256 rows, as from cars and drones, with a little of everything else."""
    pan = dice.between(-0.18, 0.18)[:, None]
    tx = pan * (torch.tensor([1.0, 0.0, 0.0], device=pan.device) + 0.04 * dice.normal(3))
    return tx, 0.003 * dice.normal(3)


def _by_hand(dice: Dice) -> tuple[Tensor, Tensor]:
    """Turning by hand while the picture is read: cubics, their size log-uniform over a range of twenty."""
    falling = torch.tensor([1.0, 0.7, 0.3], device=dice.generator.device)

    def cubic() -> Tensor:
        return torch.exp(dice.between(math.log(0.004), math.log(0.08)))[:, None] * falling * dice.normal(3)

    return cubic(), cubic()
