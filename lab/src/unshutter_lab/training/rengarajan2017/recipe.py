"""Training of rengarajan2017: regression of the motion at the key rows, as in the original program."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.data.pixels import PixelConfig, PixelData, Samples
from unshutter_lab.training.motion_errors import epe, epe_of_nothing, motion_mse, validation_figures
from unshutter_lab.training.onnx_export import export_onnx
from unshutter_lab.training.recipes import Recipe
from unshutter_lab.training.rengarajan2017.network import (
    KEY_ROWS,
    SIZE,
    Rengarajan2017Config,
    RowColCNN,
    VanillaCNN,
    build,
    quadratic,
)
from unshutter_lab.training.warping import from_first_row, rs_positions

_MEAN_BATCHES, _MEAN_SEED = 8, 2**41


class RengarajanRecipe(Recipe):
    """Recipe of ``rengarajan2017``."""

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        self.network_config = from_table(Rengarajan2017Config, config.network, "[network]")
        pixels = from_table(PixelConfig, config.data, "[data]")
        if pixels.size != SIZE:
            raise UsageError(f"[data]: rengarajan2017 reads pictures of {SIZE} px, not {pixels.size}")
        self.data = PixelData(pixels, device)

    def build(self) -> nn.Module:
        """Returns a new network, with the mean of some RS pictures."""
        network: VanillaCNN | RowColCNN = build(self.network_config)
        generator = torch.Generator(self.device).manual_seed(_MEAN_SEED)
        means = [self.data.batch(16, generator, with_gs=False).rs.mean(0) for _ in range(_MEAN_BATCHES)]
        network.mean.copy_(torch.stack(means).mean(0))
        return network

    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the MSE of (t_x / 100 px, r_z / rad) at the key rows."""
        samples = self.data.batch(self.config.batch, generator, with_gs=False)
        tx, rz = network(samples.rs).unbind(1)
        true_tx, true_rz = samples.row_motion()
        rows = list(KEY_ROWS)
        return motion_mse(tx, rz, true_tx[:, rows], true_rz[:, rows]), {}

    def pictures(self, count: int, generator: torch.Generator) -> Tensor:
        """See :class:`Recipe`."""
        return self.data.batch(count, generator).rs

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns the EPE on held-out photos, for other kinds of motion, and on training photos."""
        error, nothing = [], []
        for samples in self.data.validation():
            error.append(_epe(network, samples))
            nothing.append(epe_of_nothing(samples))
        figures = validation_figures(torch.cat(error), torch.cat(nothing))
        for name, batches in self.data.other_checks().items():
            figures[name] = torch.cat([_epe(network, samples) for samples in batches]).median().item()
        return figures

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes ONNX: rs [batch, 3, 256, 256] RGB in 0 ... 1 -> key_rows [batch, 2, 15] (t_x [px], r_z [rad])."""
        example = torch.rand(1, 3, SIZE, SIZE)
        free = {"rs": {0: "batch"}, "key_rows": {0: "batch"}}
        export_onnx(network.eval().cpu(), (example,), path, ["rs"], ["key_rows"], free)


def _epe(network: nn.Module, samples: Samples) -> Tensor:
    motion, shift = from_first_row(quadratic(network(samples.rs)))
    return epe(*rs_positions(motion, None, shift), samples)
