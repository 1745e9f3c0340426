"""Random motions in batches: the predecessor's quadratics, and motions as made by people.

The paper and its predecessor evaluate on quadratics; real hands shake far less, and people who pan a camera shear the
picture evenly. All have the first row as their reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from unshutter.errors import UsageError
from unshutter.motion import geometry


class Dice:
    """Random draws for a batch of B, from one generator and on its device."""

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


_FIRST, _SPAN = 50 / 356, 256 / 356  # the central 256 of the 356 canvas rows: canvas row / 356 = _FIRST + _SPAN * u

# standard deviations of the coefficients of u, u^2, u^3: of t_x in rows of the picture, of r_z in radians
_HAND = ((0.05, 0.015, 0.004), (0.02, 0.006, 0.002))
_PAN = ((0.06, 0.004, 0.002), (0.004, 0.003, 0.001))
KINDS = ("quadratic", "hand", "pan")


@dataclass(frozen=True)
class MotionConfig:
    """Shares of the kinds of motion; the rest are the predecessor's quadratics."""

    hand: float = 0.0  # shake of a hand holding still
    pan: float = 0.0  # a camera panning evenly

    def __post_init__(self) -> None:
        if min(self.hand, self.pan) < 0 or self.hand + self.pan > 1:
            raise UsageError("[data.motions]: shares must not be negative, nor more than 1 together")

    def kinds(self) -> tuple[str, ...]:
        """Returns the kinds with a positive share."""
        shares = {"quadratic": 1 - self.hand - self.pan, "hand": self.hand, "pan": self.pan}
        return tuple(kind for kind in KINDS if shares[kind] > 0)


def draw_mixture(
    batch: int, generator: torch.Generator, config: MotionConfig, still: float = 0.0, small: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Draws motions of all kinds in their shares: coefficients as returned by :func:`draw_motions`."""
    tx, rz = draw_motions(batch, generator, still, small)
    if config.kinds() == ("quadratic",):
        return tx, rz
    die = Dice(generator, batch).each()[:, None]
    for kind, low, high in (("hand", 0.0, config.hand), ("pan", config.hand, config.hand + config.pan)):
        other_tx, other_rz = draw_kind(kind, batch, generator)
        of_kind = (die >= low) & (die < high)
        tx, rz = torch.where(of_kind, other_tx, tx), torch.where(of_kind, other_rz, rz)
    return tx, rz


def draw_kind(kind: str, batch: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Draws motions of one kind: coefficients as returned by :func:`draw_motions`."""
    if kind == "quadratic":
        return draw_motions(batch, generator)
    dice = Dice(generator, batch)
    widths = torch.tensor({"hand": _HAND, "pan": _PAN}[kind], device=generator.device)
    tx, rz = (dice.normal(2, 3) * widths).unbind(1)
    return tx, rz


def draw_motions(
    batch: int, generator: torch.Generator, still: float = 0.0, small: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Draws the quadratics of Rengarajan et al. 2017 on their canvas, re-expanded from the picture's first row.

    A sixth of the motions are pure rotations, another sixth pure translations.

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
    """Returns the row motion with coefficients [B, 3] of u, u^2, u^3, for centred row coordinates [B, N] in rows."""
    constant = torch.zeros_like(tx[:, :1])
    full = [torch.cat([constant, c], -1)[:, None] for c in (tx, rz)]  # [B, 1, 4]
    return geometry.row_motion_from_polynomial(*full, first=-0.5, last=0.5)
