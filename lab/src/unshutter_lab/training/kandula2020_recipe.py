"""The recipe of kandula2020: first its motion is regressed, then the paper's losses (Eq. 2) are minimised."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.kandula2020 import Exported, Kandula2020, Kandula2020Config, Shown, rectified_so_far
from unshutter_lab.training.kandula2020_losses import LossConfig, picture_losses, row_map_error
from unshutter_lab.training.pixels import Samples, from_first_row, rs_positions
from unshutter_lab.training.recipes import PixelRecipe, motion_distance, motion_mse
from unshutter_lab.training.weights import export_onnx


class KandulaRecipe(PixelRecipe):
    """Recipe of ``kandula2020``. ``[loss]`` holds the phases and the weights (LossConfig)."""

    more_figures = ("val_epe_exact_inverse",)

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        self.network_config = from_table(Kandula2020Config, config.network, "[network]")
        self.weights = from_table(LossConfig, config.loss, "[loss]")
        sizes = self.data.config.size, self.network_config.size
        if sizes[0] != sizes[1]:
            raise UsageError(f"[data] size {sizes[0]} and [network] size {sizes[1]} must agree")

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
        return total, log | {"motion": _off(motion_mse, motion.detach(), torch.stack(samples.row_motion(), 1)).item()}

    def _regression(self, network: nn.Module, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the error of the motion and, with ``row_residual``, of the row map."""
        photos = None if self.weights.regress_only else self.weights.regress_photos or None
        samples = self.data.batch(self.config.batch, generator, photos, with_gs=False)
        truth = torch.stack(samples.row_motion(), 1)
        again = round(self.weights.again * self.config.batch)
        rs = samples.rs
        if again:
            rs, truth = self.seen_again(network, rs, truth, again)
        motion, row_map = network(rs, rows=self.weights.row_residual > 0)
        square = _off(motion_mse, motion, truth)
        error = square if self.weights.regress_norm == "square" else _off(motion_distance, motion, truth)
        figures = {"motion": square.item()}
        loss = self.weights.regress * error
        if row_map is None:
            return loss + _idle(network), figures
        row_error = row_map_error(row_map[again:], samples[again:])
        return loss + self.weights.row_residual * row_error, figures | {"row_map": row_error.item()}

    @torch.no_grad()
    def seen_again(self, network: nn.Module, rs: Tensor, truth: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Returns pictures, the first of them rectified by the network, and the motions still to be found."""
        network.eval()
        motion = cast(Kandula2020, network).one_look(rs[:count])
        network.train()
        rest = truth[:count] - motion
        return torch.cat([rectified_so_far(rs[:count], motion), rs[count:]]), torch.cat([rest, truth[count:]])

    def positions(self, network: nn.Module, samples: Samples) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields the positions of the whole system, then those of its motion with the exact inverse."""
        motion, row_map = network(samples.rs, rows=not self.weights.regress_only)
        yield rs_positions(motion, row_map)
        motion0, shift = from_first_row(motion)
        yield rs_positions(motion0, None, shift)

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes ONNX: rs [batch, 3, r, r] RGB in 0 ... 1 -> motion [batch, 2, r], row_map [batch, r, r].

        The row map is omitted if it was not trained. With ``shown``, r is that, and the batch is one picture.
        """
        rows = self.network_config.row_layers > 0 and not self.weights.regress_only
        exported: nn.Module = Exported(network, rows)
        shown = self.network_config.shown
        if shown:
            exported = Shown(cast(Kandula2020, network))
        rs = torch.rand(1, 3, shown or self.network_config.size, shown or self.network_config.size)
        outputs = ["motion", "row_map"] if rows else ["motion"]
        export_onnx(exported.eval().cpu(), rs, path, outputs, any_batch=not shown)


def _off(measure: Callable[..., Tensor], motion: Tensor, truth: Tensor) -> Tensor:
    return measure(motion[:, 0], motion[:, 1], truth[:, 0], truth[:, 1])


def _idle(network: nn.Module) -> Tensor:
    """Returns a zero that depends on the row block, so that Adam counts these steps for its weights, too."""
    weights = [w.sum() for name, w in network.named_parameters() if "row_block." in name]
    return 0.0 * torch.stack(weights).sum() if weights else torch.zeros(())
