"""segment-transformer: the network of that estimator, line segments in, row motion out; and its training.

A set of segments (tokens) goes through a small transformer without positional encoding. Learned latents attend to them,
and a head outputs the coefficients of two cubics. The estimate moves the segments to their global-shutter positions,
and the same network corrects the remaining motion, ``iterations`` times. It is trained on drawn scenes, by the EPE
after each iteration and the camera's pose. Its weights are stored as an .npz file, which unshutter runs with NumPy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.motion import geometry
from unshutter.single.network import FEATURES, Weights, features, read_weights, undo_motion, write_weights
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.motions import cubic_motion
from unshutter_lab.training.recipes import Recipe, validation_figures
from unshutter_lab.training.scenes import SceneConfig, Scenes, draw_scenes


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
        self.register_buffer("basis", legendre_to_powers(), persistent=False)

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
        x = self.embed(features(tokens, undo_motion(tokens, motion)))
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


def legendre_to_powers() -> Tensor:
    """[3, 3]: shifted Legendre polynomials of degree 1 to 3, minus their value at u = 0, in powers of u."""
    return torch.tensor([[2.0, 0.0, 0.0], [-6.0, 6.0, 0.0], [12.0, -30.0, 20.0]])


# stored name -> the network's name; * is the number of a block
_LINEAR = {
    "embedding.hidden": "embed.0",
    "embedding.output": "embed.2",
    "blocks.attention.query": "blocks.*.attention.query",
    "blocks.attention.key_value": "blocks.*.attention.key_value",
    "blocks.attention.output": "blocks.*.attention.out",
    "blocks.mlp.hidden": "blocks.*.mlp.0",
    "blocks.mlp.output": "blocks.*.mlp.2",
    "pooling.query": "pool.query",
    "pooling.key_value": "pool.key_value",
    "pooling.output": "pool.out",
    "head.hidden": "head.1",
    "head.output": "head.3",
}
_NORMS = {
    "blocks.attention.norm": "blocks.*.norm1",
    "blocks.mlp.norm": "blocks.*.norm2",
    "pooling.norm": "pool_norm",
    "head.norm": "head.0",
}
_LATENTS = ("pooling.latents", "latents")


def weights_of(network: SegmentTransformer) -> Weights:
    """Returns the weights of a trained network, by their names in the file."""
    state = {name: value.detach().cpu().numpy() for name, value in network.state_dict().items()}
    config = network.config
    weights = {"heads": np.array(config.heads), "iterations": np.array(config.iterations_in_use)}
    for stored, own, is_weight in _pairs():
        arrays = [state[name].T if is_weight else state[name] for name in _numbered(own, config.layers)]
        weights[stored] = np.ascontiguousarray(np.stack(arrays) if "*" in own else arrays[0], np.float32)
    return weights


def network_of(weights: Weights) -> SegmentTransformer:
    """Returns a trainable network with stored weights."""
    layers, width = weights["blocks.attention.query.weight"].shape[:2]
    latents = len(weights["pooling.latents"])
    heads, iterations = int(weights["heads"]), int(weights["iterations"])
    config = SegmentTransformerConfig(width, layers, heads, latents, iterations_in_use=iterations)
    state = {}
    for stored, own, is_weight in _pairs():
        array = weights[stored]
        for name, one in zip(_numbered(own, layers), array if "*" in own else [array], strict=True):
            state[name] = torch.tensor(one.T if is_weight else one)
    network = SegmentTransformer(config)
    network.load_state_dict(state)
    return network


def _pairs() -> Iterator[tuple[str, str, bool]]:
    """Yields each array's name in the file, its name in the network, and whether it is a linear layer's weight."""
    yield (*_LATENTS, False)
    for stored, own in _LINEAR.items():
        yield f"{stored}.weight", f"{own}.weight", True
        yield f"{stored}.bias", f"{own}.bias", False
    for stored, own in _NORMS.items():
        yield f"{stored}.scale", f"{own}.weight", False
        yield f"{stored}.shift", f"{own}.bias", False


def _numbered(own: str, layers: int) -> list[str]:
    return [own.replace("*", str(k)) for k in range(layers)] if "*" in own else [own]


_GRID = 16  # the EPE is taken on a grid of this many points squared
_CAMERA_SPREAD = (0.05, 0.15, 0.35)  # typical roll [rad], tilt [rad], log focal length, for equal weighting
_CAMERA_WEIGHT = 0.5
_VALIDATION_SEED, _VALIDATION_BATCHES = 2**40, 8


class SegmentRecipe(Recipe):
    """Recipe of ``segment-transformer``."""

    model_file = "model.npz"

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        if "folder" in config.data:
            raise UsageError("segment-transformer learns from drawn scenes, not from photos: leave out --photos")
        self.network_config = from_table(SegmentTransformerConfig, config.network, "[network]")
        self.scenes = from_table(SceneConfig, config.data, "[data]")

    def build(self) -> nn.Module:
        """Returns a new network."""
        return SegmentTransformer(self.network_config)

    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the summed mean EPE of the iterations [px at 256 rows], plus a Huber loss on the camera."""
        scenes = draw_scenes(self.config.batch, self.scenes, generator)
        motions, camera = network(scenes.tokens, scenes.mask)
        errors = torch.stack([motion_epe(m, scenes).mean() for m in motions])
        off = (camera - scenes.camera) / camera.new_tensor(_CAMERA_SPREAD)
        camera_loss = F.huber_loss(off, torch.zeros_like(off))
        log = {"epe": errors[-1].item(), "epe_first": errors[0].item(), "camera": camera_loss.item()}
        return errors.sum() + _CAMERA_WEIGHT * camera_loss, log

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns median EPE and share improved over no correction, on drawn scenes with their own seed."""
        generator = torch.Generator(self.device).manual_seed(_VALIDATION_SEED)
        errors, untouched = [], []
        for _ in range(_VALIDATION_BATCHES):
            scenes = draw_scenes(64, self.scenes, generator)
            motions, _ = network(scenes.tokens, scenes.mask)
            errors.append(motion_epe(motions[-1], scenes))
            untouched.append(motion_epe(torch.zeros_like(motions[-1]), scenes))
        return validation_figures(torch.cat(errors), torch.cat(untouched))

    def load_model(self, network: nn.Module, path: Path) -> None:
        """See :class:`Recipe`."""
        stored = network_of(read_weights(path)).state_dict()
        shapes = {name: value.shape for name, value in network.state_dict().items()}
        if shapes != {name: value.shape for name, value in stored.items()}:
            raise UsageError(f"cannot start from {path}: the size of its network differs")
        network.load_state_dict(stored)

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes the weights, which unshutter runs with NumPy."""
        write_weights(path, weights_of(network))  # type: ignore[arg-type]


def motion_epe(motion: Tensor, scenes: Scenes) -> Tensor:
    """[B] mean distance [px of 256 rows] between the GS points of an RS grid under two motions.

    Computed on the RS side, where Eq. 1 is closed-form; it differs from the EPE of the backward map only by the small
    stretch of the map.
    """
    line = (torch.arange(_GRID, device=motion.device) + 0.5) / _GRID - 0.5
    y, x = torch.meshgrid(line, line, indexing="ij")
    x = x.reshape(1, -1) * scenes.aspect[:, None]
    y = y.reshape(1, -1).expand_as(x)

    def gs(tx: Tensor, rz: Tensor) -> Tensor:
        t, r, _ = cubic_motion(tx, rz)(y)
        return torch.stack(geometry.rs_to_gs(x, y, t, r), -1)

    difference = gs(motion[:, 0], motion[:, 1]) - gs(scenes.tx, scenes.rz)
    # the root's slope is infinite at zero, reached by pictures without motion: hence a small constant
    return (difference.square().sum(-1) + 1e-10).sqrt().mean(-1) * 256
