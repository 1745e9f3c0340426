"""Training of kandula2020: first regression of the true motion, then the paper's four losses on pictures."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter.geometry import rows as geometry
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.data.pixels import PixelConfig, PixelData, Samples
from unshutter_lab.training.kandula2020.losses import LossConfig, edge_loss, literal_edge_loss, not_black, visible_mse
from unshutter_lab.training.kandula2020.network import Kandula2020, Kandula2020Config, rectify, regenerate
from unshutter_lab.training.motion_errors import epe, epe_of_nothing, motion_distance, motion_mse, validation_figures
from unshutter_lab.training.onnx_export import export_onnx
from unshutter_lab.training.recipes import Recipe
from unshutter_lab.training.warping import from_first_row, pixel_grid, rs_positions

_ROW_STEP = 8  # px between the pixels at which row maps are compared, since the row block's own grid is coarse


class KandulaRecipe(Recipe):
    """Recipe of ``kandula2020``. ``[loss]`` holds the phases and the weights (losses.py)."""

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        self.network_config = from_table(Kandula2020Config, config.network, "[network]")
        self.weights = from_table(LossConfig, config.loss, "[loss]")
        pixels = from_table(PixelConfig, config.data, "[data]")
        if pixels.size != self.network_config.size:
            raise UsageError(f"[data] size {pixels.size} and [network] size {self.network_config.size} must agree")
        self.data = PixelData(pixels, device)

    def build(self) -> nn.Module:
        """Returns a new network."""
        return Kandula2020(self.network_config).to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the error of the motion on a few photos (first phase), or the paper's Eq. 2 (second phase)."""
        if self.weights.regress_only or step < self.weights.regress_steps:
            return self._regression(network, generator)
        samples = self.data.batch(self.config.batch, generator)
        motion, row_map = network(samples.rs)
        losses = picture_losses(samples, motion, row_map, self.weights)
        total = torch.stack([getattr(self.weights, name) * value for name, value in losses.items()]).sum()
        log = {name: value.item() for name, value in losses.items()}
        return total, log | {"motion": _motion_error(motion.detach(), samples).item()}

    def _regression(self, network: nn.Module, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the error of the motion and, with ``row_residual``, of the row map."""
        photos = None if self.weights.regress_only else self.weights.regress_photos or None
        samples = self.data.batch(self.config.batch, generator, photos, with_gs=False)
        rows = self.weights.row_residual > 0
        motion, row_map = network(samples.rs, rows=rows)
        square = _motion_error(motion, samples)
        error = square if self.weights.regress_norm == "square" else _motion_distance(motion, samples)
        figures = {"motion": square.item()}
        loss = self.weights.regress * error
        if row_map is None:
            return loss + _idle(network), figures
        row_error = row_map_error(row_map, samples)
        return loss + self.weights.row_residual * row_error, figures | {"row_map": row_error.item()}

    def pictures(self, count: int, generator: torch.Generator) -> Tensor:
        """See :class:`Recipe`."""
        return self.data.batch(count, generator).rs

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns the EPE on held-out photos, for the whole system and for its motion with the exact inverse.

        Also the system's EPE for other kinds of motion, and for training photos, unvaried and as used in training.
        """
        rows = not self.weights.regress_only
        system, exact, nothing = [], [], []
        for samples in self.data.validation():
            motion, row_map = network(samples.rs, rows=rows)
            motion0, shift = from_first_row(motion)
            system.append(epe(*rs_positions(motion, row_map), samples))
            exact.append(epe(*rs_positions(motion0, None, shift), samples))
            nothing.append(epe_of_nothing(samples))
        figures = validation_figures(torch.cat(system), torch.cat(nothing))
        figures["val_epe_exact_inverse"] = torch.cat(exact).median().item()
        for name, batches in self.data.other_checks().items():
            errors = [epe(*rs_positions(*network(samples.rs, rows=rows)), samples) for samples in batches]
            figures[name] = torch.cat(errors).median().item()
        return figures

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes ONNX: rs [batch, 3, r, r] RGB in 0 ... 1 -> motion [batch, 2, r], row_map [batch, r, r].

        The row map is omitted if it was not trained.
        """
        rows = self.network_config.row_layers > 0 and not self.weights.regress_only
        names = ["motion", "row_map"] if rows else ["motion"]
        inner = Exported(network, rows).eval().cpu()
        rs = torch.rand(1, 3, self.network_config.size, self.network_config.size)
        export_onnx(inner, (rs,), path, ["rs"], names, {name: {0: "batch"} for name in ["rs", *names]})


class Exported(nn.Module):
    """The exported part: the trajectory, and the row map if it was trained; not the warp."""

    def __init__(self, network: nn.Module, rows: bool):
        super().__init__()
        self.network, self.rows = network, rows

    def forward(self, rs: Tensor) -> tuple[Tensor, ...]:
        """Returns motion [B, 2, r] and row map [B, r, r], if there is one."""
        motion, row_map = self.network(rs, rows=self.rows)
        return (motion,) if row_map is None else (motion, row_map)


def picture_losses(samples: Samples, motion: Tensor, row_map: Tensor | None, config: LossConfig) -> dict[str, Tensor]:
    """Returns the paper's losses by the name of their weight in LossConfig, except those of weight 0.

    Args:
        samples: pictures [B, 3, r, r].
        motion: [B, 2, r] trajectory.
        row_map: [B, r, r], or None for the exact inverse.
        config: weights and mask. With ``at_a_time`` each loss is the mean over parts of the batch.
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
    literal = config.mask == "black"
    edges = literal_edge_loss if literal else edge_loss
    losses = {}
    if config.rectified or config.rectified_edges:
        rectified, mask = rectify(samples.rs, samples.rs_valid, motion, row_map)
        mask = not_black(rectified) if literal else mask
        losses["rectified"] = visible_mse(rectified, samples.gs, mask)
        losses["rectified_edges"] = edges(rectified, samples.gs, mask)
    if config.regenerated or config.regenerated_edges:
        regenerated, mask = regenerate(samples.gs, motion)
        if literal:
            mask = not_black(regenerated)
        else:
            mask, regenerated = mask * samples.rs_valid, regenerated * samples.rs_valid
        losses["regenerated"] = visible_mse(regenerated, samples.rs, mask)
        losses["regenerated_edges"] = edges(regenerated, samples.rs, mask)
    return {name: value for name, value in losses.items() if getattr(config, name)}


def row_map_error(row_map: Tensor, samples: Samples) -> Tensor:
    """Returns the mean distance [rows / 8] of row maps [B, r, r] from the true ones, on every eighth pixel."""
    col, row = (line.flatten()[_ROW_STEP // 2 :: _ROW_STEP] for line in pixel_grid(samples.size, samples.rs))
    _, true = geometry.gs_to_rs(col[None], row[:, None] + 0 * col, samples.motion, samples.center)
    sampled = row_map[:, _ROW_STEP // 2 :: _ROW_STEP, _ROW_STEP // 2 :: _ROW_STEP]
    return (sampled - true).abs().mean() / _ROW_STEP


def _motion_distance(motion: Tensor, samples: Samples) -> Tensor:
    return motion_distance(motion[:, 0], motion[:, 1], *samples.row_motion())


def _motion_error(motion: Tensor, samples: Samples) -> Tensor:
    return motion_mse(motion[:, 0], motion[:, 1], *samples.row_motion())


def _idle(network: nn.Module) -> Tensor:
    """Returns a zero that depends on the row block: several processes must have gradients for the same weights."""
    weights = [w.sum() for name, w in network.named_parameters() if "row_block." in name]
    return 0.0 * torch.stack(weights).sum() if weights else torch.zeros(())
