"""kandula2020: the paper's network (Kandula, Kumar, Rajagopalan, JOSA A 37(10) 1574, 2020), block by block.

    motion block         RS picture -> t_x and r_z of every row
    trajectory module    their least-squares cubic
    row block            RS picture -> row map: the row whose motion applies to each pixel of the GS picture
    rectification        RS picture, warped by the trajectory sampled at the row map
    regeneration         GS picture, warped by the trajectory (training only)

The paper leaves kernel sizes, channels, strides and pooling open; they are fields of the configuration. Two choices
are ours: the last layer of the row block is linear and without batch normalisation, because a residual is signed, and
the row block works on a coarse grid that is enlarged, because a few pixels around a position do not reveal the
rotation.

Positions and motions are as in warping.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.geometry import rows as geometry
from unshutter_lab.training.warping import pixel_grid, rs_positions, sample

_TX_SCALE, _RZ_SCALE = 32.0, 0.32  # px and rad per unit of output: both about the largest of typical motions
_ROW_SCALE = 8.0  # rows per unit of output
_ROW_STRIDES = (4, 4, 2)  # of the first layers of the row block; the others have stride 1


@dataclass(frozen=True)
class Kandula2020Config:
    """Sizes that the paper leaves open, and options for its ablations."""

    size: int = 256  # r: the picture is r x r, with one motion per row
    width: int = 32  # channels of the first convolution; the later ones have 2, 2 and 4, 4, 4 times as many
    first_kernel: int = 7
    first_stride: int = 1
    pooling: str = "max"  # max | mean, after all convolutions of the motion block except the base block's last
    hidden: int = 512  # units of the first fully connected layer
    trajectory_degree: int = 3  # of the trajectory module; -1: no module, rows are independent (ablation)
    row_layers: int = 5  # convolutions of the row block; 0: exact inverse instead of a row block (ablation)
    row_width: int = 32  # channels of the row block
    row_input: str = "picture"  # picture | trajectory: the row block sees the motion in addition to the picture (ours)
    mirror_average: bool = False  # in inference, the outputs for a picture and its mirror image are averaged (ours)

    def __post_init__(self) -> None:
        if self.size % 64:
            raise UsageError(f"[network]: size must be a multiple of 64, got {self.size}")
        if self.first_stride not in (1, 2) or self.first_kernel % 2 == 0:
            raise UsageError("[network]: first_stride must be 1 or 2 and first_kernel odd")
        if self.pooling not in ("max", "mean"):
            raise UsageError(f"[network]: unknown pooling '{self.pooling}': choose max or mean")
        if self.row_layers and self.row_layers < 2:
            raise UsageError("[network]: row_layers must be 0 (exact inverse) or at least 2")
        if self.row_input not in ("picture", "trajectory"):
            raise UsageError(f"[network]: unknown row_input '{self.row_input}': choose picture or trajectory")


class Kandula2020(nn.Module):
    """Maps RS pictures [B, 3, r, r] in 0 ... 1 to row motion [B, 2, r] (t_x [px], r_z [rad]) and row map [B, r, r].

    The row map is None without a row block, or if ``rows`` is False (the first phase of training).
    """

    def __init__(self, config: Kandula2020Config):
        super().__init__()
        self.config = config
        self.motion_block = MotionBlock(config)
        self.trajectory = Trajectory(config.size, config.trajectory_degree) if config.trajectory_degree >= 0 else None
        self.row_block = RowBlock(config) if config.row_layers else None

    def forward(self, rs: Tensor, rows: bool = True) -> tuple[Tensor, Tensor | None]:
        """Returns trajectory and row map."""
        if self.config.mirror_average and not self.training:
            return self._mirror_average(rs, rows)
        return self._once(rs, rows)

    def _mirror_average(self, rs: Tensor, rows: bool) -> tuple[Tensor, Tensor | None]:
        """Averages with the mirror image, whose motion has the opposite sign in the same rows."""
        motion, row_map = self._once(torch.cat([rs, rs.flip(-1)]), rows)
        motion = motion.unflatten(0, (2, -1))
        if row_map is not None:
            maps = row_map.unflatten(0, (2, -1))
            row_map = (maps[0] + maps[1].flip(-1)) / 2
        return (motion[0] - motion[1]) / 2, row_map

    def _once(self, rs: Tensor, rows: bool) -> tuple[Tensor, Tensor | None]:
        x = (4 * rs - 2).contiguous(memory_format=torch.channels_last)
        motion = self.motion_block(x)
        if self.trajectory is not None:
            motion = self.trajectory(motion)
        return motion, self.row_block(x, motion.detach()) if rows and self.row_block is not None else None


class MotionBlock(nn.Module):
    """Base block (3 convolutions), then a t_x and an r_z block (3 convolutions, 2 fully connected layers)."""

    def __init__(self, config: Kandula2020Config):
        super().__init__()
        w, last = config.width, config.size // 64
        shrink = 2 if config.first_stride == 1 else 1
        self.base = nn.Sequential(
            _layer(3, w, config.first_kernel, config.first_stride),
            _pool(config, shrink),
            _layer(w, 2 * w, 5),
            _pool(config, 2),
            _layer(2 * w, 2 * w, 3),
            _pool(config, 2),
        )  # an eighth of the size

        def branch() -> nn.Module:
            return nn.Sequential(
                _layer(2 * w, 4 * w, 3),
                _pool(config, 2),
                _layer(4 * w, 4 * w, 3),
                _pool(config, 2),
                _layer(4 * w, 4 * w, 3),
                _pool(config, 2),
                nn.Flatten(),
                nn.Linear(4 * w * last * last, config.hidden),
                nn.ReLU(),
                nn.Linear(config.hidden, config.size),
            )

        self.tx, self.rz = branch(), branch()

    def forward(self, x: Tensor) -> Tensor:
        """Maps [B, 3, r, r] to [B, 2, r]: t_x [px] and r_z [rad]."""
        features = self.base(x)
        return torch.stack([_TX_SCALE * self.tx(features).float(), _RZ_SCALE * self.rz(features).float()], 1)


class Trajectory(nn.Module):
    """Trajectory module: the least-squares polynomial of a given degree through the rows, [..., r] -> [..., r].

    A fixed linear map, hence differentiable; it has no weights.
    """

    smoother: Tensor

    def __init__(self, rows: int, degree: int):
        super().__init__()
        projection = geometry.polynomial_projection(rows, degree, like=torch.zeros((), dtype=torch.float64))
        u = torch.arange(rows, dtype=torch.float64) / (rows - 1)
        powers = torch.stack([u**k for k in range(degree + 1)])  # [degree + 1, rows]
        self.register_buffer("smoother", (projection @ powers).float(), persistent=False)

    def forward(self, motion: Tensor) -> Tensor:
        """Returns the values of the fitted polynomial at every row."""
        with torch.autocast(motion.device.type, enabled=False):
            return motion.to(self.smoother.dtype) @ self.smoother


class RowBlock(nn.Module):
    """Convolutions that compute the residual of the row map, which is added to A(i, j) = i."""

    def __init__(self, config: Kandula2020Config):
        super().__init__()
        strides = [*_ROW_STRIDES, *[1] * config.row_layers][: config.row_layers]
        self.sees_motion = config.row_input == "trajectory"
        channels = [6 if self.sees_motion else 3, *[config.row_width] * (config.row_layers - 1)]
        kernels = [7, *[5] * (config.row_layers - 1)]
        layers = [
            _layer(before, after, kernel, stride)
            for (before, after), kernel, stride in zip(pairwise(channels), kernels, strides, strict=False)
        ]
        last = nn.Conv2d(channels[-1], 1, 3, strides[-1], padding=1)
        nn.init.zeros_(last.weight)  # training starts from A
        nn.init.zeros_(last.bias)  # type: ignore[arg-type]
        self.layers = nn.Sequential(*layers, last)
        self.size = config.size

    def forward(self, x: Tensor, motion: Tensor) -> Tensor:
        """Maps [B, 3, r, r] and the trajectory [B, 2, r] to the row map [B, r, r] [px]."""
        if self.sees_motion:
            x = torch.cat([x, self._motion_planes(motion)], 1)
        residual = F.interpolate(self.layers(x).float(), size=(self.size, self.size), mode="bilinear")[:, 0]
        return _ROW_SCALE * residual + pixel_grid(self.size, residual)[1]

    def _motion_planes(self, motion: Tensor) -> Tensor:
        """[B, 3, r, r] t_x, r_z and the vertical displacement caused by r_z: all of the order of one."""
        col = pixel_grid(self.size, motion)[0] / (self.size / 2) - 1  # [1, r]
        tx, rz = (motion[:, 0] / _TX_SCALE)[..., None], (motion[:, 1] / _RZ_SCALE)[..., None]  # [B, r, 1]
        return torch.stack(torch.broadcast_tensors(tx, rz, 4 * rz * col), 1)


def rectify(rs: Tensor, valid: Tensor, motion: Tensor, row_map: Tensor | None) -> tuple[Tensor, Tensor]:
    """Rectification module: warps the RS pictures to global-shutter ones.

    Args:
        rs: [B, C, r, r].
        valid: [B, 1, r, r], 1 where they are valid.
        motion: [B, 2, r] t_x [px] and r_z [rad] of every row.
        row_map: [B, r, r] row whose motion applies to each GS pixel; None for the row that read it (exact inverse).

    Returns:
        [B, C, r, r] rectified pictures, black where invalid; [B, 1, r, r] mask of the valid pixels.
    """
    return _warp(rs, valid, *rs_positions(motion, row_map))


def regenerate(gs: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Regeneration module: distorts the GS pictures by the estimated motion; returns pictures and mask as above."""
    size = motion.shape[-1]
    col, row = pixel_grid(size, gs)
    tx, rz = motion[:, 0, :, None], motion[:, 1, :, None]
    return sample(gs, *geometry.rs_to_gs(col, row, tx, rz, ((size - 1) / 2, (size - 1) / 2)))


def _warp(picture: Tensor, valid: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    values, inside = sample(picture, col, row)
    with torch.no_grad():  # a position between valid and invalid pixels is invalid
        whole = sample(valid, col, row)[0] > 0.999
    mask = inside * whole
    return values * mask, mask


def _layer(before: int, after: int, kernel: int, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))


def _pool(config: Kandula2020Config, factor: int) -> nn.Module:
    if factor == 1:
        return nn.Identity()
    return nn.MaxPool2d(factor) if config.pooling == "max" else nn.AvgPool2d(factor)
