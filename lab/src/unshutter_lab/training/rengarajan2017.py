"""rengarajan2017: both networks of the learned predecessor (Rengarajan, Balaji, Rajagopalan, CVPR 2017), and training.

A picture of 256 x 256 px, minus the mean picture, goes through convolutions without padding; fully connected layers
output t_x and r_z at 15 key rows, and the least-squares quadratic through these gives every row. We rectify with the
exact inverse of that motion, which the original approximates by a search over rows. Training regresses the motion at
the key rows, as in the original program.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.pixels import Samples, from_first_row, rs_positions
from unshutter_lab.training.recipes import TX_UNIT, PixelRecipe, motion_mse
from unshutter_lab.training.weights import export_onnx

SIZE = 256  # px, rows and columns
KEY_ROWS = tuple(range(0, 256, 18))  # 15 rows, 0 ... 252
_ROWCOL_HEIGHTS = (64, 36, 19)  # of the row bank's kernels, 3 wide; the column bank uses their transposes


@dataclass(frozen=True)
class Rengarajan2017Config:
    """The choice between the two networks, and their options."""

    network: Literal["vanilla", "rowcol"] = "vanilla"
    batch_norm: bool = True
    bank_units: int = 4096  # of the layer that adds the two banks of rowcol
    dropout: float = 0.5  # of rowcol


def build(config: Rengarajan2017Config) -> VanillaCNN | RowColCNN:
    """Returns a new network of the configured kind."""
    if config.network == "rowcol":
        return RowColCNN(config)  # not channels-last, which makes its wide kernels a hundred times slower on CPUs
    return VanillaCNN(config.batch_norm).to(memory_format=torch.channels_last)  # type: ignore[call-overload]


class _KeyRows(nn.Module, ABC):
    """Common part of both networks: the mean picture, and the interpretation of the 30 outputs."""

    mean: Tensor

    def __init__(self):
        super().__init__()
        self.register_buffer("mean", torch.full((3, SIZE, SIZE), 0.5))

    def forward(self, rs: Tensor) -> Tensor:
        """Maps RS pictures [B, 3, 256, 256] in 0 ... 1 to [B, 2, 15]: t_x [px] and r_z [rad] at the key rows."""
        out = self.outputs(rs - self.mean)
        unit = torch.tensor([TX_UNIT, 1.0], device=out.device)[:, None]
        return out.float().view(-1, 2, len(KEY_ROWS)) * unit

    @abstractmethod
    def outputs(self, x: Tensor) -> Tensor:
        """Returns [B, 30]: 15 t_x [100 px], then 15 r_z [rad]."""


class VanillaCNN(_KeyRows):
    """Four convolutions, three fully connected layers."""

    def __init__(self, batch_norm: bool):
        super().__init__()
        self.features = nn.Sequential(
            *_layer(3, 32, (11, 11), batch_norm),
            nn.MaxPool2d(2),
            *_layer(32, 64, (7, 7), batch_norm),
            nn.MaxPool2d(2),
            *_layer(64, 64, (5, 5), batch_norm),
            nn.MaxPool2d(2),
            *_layer(64, 64, (3, 3), batch_norm),
            nn.MaxPool2d(2),
            nn.Flatten(),  # 9216
        )
        self.head = nn.Sequential(
            nn.Linear(9216, 1024), nn.Tanh(), nn.Linear(1024, 256), nn.Hardtanh(), nn.Linear(256, 2 * len(KEY_ROWS))
        )

    def outputs(self, x: Tensor) -> Tensor:
        """Returns [B, 30]."""
        return self.head(self.features(x.contiguous(memory_format=torch.channels_last)))


class RowColCNN(_KeyRows):
    """Two convolutions, then a bank of tall and a bank of wide kernels whose outputs are added."""

    def __init__(self, config: Rengarajan2017Config):
        super().__init__()
        norm, drop = config.batch_norm, config.dropout
        self.features = nn.Sequential(
            *_layer(3, 32, (11, 11), norm), nn.MaxPool2d(2), *_layer(32, 32, (7, 7), norm)
        )  # [B, 32, 117, 117]

        def bank(transposed: bool) -> nn.Module:
            channels, layers = 32, []
            for height in _ROWCOL_HEIGHTS:
                layers += _layer(channels, 64, (3, height) if transposed else (height, 3), norm)
                channels = 64
            return nn.Sequential(*layers, nn.Flatten(), nn.Linear(7104, config.bank_units))

        self.rows, self.columns = bank(transposed=False), bank(transposed=True)
        self.head = nn.Sequential(
            nn.Tanh(),
            nn.Linear(config.bank_units, 512),
            nn.Dropout(drop),
            nn.Tanh(),
            nn.Linear(512, 128),
            nn.Dropout(drop),
            nn.Hardtanh(),
            nn.Linear(128, 2 * len(KEY_ROWS)),
        )

    def outputs(self, x: Tensor) -> Tensor:
        """Returns [B, 30]."""
        features = self.features(x)
        return self.head(self.rows(features) + self.columns(features))


def quadratic(key_rows: Tensor) -> Tensor:
    """Maps [B, 2, 15] motion at the key rows to [B, 2, 256] of every row, by the least-squares quadratic."""
    known = torch.tensor(KEY_ROWS, dtype=torch.float64) / SIZE
    every = torch.arange(SIZE, dtype=torch.float64) / SIZE
    powers, all_powers = (torch.stack([u**k for k in range(3)], -1) for u in (known, every))
    return key_rows @ (all_powers @ torch.linalg.pinv(powers)).T.to(key_rows)


def _layer(before: int, after: int, kernel: tuple[int, int], batch_norm: bool) -> list[nn.Module]:
    norm = [nn.BatchNorm2d(after)] if batch_norm else []
    return [nn.Conv2d(before, after, kernel), *norm, nn.ReLU(inplace=True)]


_MEAN_BATCHES, _MEAN_SEED = 8, 2**41


class RengarajanRecipe(PixelRecipe):
    """Recipe of ``rengarajan2017``."""

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        self.network_config = from_table(Rengarajan2017Config, config.network, "[network]")
        if self.data.config.size != SIZE:
            raise UsageError(f"[data]: rengarajan2017 reads pictures of {SIZE} px, not {self.data.config.size}")

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

    def positions(self, network: nn.Module, samples: Samples) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields the positions of the exact inverse."""
        motion, shift = from_first_row(quadratic(network(samples.rs)))
        yield rs_positions(motion, None, shift)

    def export(self, network: nn.Module, path: Path) -> None:
        """Writes ONNX: rs [batch, 3, 256, 256] RGB in 0 ... 1 -> key_rows [batch, 2, 15] (t_x [px], r_z [rad])."""
        export_onnx(network.eval().cpu(), torch.rand(1, 3, SIZE, SIZE), path, ["key_rows"])
