"""Draws the figures of docs/research/method.md: ``python docs/figures/draw_method.py`` (extras ``plot`` and ``train``).

Every picture and curve is a tensor. A photo of examples/ is distorted as training pictures are, so that the true motion
is known. It goes through kandula2020-research, whose inner tensors are read from the ONNX graph, and through the
code that the network was trained with (learn/kandula2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
import onnx
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Rectangle
from torch import Tensor

from unshutter.motion.geometry import rs_to_gs
from unshutter.photo import Photo
from unshutter_lab.methods.networks import SIZE
from unshutter_lab.methods.onnx import onnx_runtime
from unshutter_lab.training.kandula2020 import rectify, regenerate
from unshutter_lab.training.kandula2020_losses import edge_loss, sobel, visible_mse
from unshutter_lab.training.motions import draw_motions
from unshutter_lab.training.pixels import pixel_grid, rs_positions, synthesise

HERE = Path(__file__).parent
PHOTO = HERE.parent.parent / "examples" / "original" / "basilica.webp"
CANVAS, SEED = 356, 0  # px of the window that is distorted; of the motion that distorts it
WEIGHTS = HERE.parent.parent / "lab" / "src" / "unshutter_lab" / "weights" / "kandula2020-research.onnx"
BASE, RAW, COARSE = (  # tensors inside the graph, by the names that the export gave them
    "/network/motion_block/base/base.5/MaxPool_output_0",
    "/network/motion_block/Concat_output_0",
    "/network/row_block/Cast_output_0",
)
UNITS = torch.tensor([[1.0], [180 / np.pi]])  # px and degrees
BLUE, RED, GREEN = "#1565c0", "#c62828", "#2e7d32"


@dataclass(frozen=True)
class Tensors:
    """What one photo is on its way through the system; all [1, ...], pictures in 0 ... 1."""

    canvas: Tensor  # [1, 3, 356, 356] the photo as it is
    rs: Tensor  # [1, 3, r, r]
    rs_valid: Tensor  # [1, 1, r, r]
    gs: Tensor  # [1, 3, r, r]
    base: Tensor  # [1, 2 w, r / 8, r / 8] features
    raw: Tensor  # [1, 2, r] motion block
    motion: Tensor  # [1, 2, r] trajectory module
    coarse: Tensor  # [1, 1, r / 32, r / 32] output of the row block's last convolution
    row_map: Tensor  # [1, r, r]
    true_motion: Tensor  # [1, 2, r]


def pass_through() -> Tensors:
    """A training sample made of the photo, and all that the shipped network makes of it."""
    photo = Photo.open(PHOTO).to_array()
    side = min(photo.shape[:2])
    left = (photo.shape[1] - side) // 2
    window = cv2.resize(photo[:, left : left + side], (CANVAS, CANVAS), interpolation=cv2.INTER_AREA)
    canvas = torch.from_numpy(window).permute(2, 0, 1)[None]
    samples = synthesise(canvas, *draw_motions(1, torch.Generator().manual_seed(SEED)), SIZE)
    graph = onnx.load(WEIGHTS)
    graph.graph.output.extend(onnx.ValueInfoProto(name=name) for name in (BASE, RAW, COARSE))
    session = onnx_runtime().InferenceSession(graph.SerializeToString(), providers=["CPUExecutionProvider"])
    answers = session.run([BASE, RAW, "motion", COARSE, "row_map"], {"rs": samples.rs.numpy()})
    found = (torch.from_numpy(answer).float() for answer in answers)
    return Tensors(canvas / 255, samples.rs, samples.rs_valid, samples.gs, *found, torch.stack(samples.row_motion(), 1))


def system(t: Tensors) -> None:
    """All blocks with the tensors that go from one to the next."""
    figure = plt.figure(figsize=(11, 5))
    rectified, _ = rectify(t.rs, t.rs_valid, t.motion, t.row_map)
    regenerated, _ = regenerate(t.gs, t.motion)

    def place(left: float, bottom: float, title: str, size: float = 0.26) -> Axes:
        axis = figure.add_axes((left, bottom, size * 5 / 11, size))
        axis.set_title(title, fontsize=9)
        return axis

    show(place(0.01, 0.37, "RS picture $I_{rs}$"), t.rs)
    show(place(0.21, 0.66, "motion block: features"), feature_sheet(t.base, 4, 4))
    show(place(0.21, 0.08, "row block: row map"), t.row_map[0], cmap="viridis")
    axis = place(0.43, 0.66, "motion of every row")
    curves(axis, t.raw[0], color=BLUE, lw=0.6)
    axis = place(0.62, 0.66, "trajectory: cubics")
    curves(axis, t.motion[0], color=RED, lw=1.5)
    show(place(0.62, 0.08, "rectified $I_{rs\\_rec}$"), rectified)
    show(place(0.86, 0.66, "regenerated $I_{rs\\_reg}$"), regenerated)
    show(place(0.86, 0.08, "GS picture $I_{gs}$"), t.gs)
    arrows = [
        ((0.14, 0.55), (0.205, 0.74), ""), ((0.14, 0.45), (0.205, 0.26), ""),
        ((0.335, 0.79), (0.42, 0.79), "t$_x$, r$_z$\nblocks"), ((0.555, 0.79), (0.61, 0.79), ""),
        ((0.335, 0.21), (0.61, 0.21), "rectification: looks up the motion\nat the row map, warps $I_{rs}$"),
        ((0.745, 0.79), (0.85, 0.79), "regeneration:\nwarps $I_{gs}$\n(training only)"),
        ((0.68, 0.63), (0.68, 0.42), ""),
        ((0.92, 0.42), (0.92, 0.63), ""),
    ]  # fmt: skip
    for start, end, label in arrows:
        figure.add_artist(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=12, color="#555555"))
        figure.text((start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + 0.02, label, fontsize=8, ha="center")
    figure.add_artist(FancyArrowPatch((0.745, 0.21), (0.855, 0.21), arrowstyle="<->", mutation_scale=12, color=GREEN))
    figure.text(0.8, 0.12, "compared:\nloss of\nrectification", fontsize=8, ha="center", color=GREEN, va="center")
    for end in ((0.07, 0.69), (0.923, 0.955)):
        figure.add_artist(FancyArrowPatch((end[0], 0.98), end, arrowstyle="-|>", mutation_scale=12, color=GREEN))
    figure.add_artist(Line2D([0.07, 0.923], [0.98, 0.98], color=GREEN, lw=1))
    figure.text(0.085, 0.9, "compared:\nloss of\nregeneration", fontsize=8, color=GREEN, va="center")
    save(figure, "system")


def motion_block(t: Tensors) -> None:
    """The picture, features of the base block, and what the two branches say of every row."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.1), width_ratios=[1, 2.06, 0.7, 0.7])
    show(axes[0], t.rs, f"in: 3 × {SIZE} × {SIZE}")
    show(axes[1], feature_sheet(t.base, 4, 8), f"base block: {' × '.join(map(str, t.base.shape[1:]))}")
    names = ("t$_x$ block: 256 [px]", "r$_z$ block: 256 [°]")
    for axis, values, name in zip(axes[2:], t.raw[0] * UNITS, names, strict=True):
        axis.plot(values, np.arange(SIZE), color=BLUE, lw=0.8)
        axis.set(ylim=(SIZE - 1, 0))
        axis.set_title(name, fontsize=9)
    figure.tight_layout()
    save(figure, "motion")


def trajectory(t: Tensors) -> None:
    """The motion block's answer, its cubic, and the truth."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2))
    for i, (axis, name) in enumerate(zip(axes, ("t$_x$ [px]", "r$_z$ [°]"), strict=True)):
        rows, unit = np.arange(SIZE), UNITS[i, 0]
        axis.plot(rows, t.raw[0, i] * unit, ".", color=BLUE, ms=2.5, alpha=0.6, label="motion block")
        axis.plot(rows, t.motion[0, i] * unit, color=RED, lw=2, label="trajectory module (cubic)")
        axis.plot(rows, t.true_motion[0, i] * unit, "--", color="black", lw=1, label="truth")
        spread = ((t.raw - t.motion)[0, i] * unit).square().mean().sqrt()
        axis.set(xlabel="row", ylabel=name, xlim=(0, SIZE - 1))
        axis.set_title(f"the fit removes {spread:.2f} {'px' if i == 0 else '°'} (RMS)", fontsize=9)
        axis.legend(fontsize=8)
    figure.tight_layout()
    save(figure, "trajectory")


def row_map(t: Tensors) -> None:
    """A, the residual, their sum; and the residual that the true motion has."""
    col, row = pixel_grid(SIZE, t.rs)
    residual = t.row_map[0] - row
    _, seen_by = rs_positions(t.true_motion, None)
    true = seen_by[0] - row
    figure, axes = plt.subplots(1, 5, figsize=(13, 3))
    panels: list[tuple[Tensor, str, dict]] = [
        (t.coarse[0, 0] * 8, f"last convolution: {t.coarse.shape[-2]} × {t.coarse.shape[-1]}", signed(t.coarse * 8)),
        (residual, "residual, enlarged [rows]", signed(residual)),
        (row + 0 * col, "A(i, j) = i", {"cmap": "viridis"}),
        (t.row_map[0], "row map = A + residual", {"cmap": "viridis"}),
        (true, "residual of the true motion", signed(true)),
    ]
    for axis, (values, title, how) in zip(axes, panels, strict=True):
        drawn = show(axis, values, title, **how)
        figure.colorbar(drawn, ax=axis, fraction=0.046, pad=0.03).ax.tick_params(labelsize=7)
    figure.tight_layout()
    save(figure, "row_map")


def signed(values: Tensor) -> dict[str, object]:
    """Colours of a map with zero in the middle, red below it."""
    limit = float(values.abs().max())
    return {"cmap": "RdBu", "vmin": -limit, "vmax": limit}


def sampling(t: Tensors) -> None:
    """Where the rectified picture takes its pixels from, the picture, its mask, and the truth."""
    rectified, mask = rectify(t.rs, t.rs_valid, t.motion, t.row_map)
    col, row = rs_positions(t.motion, t.row_map)
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.1))
    show(axes[0], t.rs, "where it looks in $I_{rs}$")
    grid(axes[0], col[0], row[0])
    show(axes[1], rectified, "rectified $I_{rs\\_rec}$")
    show(axes[2], mask[0, 0], "mask $M_{rs\\_rec}$", cmap="gray", vmin=0, vmax=1)
    show(axes[3], t.gs, "truth $I_{gs}$")
    figure.tight_layout()
    save(figure, "sampling")


def regeneration(t: Tensors) -> None:
    """The global-shutter picture distorted by the estimated motion, beside the photo."""
    regenerated, mask = regenerate(t.gs, t.motion)
    x, y = pixel_grid(SIZE, t.gs)
    tx, rz = (values[0][:, None] for values in t.motion.unbind(1))
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.1))
    show(axes[0], t.gs, "where it looks in $I_{gs}$")
    grid(axes[0], *rs_to_gs(x, y, tx, rz, ((SIZE - 1) / 2, (SIZE - 1) / 2)))
    show(axes[1], regenerated, "regenerated $I_{rs\\_reg}$")
    show(axes[2], mask[0, 0], "mask $M_{rs\\_reg}$", cmap="gray", vmin=0, vmax=1)
    show(axes[3], t.rs, "photo $I_{rs}$")
    figure.tight_layout()
    save(figure, "regeneration")


def losses(t: Tensors) -> None:
    """Each loss on this photo: where it comes from, and how large it is."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.2))
    rectified = (*rectify(t.rs, t.rs_valid, t.motion, t.row_map), t.gs, "rec")
    regenerated = (*regenerate(t.gs, t.motion), t.rs, "reg")
    for i, (picture, mask, target, name) in enumerate((rectified, regenerated)):
        inner = 1 - torch.nn.functional.max_pool2d(1 - mask, 3, stride=1, padding=1)
        pixels = (picture - mask * target).square().mean(1)
        edges = (sobel(picture - target) * inner).square().mean(1)
        mse, edge = visible_mse(picture, target, mask), edge_loss(picture, target, mask)
        show(axes[2 * i], pixels.sqrt(), f"$L_{{rs\\_{name}\\_MSE}}$ = {mse:.4f}", cmap="magma", vmax=0.5)
        show(axes[2 * i + 1], edges.sqrt(), f"$L_{{rs\\_{name}\\_edge}}$ = {edge:.3f}", cmap="magma", vmax=2)
    figure.tight_layout()
    save(figure, "losses")


def training_pair(t: Tensors) -> None:
    """How a sample is made: a window of 356 px, a random motion, the middle 256 px."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.1))
    show(axes[0], t.canvas, f"photo, {CANVAS} × {CANVAS}")
    margin = (CANVAS - SIZE) // 2
    axes[0].add_patch(Rectangle((margin, margin), SIZE, SIZE, fill=False, ec=RED, lw=1.5))
    curves(axes[1], t.true_motion[0], lw=1.5)
    axes[1].set_title("a drawn motion", fontsize=9)
    axes[1].legend(["t$_x$ [px]", "r$_z$ [°]"], fontsize=8)
    show(axes[2], t.rs, "$I_{rs}$, 256 × 256")
    show(axes[3], t.gs, "$I_{gs}$, 256 × 256")
    figure.tight_layout()
    save(figure, "pair")


def feature_sheet(base: Tensor, down: int, across: int) -> Tensor:
    """The first feature maps [1, C, h, w] side by side, each as bright as its brightest place."""
    features = base[0, : down * across]
    features = features / features.amax((1, 2), keepdim=True).clamp(min=1e-6)
    framed = torch.nn.functional.pad(features, (1, 1, 1, 1), value=1.0)
    return torch.cat([torch.cat(list(row), -1) for row in framed.reshape(down, across, *framed.shape[-2:])], -2)


def show(axis: Axes, picture: Tensor, title: str = "", **how: object):
    """A picture [1, 3, h, w] or a map [h, w] without ticks."""
    values = picture[0].permute(1, 2, 0).clamp(0, 1) if picture.ndim == 4 else picture.squeeze()
    drawn = axis.imshow(values.numpy(), **({"cmap": "gray"} | how))
    axis.set(xticks=[], yticks=[])
    if title:
        axis.set_title(title, fontsize=9)
    return drawn


def curves(axis: Axes, motion: Tensor, **how: object) -> None:
    """t_x [px] and r_z [°] over rows, which run down."""
    for values, style in zip(motion * UNITS, ("-", "--"), strict=True):
        axis.plot(values, np.arange(SIZE), style, **how)
    axis.set(ylim=(SIZE - 1, 0), yticks=[])
    axis.tick_params(labelsize=7)


def grid(axis: Axes, col: Tensor, row: Tensor, step: int = 32) -> None:
    """Every 32nd row and column of the positions [r, r]."""
    for i in [*range(0, SIZE, step), SIZE - 1]:
        axis.plot(col[i], row[i], color="yellow", lw=0.7)
        axis.plot(col[:, i], row[:, i], color="yellow", lw=0.7)
    axis.set(xlim=(0, SIZE - 1), ylim=(SIZE - 1, 0))


def save(figure: Figure, name: str) -> None:
    """Writes method_NAME.jpg beside this script."""
    figure.savefig(HERE / f"method_{name}.jpg", dpi=110, pil_kwargs={"quality": 85})
    plt.close(figure)


if __name__ == "__main__":
    plt.switch_backend("agg")
    tensors = pass_through()
    for draw in (system, motion_block, trajectory, row_map, sampling, regeneration, losses, training_pair):
        draw(tensors)
