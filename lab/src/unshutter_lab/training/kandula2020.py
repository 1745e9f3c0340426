"""kandula2020: the paper's network (Kandula, Kumar, Rajagopalan, JOSA A 37(10) 1574, 2020), block by block, and losses.

    motion block         RS picture -> t_x and r_z of every row
    trajectory module    their least-squares cubic
    row block            RS picture -> row map: the row whose motion applies to each pixel of the GS picture
    rectification        RS picture, warped by the trajectory sampled at the row map
    regeneration         GS picture, warped by the trajectory (training only)

The paper leaves kernel sizes, channels, strides and pooling open; they are fields of the configuration. Two choices
are ours: the last layer of the row block is linear and without batch normalisation, because a residual is signed, and
the row block works on a coarse grid that is enlarged, because a few pixels around a position do not reveal the
rotation. Positions and motions are as in pixels.py.

The paper's losses are squared L2 norms; here each is a mean over valid pixels (and channels), so that the weights
1, 1, 0.5, 0.5 have the same meaning at every picture and batch size. A pixel of a warped picture is valid if its
sampling position lies inside a valid part of the source, so that a black pixel of the scene counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.motion import geometry
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.pixels import Samples, from_first_row, pixel_grid, rs_positions, sample
from unshutter_lab.training.recipes import PixelRecipe, motion_distance, motion_mse, motion_size
from unshutter_lab.training.weights import export_onnx


@dataclass(frozen=True)
class LossConfig:
    """Weights and phases; a weight of 0 omits its loss (ablations)."""

    rectified: float = 1.0  # lambda_1
    regenerated: float = 1.0  # lambda_2
    rectified_edges: float = 0.5  # lambda_3
    regenerated_edges: float = 0.5  # lambda_4
    regress_steps: int = 800  # first phase: steps in which the true motion is regressed
    regress_photos: int = 50  # photos of the first phase; 0: all
    # Weight of the regression, chosen so that the gradients of both phases have a similar size: Adam divides by the
    # size it remembers, and with a weight of 1 the second phase's first steps would be several times too long.
    regress: float = 30.0
    # mean squared error, or mean distance, which is less sensitive to outliers
    regress_norm: Literal["square", "distance"] = "square"
    # Weight of the row map's own error in the first phase; ours: the paper's row block learns from pictures alone.
    row_residual: float = 0.0
    again: float = 0.0  # share of the first phase's pictures that are seen as the network itself rectifies them (ours)
    at_a_time: int = 0  # pictures whose losses are computed together, since few fit into a CPU's cache; 0: all
    regress_only: bool = False  # the paper's own ablation: no second phase, all photos


def visible_mse(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Visibility-aware MSE of [B, C, H, W]: mean of (warped - mask * target)^2 where the mask [B, 1, H, W] is 1."""
    return (warped - mask * target).square().sum() / (mask.sum() * warped.shape[1]).clamp(min=1)


def edge_loss(warped: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    """Mean squared difference of the Sobel edges over the pixels without invalid neighbours.

    The paper's own form, E(warped) - mask * E(target), also penalises the border of the warped picture.
    """
    inner = 1 - F.max_pool2d(F.pad(1 - mask, (1, 1, 1, 1)), 3, stride=1)
    difference = sobel(warped - target) * inner  # Sobel is linear
    return difference.square().sum() / (inner.sum() * difference.shape[1]).clamp(min=1)


def sobel(picture: Tensor) -> Tensor:
    """Returns Sobel derivatives along columns, then rows: [B, C, H, W] -> [B, 2 C, H, W].

    Weights 1, 2, 1 and -1, 0, 1 without a factor, borders mirrored, as Sobel edges in the paper's framework.
    """
    p = F.pad(picture, (1, 1, 1, 1), mode="reflect")
    across = p[..., 2:] - p[..., :-2]
    down = p[..., 2:, :] - p[..., :-2, :]
    d_col = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    d_row = down[..., :-2] + 2 * down[..., 1:-1] + down[..., 2:]
    return torch.cat([d_col, d_row], 1)


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
    shown: int = (
        0  # side of the pictures that an exported network without row block reduces to ``size``; 0: none (ours)
    )
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


_ROW_STEP = 8  # px between the pixels at which row maps are compared, since the row block's own grid is coarse


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
            rs, truth = self._seen_again(network, rs, truth, again)
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
    def _seen_again(self, network: nn.Module, rs: Tensor, truth: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Returns pictures, the first of them rectified by the network, and the motions still to be found."""
        network.eval()
        motion = cast(Kandula2020, network).one_look(rs[:count])
        network.train()
        rest = truth[:count] - motion
        return torch.cat([rectified_so_far(rs[:count], motion), rs[count:]]), torch.cat([rest, truth[count:]])

    def positions(self, network: nn.Module, samples: Samples) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields those of the whole system, then those of its motion with the exact inverse."""
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
    """Shows a network without row block smaller pictures than it is given, one at a time, and enlarges its answer.

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


def picture_losses(samples: Samples, motion: Tensor, row_map: Tensor | None, config: LossConfig) -> dict[str, Tensor]:
    """Returns the paper's losses by the name of their weight in LossConfig, except those of weight 0.

    Of trajectories [B, 2, r] and row maps [B, r, r] (None: exact inverse); each a mean over parts of the batch.
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
    losses = {}
    if config.rectified or config.rectified_edges:
        rectified, mask = rectify(samples.rs, samples.rs_valid, motion, row_map)
        losses["rectified"] = visible_mse(rectified, samples.gs, mask)
        losses["rectified_edges"] = edge_loss(rectified, samples.gs, mask)
    if config.regenerated or config.regenerated_edges:
        regenerated, mask = regenerate(samples.gs, motion)
        mask, regenerated = mask * samples.rs_valid, regenerated * samples.rs_valid
        losses["regenerated"] = visible_mse(regenerated, samples.rs, mask)
        losses["regenerated_edges"] = edge_loss(regenerated, samples.rs, mask)
    return {name: value for name, value in losses.items() if getattr(config, name)}


def row_map_error(row_map: Tensor, samples: Samples) -> Tensor:
    """Returns the mean distance [rows / 8] of row maps [B, r, r] from the true ones, on every eighth pixel."""
    col, row = (line.flatten()[_ROW_STEP // 2 :: _ROW_STEP] for line in pixel_grid(samples.size, samples.rs))
    _, true = geometry.gs_to_rs(col[None], row[:, None] + 0 * col, samples.motion, samples.center)
    sampled = row_map[:, _ROW_STEP // 2 :: _ROW_STEP, _ROW_STEP // 2 :: _ROW_STEP]
    return (sampled - true).abs().mean() / _ROW_STEP


def _off(measure: Callable[..., Tensor], motion: Tensor, truth: Tensor) -> Tensor:
    return measure(motion[:, 0], motion[:, 1], truth[:, 0], truth[:, 1])


def _idle(network: nn.Module) -> Tensor:
    """Returns a zero that depends on the row block, so that Adam counts these steps for its weights, too."""
    weights = [w.sum() for name, w in network.named_parameters() if "row_block." in name]
    return 0.0 * torch.stack(weights).sum() if weights else torch.zeros(())
