"""The network of the estimator ``segment-transformer``: line segments in, row motion out.

A set of segments (tokens) goes through a small transformer without positional encoding. Learned latents attend to them,
and a head outputs the coefficients of two cubics. The estimate moves the segments to their global-shutter positions,
and the same network corrects the remaining motion, ``iterations`` times.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.estimators.segment_transformer.features import FEATURES, features, moved


@dataclass(frozen=True)
class SegmentTransformerConfig:
    """Size of the network."""

    width: int = 96
    layers: int = 4
    heads: int = 4
    latents: int = 4
    iterations: int = 2  # in training
    iterations_in_use: int = 3  # in the exported network


class SegmentTransformer(nn.Module):
    """Maps tokens and mask to polynomial coefficients of the row motion.

    Input: tokens [B, N, 6] and mask [B, N] as drawn by data/scenes.py (end points in rows, centred; unit vector towards
    the top of the scene). Output: the motion after each iteration, [iterations, B, 2, 3]: coefficients of u, u^2, u^3
    of t_x [rows] and r_z [rad], u = row coordinate + 1/2; and the camera [B, 3] (roll, tilt, log focal).
    """

    def __init__(self, config: SegmentTransformerConfig):
        super().__init__()
        self.config = config
        d = config.width
        self.embed = nn.Sequential(nn.Linear(FEATURES, d), nn.GELU(), nn.Linear(d, d))
        self.blocks = nn.ModuleList(_Block(d, config.heads) for _ in range(config.layers))
        self.latents = nn.Parameter(torch.randn(config.latents, d) * 0.5)
        self.pool = _Attention(d, config.heads)
        self.pool_norm = nn.LayerNorm(d)
        pooled = d * config.latents
        self.head = nn.Sequential(
            nn.LayerNorm(pooled), nn.Linear(pooled, 2 * d), nn.GELU(), last := nn.Linear(2 * d, 9)
        )
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.register_buffer("basis", _legendre_to_powers(), persistent=False)

    def forward(self, tokens: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`SegmentTransformer`."""
        motion = tokens.new_zeros(tokens.shape[0], 2, 3)
        history = []
        camera = tokens.new_zeros(tokens.shape[0], 3)
        for _ in range(self.config.iterations):
            correction, camera = self.correct(tokens, mask, motion.detach())
            motion = motion.detach() + correction
            history.append(motion)
        return torch.stack(history), camera

    def correct(self, tokens: Tensor, mask: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the correction to ``motion`` [B, 2, 3], and the camera [B, 3]."""
        x = self.embed(features(tokens, moved(tokens, motion)))
        bias = torch.zeros_like(mask, dtype=x.dtype).masked_fill(~mask, -1e4)[:, None, None]  # [B, 1, 1, N]
        for block in self.blocks:
            x = block(x, bias)
        latents = self.latents[None].expand(x.shape[0], -1, -1)
        pooled = self.pool(latents, self.pool_norm(x), bias)
        out = self.head(pooled.flatten(1))
        legendre = out[:, :6].view(-1, 2, 3) * out.new_tensor([[0.1], [0.06]])
        return legendre @ self.basis, out[:, 6:]


class _Attention(nn.Module):
    def __init__(self, d: int, heads: int):
        super().__init__()
        self.heads = heads
        self.query, self.key_value, self.out = nn.Linear(d, d), nn.Linear(d, 2 * d), nn.Linear(d, d)

    def forward(self, x: Tensor, context: Tensor, bias: Tensor) -> Tensor:
        def split(t: Tensor) -> Tensor:  # [B, N, d] -> [B, heads, N, d / heads]
            return t.unflatten(-1, (self.heads, -1)).transpose(1, 2)

        key, value = self.key_value(context).chunk(2, -1)
        y = F.scaled_dot_product_attention(split(self.query(x)), split(key), split(value), attn_mask=bias)
        return self.out(y.transpose(1, 2).flatten(2))


class _Block(nn.Module):
    def __init__(self, d: int, heads: int):
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(d), nn.LayerNorm(d)
        self.attention = _Attention(d, heads)
        self.mlp = nn.Sequential(nn.Linear(d, 2 * d), nn.GELU(), nn.Linear(2 * d, d))

    def forward(self, x: Tensor, bias: Tensor) -> Tensor:
        y = self.norm1(x)
        x = x + self.attention(y, y, bias)
        return x + self.mlp(self.norm2(x))


def _legendre_to_powers() -> Tensor:
    """[3, 3]: shifted Legendre polynomials of degree 1 to 3, minus their value at u = 0, in powers of u."""
    return torch.tensor([[2.0, 0.0, 0.0], [-6.0, 6.0, 0.0], [12.0, -30.0, 20.0]])
