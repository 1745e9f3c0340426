"""kandula2020: the paper's network (Kandula, Kumar, Rajagopalan, JOSA A 37(10) 1574, 2020), block by block.

    motion block         RS picture -> t_x and r_z of every row
    trajectory module    their least-squares cubic
    row block            RS picture -> row map: the row whose motion applies to each pixel of the GS picture
    rectification        RS picture, warped by the trajectory sampled at the row map
    regeneration         GS picture, warped by the trajectory (training only)

The paper leaves kernel sizes, channels, strides and pooling open; they are fields of the configuration. Two choices
are ours: the last layer of the row block is linear and without batch normalisation, because a residual is signed, and
the row block works on a coarse grid that is enlarged, because a few pixels around a position do not reveal the
rotation. Positions and motions are as in pixels.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.motion import geometry
from unshutter_lab.training.pixels import pixel_grid, rs_positions, sample
from unshutter_lab.training.recipes import motion_size

_TX_SCALE, _RZ_SCALE = 32.0, 0.32  # px and rad per unit of output: both about the largest of typical motions
_ROW_SCALE = 8.0  # rows per unit of output
_ROW_STRIDES = (4, 4, 2)  # of the first layers of the row block; the others have stride 1


@dataclass(frozen=True)
class Kandula2020Config:
    """Sizes that the paper leaves open, and options for its ablations."""

    size: int = 256  # r: the picture is r x r, with one motion per row
    width: int = 32  # channels of the first convolution; the later ones have 2, 2 and 4, 4, 4 times as many
    first_stride: int = 1
    late_width: int = 0  # channels of the base block's last convolution, a half of the later ones'; 0: 2 w
    hidden: int = 512  # units of the first fully connected layer
    trajectory_degree: int = 3  # of the trajectory module; -1: no module, rows are independent (ablation)
    row_layers: int = 5  # convolutions of the row block; 0: exact inverse instead of a row block (ablation)
    row_width: int = 32  # channels of the row block
    row_input: Literal["picture", "trajectory"] = "picture"  # trajectory: the row block sees the motion, too (ours)
    kept: int = 0  # first convolutions that, like the row block then, keep the weights with which a run starts (ours)
    # in inference, a picture is looked at this often, each time as rectified so far; small motions are added (ours)
    looks: int = 1
    # side of the pictures that an exported network without row block reduces to ``size``; 0: none (ours)
    shown: int = 0
    mirror_average: bool = False  # in inference, the outputs for a picture and its mirror image are averaged (ours)

    def __post_init__(self) -> None:
        if self.size % 64:
            raise UsageError(f"[network]: size must be a multiple of 64, got {self.size}")
        if self.first_stride not in (1, 2):
            raise UsageError("[network]: first_stride must be 1 or 2")
        if self.shown and (self.row_layers or self.looks > 1):
            raise UsageError("[network]: shown needs row_layers = 0 and one look")
        if self.row_layers and self.row_layers < 2:
            raise UsageError("[network]: row_layers must be 0 (exact inverse) or at least 2")


class Kandula2020(nn.Module):
    """Maps RS pictures [B, 3, r, r] in 0 ... 1 to row motion [B, 2, r] (t_x [px], r_z [rad]) and row map [B, r, r].

    The row map is None without a row block, or if ``rows`` is False. In inference, ``mirror_average`` averages with the
    mirror image, whose motion has the opposite sign in the same rows, and ``looks`` may be more than one.
    """

    def __init__(self, config: Kandula2020Config):
        super().__init__()
        self.config = config
        self.motion_block = MotionBlock(config)
        self.trajectory = Trajectory(config.size, config.trajectory_degree) if config.trajectory_degree >= 0 else None
        self.row_block = RowBlock(config) if config.row_layers else None
        self._kept = [self.motion_block.base[2 * k] for k in range(config.kept)]
        if config.kept and self.row_block is not None:
            self._kept.append(self.row_block)
        for block in self._kept:
            block.requires_grad_(False)

    def train(self, mode: bool = True) -> Kandula2020:
        """Switches between training and use; blocks that are kept are always in use."""
        super().train(mode)
        for block in self._kept:
            block.eval()
        return self

    def forward(self, rs: Tensor, rows: bool = True) -> tuple[Tensor, Tensor | None]:
        """Returns trajectory and row map."""
        mirrored = self.config.mirror_average and not self.training
        motion = self.one_look(rs, mirrored)
        for _ in range(1, 1 if self.training else self.config.looks):
            more = self.one_look(rectified_so_far(rs, motion), mirrored)
            motion = motion + more * (motion_size(more) < _LARGEST_CHANGE * motion_size(motion))[:, None, None]
        if not rows or self.row_block is None:
            return motion, None
        if not mirrored:
            return motion, self.row_block(_scaled(rs), motion.detach())
        both = self.row_block(_scaled(torch.cat([rs, rs.flip(-1)])), torch.cat([motion, -motion]).detach())
        maps = both.unflatten(0, (2, -1))
        return motion, (maps[0] + maps[1].flip(-1)) / 2

    def one_look(self, rs: Tensor, mirrored: bool = False) -> Tensor:
        """Returns the trajectory that one look shows, or the average with that of the mirror image."""
        motion = self.motion_block(_scaled(torch.cat([rs, rs.flip(-1)]) if mirrored else rs))
        if self.trajectory is not None:
            motion = self.trajectory(motion)
        if not mirrored:
            return motion
        motion = motion.unflatten(0, (2, -1))
        return (motion[0] - motion[1]) / 2


# A further look at what is nearly right finds little; where it finds more than this share of the motion so far, neither
# answer can be trusted, and nothing is added.
_LARGEST_CHANGE = 0.5


def _scaled(rs: Tensor) -> Tensor:
    return (4 * rs - 2).contiguous(memory_format=torch.channels_last)


class MotionBlock(nn.Module):
    """Base block (3 convolutions), then a t_x and an r_z block (3 convolutions, 2 fully connected layers)."""

    def __init__(self, config: Kandula2020Config):
        super().__init__()
        w, last = config.width, config.size // 64
        late = config.late_width or 2 * w
        shrink = 2 if config.first_stride == 1 else 1
        self.base = nn.Sequential(
            _layer(3, w, 7, config.first_stride),
            nn.MaxPool2d(shrink) if shrink > 1 else nn.Identity(),
            _layer(w, 2 * w, 5),
            nn.MaxPool2d(2),
            _layer(2 * w, late, 3),
            nn.MaxPool2d(2),
        )  # an eighth of the size

        def branch() -> nn.Module:
            layers = [_layer(before * late, 2 * late, 3) for before in (1, 2, 2)]
            pooled = [module for layer in layers for module in (layer, nn.MaxPool2d(2))]
            hidden = nn.Linear(2 * late * last * last, config.hidden)
            return nn.Sequential(*pooled, nn.Flatten(), hidden, nn.ReLU(), nn.Linear(config.hidden, config.size))

        self.tx, self.rz = branch(), branch()

    def forward(self, x: Tensor) -> Tensor:
        """Maps [B, 3, r, r] to [B, 2, r]: t_x [px] and r_z [rad]."""
        features = self.base(x)
        return torch.stack([_TX_SCALE * self.tx(features).float(), _RZ_SCALE * self.rz(features).float()], 1)


class Trajectory(nn.Module):
    """Trajectory module: the least-squares polynomial of a given degree through the rows, [..., r] -> [..., r]."""

    smoother: Tensor

    def __init__(self, rows: int, degree: int):
        super().__init__()
        u = torch.arange(rows, dtype=torch.float64) / (rows - 1)
        powers = torch.stack([u**k for k in range(degree + 1)])  # [degree + 1, rows]
        self.register_buffer("smoother", (torch.linalg.pinv(powers) @ powers).float(), persistent=False)

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
    """Rectification module: warps RS pictures [B, C, r, r], valid where ``valid`` [B, 1, r, r] is 1, to GS ones.

    Args:
        rs, valid: the pictures.
        motion: [B, 2, r] t_x [px] and r_z [rad] of every row.
        row_map: [B, r, r] row whose motion applies to each GS pixel; None for the row that read it (exact inverse).

    Returns:
        [B, C, r, r] rectified pictures, black where invalid; [B, 1, r, r] mask of the valid pixels.
    """
    col, row = rs_positions(motion, row_map)
    values, inside = sample(rs, col, row)
    with torch.no_grad():  # a position between valid and invalid pixels is invalid
        whole = sample(valid, col, row)[0] > 0.999
    mask = inside * whole
    return values * mask, mask


def rectified_so_far(rs: Tensor, motion: Tensor) -> Tensor:
    """Returns RS pictures [B, 3, r, r] rectified by motions [B, 2, r], black where invalid."""
    last = motion.shape[-1] - 1
    row_map = pixel_grid(last + 1, rs)[1] + torch.zeros_like(rs[:, 0])
    for _ in range(2):  # solves for the row that read each pixel
        row_map = rs_positions(motion, row_map)[1].clamp(0, last)
    return sample(rs, *rs_positions(motion, row_map))[0]


def regenerate(gs: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Regeneration module: distorts the GS pictures by the estimated motion; returns pictures and mask as above."""
    size = motion.shape[-1]
    col, row = pixel_grid(size, gs)
    tx, rz = motion[:, 0, :, None], motion[:, 1, :, None]
    return sample(gs, *geometry.rs_to_gs(col, row, tx, rz, ((size - 1) / 2, (size - 1) / 2)))


def _layer(before: int, after: int, kernel: int, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(before, after, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))


class Exported(nn.Module):
    """The exported part: the trajectory, and the row map if it was trained; not the warp."""

    def __init__(self, network: nn.Module, rows: bool):
        super().__init__()
        self.network, self.rows = network, rows

    def forward(self, rs: Tensor) -> tuple[Tensor, ...]:
        """Returns motion [B, 2, r] and row map [B, r, r], if there is one."""
        motion, row_map = self.network(rs, rows=self.rows)
        return (motion,) if row_map is None else (motion, row_map)


class Shown(nn.Module):
    """Runs a network without row block on reduced pictures, one at a time, and enlarges its answer.

    Its operations are among those of OpenCV's dnn module from 4.11 on: no batch of two, no reversed slices.
    """

    mirrored: Tensor
    unit: Tensor

    def __init__(self, network: Kandula2020):
        super().__init__()
        self.network, self.size = network, network.config.size
        shown = network.config.shown
        rows = F.interpolate(torch.eye(self.size)[None], size=shown, mode="linear")[0]  # [size, shown]
        degree = network.config.trajectory_degree
        self.smooth = nn.ParameterList()  # matrices by which rows are multiplied in turn
        if network.trajectory is not None:  # of few degrees of freedom, so that narrow matrices suffice
            left, sizes, right = torch.linalg.svd(network.trajectory.smoother.cpu())
            self.smooth.append(left[:, : degree + 1] * sizes[: degree + 1])
            rows = right[: degree + 1] @ rows
        self.smooth.append(rows)
        self.smooth.requires_grad_(False)
        self.register_buffer("mirrored", torch.arange(self.size).flip(0), persistent=False)
        self.register_buffer("unit", torch.tensor([[shown / self.size], [1.0]]), persistent=False)

    def forward(self, rs: Tensor) -> tuple[Tensor]:
        """Returns motion [1, 2, shown] of rs [1, 3, shown, shown]: t_x [px of the picture given] and r_z [rad]."""
        small = F.interpolate(rs, size=(self.size, self.size), mode="bilinear")
        motion = self.network.motion_block(_scaled(small))
        if self.network.config.mirror_average:
            motion = (motion - self.network.motion_block(_scaled(small[..., self.mirrored]))) / 2
        for matrix in self.smooth:
            motion = motion @ matrix
        return (motion * self.unit,)
