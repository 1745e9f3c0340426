"""rengarajan2017: both networks of the learned predecessor (Rengarajan, Balaji, Rajagopalan, CVPR 2017).

A picture of 256 x 256 px, minus the mean picture, goes through convolutions without padding; fully connected layers
output t_x and r_z at 15 key rows, and the least-squares quadratic through these gives every row. We rectify with the
exact inverse of that motion, which the original approximates by a search over rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter_lab.training.motion_errors import TX_UNIT

SIZE = 256  # px, rows and columns
KEY_ROWS = tuple(range(0, 256, 18))  # 15 rows, 0 ... 252
_ROWCOL_HEIGHTS = (64, 36, 19)  # of the row bank's kernels, 3 wide; the column bank uses their transposes


@dataclass(frozen=True)
class Rengarajan2017Config:
    """The choice between the two networks, and their options."""

    network: str = "vanilla"  # vanilla | rowcol
    batch_norm: bool = True
    bank_units: int = 4096  # of the layer that adds the two banks of rowcol
    dropout: float = 0.5  # of rowcol

    def __post_init__(self) -> None:
        if self.network not in ("vanilla", "rowcol"):
            raise UsageError(f"[network]: unknown network '{self.network}': choose vanilla or rowcol")


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
