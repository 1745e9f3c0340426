"""Training of the segment transformer: on drawn scenes, by the EPE after each iteration and the camera's pose."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.estimators.segment_transformer.weights import read_weights, write_weights
from unshutter.geometry import rows as geometry
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.data.motions import cubic_motion
from unshutter_lab.training.data.scenes import SceneConfig, Scenes, draw_scenes
from unshutter_lab.training.motion_errors import validation_figures
from unshutter_lab.training.recipes import Recipe
from unshutter_lab.training.segment_transformer.network import SegmentTransformer, SegmentTransformerConfig
from unshutter_lab.training.segment_transformer.onnx_loop import export_loop
from unshutter_lab.training.segment_transformer.weights import network_of, weights_of

_GRID = 16  # the EPE is taken on a grid of this many points squared
_CAMERA_SPREAD = (0.05, 0.15, 0.35)  # typical roll [rad], tilt [rad], log focal length, for equal weighting
_CAMERA_WEIGHT = 0.5
_VALIDATION_SEED, _VALIDATION_BATCHES = 2**40, 8


class SegmentRecipe(Recipe):
    """Recipe of ``segment-transformer``."""

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

    def start_from_stored(self, network: nn.Module, weights: Path) -> None:
        """See :class:`Recipe`."""
        stored = network_of(read_weights(weights, self.config.model)).state_dict()
        shapes = {name: value.shape for name, value in network.state_dict().items()}
        if shapes != {name: value.shape for name, value in stored.items()}:
            raise UsageError(f"cannot start from {weights}: it is a network of another size")
        network.load_state_dict(stored)

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes ONNX: tokens [batch, segments, 6], mask [batch, segments] -> coefficients [batch, 2, 3].

        Also writes an .npz with the same weights, which unshutter runs without onnxruntime.
        """
        write_weights(path.with_suffix(".npz"), weights_of(network))  # type: ignore[arg-type]
        step = MirroredStep(network).eval().cpu()
        example = (torch.rand(1, 16, 6) - 0.5, torch.ones(1, 16, dtype=torch.bool), torch.zeros(1, 2, 3))
        export_loop(step, example, path, iterations=self.network_config.iterations_in_use)


class MirroredStep(nn.Module):
    """One exported iteration: the correction averaged over the picture and its mirror image.

    Mirroring left and right turns (t_x, r_z) into (-t_x, -r_z). The average of both outputs is exactly antisymmetric,
    and slightly more accurate than either.
    """

    mirror: Tensor

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network
        self.register_buffer("mirror", torch.tensor([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0]), persistent=False)

    def forward(self, tokens: Tensor, mask: Tensor, motion: Tensor) -> Tensor:
        """Maps tokens [B, N, 6], mask [B, N] and current motion [B, 2, 3] to the new motion [B, 2, 3]."""
        tokens = torch.cat([tokens, tokens * self.mirror])
        correction, _ = self.network.correct(tokens, torch.cat([mask, mask]), torch.cat([motion, -motion]))  # type: ignore[operator]
        straight, mirrored = correction.chunk(2)
        return motion + (straight - mirrored) / 2


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
