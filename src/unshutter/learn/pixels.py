"""Training data for networks that read pixels: photos kept on the device, distorted there in batches.

A square window of a photo is the predecessor's canvas (356 px); a motion drawn as in Rengarajan 2017 distorts
it about the centre of its middle 256 px, which are what the networks see. Pairs are made on the fly, so that
no two are alike. Needs torch, NumPy and OpenCV only; without a folder of photos it draws pictures.

Positions are (col, row) in px of the picture shown to the network, pixel centres at whole numbers; motions
have the signs of geometry.py, and the first row as their reference.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.geometry import rows as geometry
from unshutter.learn.scenes import SceneConfig, draw_motions

_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp"}
_WIDEST = 2.0  # photos are cut to this aspect, which bounds the memory they take
_EVERY_MOTION = SceneConfig(zero_motion=0.0, small_motion=0.0)  # the predecessor's draws as they are
_VALIDATION_SEED, _VALIDATION_BATCH = 2**40, 32


@dataclass(frozen=True)
class PixelConfig:
    """Which pictures, and how they are cut."""

    folder: str = ""  # photos, its subfolders included; empty: drawn pictures
    validation_folder: str = ""  # photos that training never sees; empty: some of the first folder's
    held_out: int = 40  # photos kept from training when there is no validation folder
    photos: int = 0  # photos to train on, chosen by ``seed``; 0: all
    validation_motions: int = 2  # per held-out photo
    drawn: int = 120  # pictures to draw when there is no folder
    size: int = 256  # of the picture that the network sees [px]
    canvas: int = 356  # of the window that is distorted [px]
    random_window: bool = True  # training windows lie anywhere along the photo's longer side, else in its middle
    flip: bool = True  # half the training windows are mirrored left to right
    seed: int = 0


@dataclass(frozen=True)
class Samples:
    """Pairs of pictures with the motion between them.

    Attributes:
        rs, gs: [B, 3, r, r] RGB in 0 ... 1; ``rs`` is black where the canvas ended.
        rs_valid: [B, 1, r, r] 1 where ``rs`` shows the canvas, else 0.
        tx_coefficients, rz_coefficients: [B, 4] of u^0 ... u^3 with u = row / r; px and rad.
    """

    rs: Tensor
    gs: Tensor
    rs_valid: Tensor
    tx_coefficients: Tensor
    rz_coefficients: Tensor

    def __getitem__(self, some: slice) -> Samples:
        """A part of the batch."""
        return Samples(*(getattr(self, f.name)[some] for f in fields(self)))

    @property
    def size(self) -> int:
        """Rows and columns r."""
        return self.rs.shape[-1]

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the rotation centre [px]."""
        return (self.size - 1) / 2, (self.size - 1) / 2

    @property
    def motion(self) -> geometry.MotionAtRow:
        """The true motion, for rows that broadcast against [B, 1, 1]."""
        return polynomial_motion(self.tx_coefficients, self.rz_coefficients, self.size)

    def row_motion(self) -> tuple[Tensor, Tensor]:
        """True t_x [px] and r_z [rad] of every row, each [B, r]."""
        tx, rz, _ = self.motion(pixel_grid(self.size, self.rs)[1])
        return tx[..., 0], rz[..., 0]


class PixelData:
    """Photos resident on a device, and the samples made of them."""

    def __init__(self, config: PixelConfig, device: torch.device):
        if config.canvas < config.size or (config.canvas - config.size) % 2:
            raise UsageError(f"[data]: canvas {config.canvas} must be size {config.size} plus an even margin")
        self.config, self.device = config, device
        pictures = _pictures(config.folder, config)
        order = np.random.default_rng(config.seed).permutation(len(pictures)).tolist()
        if config.validation_folder:
            held_out = _pictures(config.validation_folder, config)
        else:
            held_out = [pictures[i] for i in order[: config.held_out]]
            order = order[config.held_out :]
        if not order or not held_out:
            raise UsageError(f"[data]: {len(pictures)} pictures are too few to train on some and hold out others")
        kept = order[: config.photos or None]
        self.photos = [torch.from_numpy(pictures[i]).to(device) for i in kept]
        self.held_out = [torch.from_numpy(p).to(device) for p in held_out]

    def batch(self, count: int, generator: torch.Generator, first_photos: int | None = None) -> Samples:
        """Training samples drawn with ``generator``, from all photos or the first so many."""
        photos = self.photos[:first_photos]
        dice = torch.rand(3, count, generator=generator, device=self.device)
        index, place, side = dice.tolist()
        windows = [
            _window(photos[int(i * len(photos))], self.config.canvas, p if self.config.random_window else 0.5)
            for i, p in zip(index, place, strict=True)
        ]
        mirrored = [self.config.flip and s < 0.5 for s in side]
        canvas = torch.stack([w.flip(-1) if m else w for w, m in zip(windows, mirrored, strict=True)])
        return synthesise(canvas, *draw_motions(count, _EVERY_MOTION, generator), self.config.size)

    def validation(self) -> Iterator[Samples]:
        """Samples of held-out photos, middle window, the same at each call."""
        generator = torch.Generator(self.device).manual_seed(_VALIDATION_SEED)
        repeated = [p for p in self.held_out for _ in range(self.config.validation_motions)]
        windows = [_window(p, self.config.canvas, 0.5) for p in repeated]
        for first in range(0, len(windows), _VALIDATION_BATCH):
            canvas = torch.stack(windows[first : first + _VALIDATION_BATCH])
            yield synthesise(canvas, *draw_motions(len(canvas), _EVERY_MOTION, generator), self.config.size)


# ---- synthesis --------------------------------------------------------------------------------------------


def synthesise(canvas: Tensor, tx: Tensor, rz: Tensor, size: int) -> Samples:
    """Distorts canvases and cuts out their middle.

    Args:
        canvas: [B, 3, C, C] uint8 RGB.
        tx: [B, 3] coefficients of u, u^2, u^3 with u = row / size of the middle part, in units of ``size``
            px (as scenes.draw_motions gives them).
        rz: likewise, in rad.
        size: of the middle part [px].
    """
    constant = torch.zeros_like(tx[:, :1])
    tx, rz = torch.cat([constant, tx * size], -1), torch.cat([constant, rz], -1)
    margin = (canvas.shape[-1] - size) // 2
    whole = canvas.float() / 255
    gs = whole[..., margin : margin + size, margin : margin + size]
    col, row = pixel_grid(size, whole)
    t, r, _ = polynomial_motion(tx, rz, size)(row)
    gs_col, gs_row = geometry.rs_to_gs(col, row, t, r, ((size - 1) / 2, (size - 1) / 2))
    rs, valid = sample(whole, gs_col + margin, gs_row + margin)
    return Samples(rs, gs.contiguous(), valid, tx, rz)


def sample(pictures: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Pictures at positions, bilinear; differentiable in both.

    Args:
        pictures: [B, C, H, W].
        col: [B, h, w] positions [px].
        row: likewise.

    Returns:
        [B, C, h, w] values, exactly 0 at positions outside the picture; [B, 1, h, w] 1 inside, 0 outside.
    """
    height, width = pictures.shape[-2:]
    inside = ((col >= 0) & (col <= width - 1) & (row >= 0) & (row <= height - 1))[:, None].to(pictures.dtype)
    grid = torch.stack([col * (2 / (width - 1)) - 1, row * (2 / (height - 1)) - 1], -1)
    values = F.grid_sample(pictures, grid, mode="bilinear", padding_mode="border", align_corners=True)
    return values * inside, inside


def pixel_grid(size: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """(col [1, size], row [size, 1]) of every pixel."""
    line = torch.arange(size, dtype=like.dtype, device=like.device)
    return line[None], line[:, None]


def polynomial_motion(tx: Tensor, rz: Tensor, size: int) -> geometry.MotionAtRow:
    """Row motion of a batch: coefficients [B, K] in u = row / size, for rows that broadcast to [B, h, w]."""
    return geometry.row_motion_from_polynomial(tx[:, None, None], rz[:, None, None], first=0.0, last=float(size))


# ---- figures ----------------------------------------------------------------------------------------------


def epe(col: Tensor, row: Tensor, samples: Samples) -> Tensor:
    """[B] mean distance [px] of estimated RS positions [B, r, r] to the true ones.

    Taken over the GS pixels whose true RS position lies inside the RS picture.
    """
    x, y = pixel_grid(samples.size, samples.rs)
    true_col, true_row = geometry.gs_to_rs(x, y + 0 * x, samples.motion, samples.center)
    last = samples.size - 1
    seen = (true_col >= 0) & (true_col <= last) & (true_row >= 0) & (true_row <= last)
    distance = torch.hypot(col - true_col, row - true_row)
    return (distance * seen).sum((1, 2)) / seen.sum((1, 2)).clamp(min=1)


def epe_of_nothing(samples: Samples) -> Tensor:
    """[B] EPE [px] of leaving the pictures as they are."""
    col, row = pixel_grid(samples.size, samples.rs)
    return epe(col, row, samples)


def figures(error: Tensor, nothing: Tensor) -> dict[str, float]:
    """Median EPE [px], that of doing nothing, and the share of pictures that got better."""
    return {
        "val_epe_median": error.median().item(),
        "val_epe_nothing": nothing.median().item(),
        "val_improved": (error < nothing).float().mean().item(),
    }


# ---- pictures ---------------------------------------------------------------------------------------------


def _pictures(folder: str, config: PixelConfig) -> list[np.ndarray]:
    """[3, h, w] uint8 RGB each, short side = canvas."""
    if not folder:
        return [draw_picture(config.canvas, config.seed + i) for i in range(config.drawn)]
    return load_photos(Path(folder), config.canvas)


def load_photos(folder: Path, short_side: int) -> list[np.ndarray]:
    """Every photo of a folder and its subfolders, by name, upright, scaled to the short side.

    Returns:
        [3, h, w] uint8 RGB each, cut to an aspect of at most 2:1.

    Raises:
        UsageError: the folder has no photo that can be read.
    """
    import cv2

    names = sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES and not p.name.startswith("."))
    photos = []
    for name in names:
        data = np.fromfile(name, dtype=np.uint8)
        photo = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        if photo is None:
            continue
        scale = short_side / min(photo.shape[:2])
        size = (max(round(photo.shape[1] * scale), short_side), max(round(photo.shape[0] * scale), short_side))
        photo = cv2.resize(photo, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        cut = [max(int(side - _WIDEST * short_side), 0) // 2 for side in photo.shape[:2]]
        photo = photo[cut[0] : photo.shape[0] - cut[0], cut[1] : photo.shape[1] - cut[1], ::-1]
        photos.append(np.ascontiguousarray(photo.transpose(2, 0, 1)))
    if not photos:
        raise UsageError(f'no readable photo in {folder}: say --photos FOLDER, or folder = "" in [data] to draw some')
    if len(photos) < len(names):
        bad = len(names) - len(photos)
        warnings.warn(f"{bad} of {len(names)} files in {folder} are no readable photos", stacklevel=2)
    return photos


def draw_picture(size: int, seed: int) -> np.ndarray:
    """A made-up street: sky, facades with windows, wires, grain. [3, size, size] uint8 RGB."""
    import cv2

    dice = np.random.default_rng(seed)
    ramp = np.linspace(0, 1, size)[:, None, None]
    sky = dice.uniform(90, 250, 3) * (1 - ramp) + dice.uniform(60, 200, 3) * ramp
    picture = np.repeat(sky, size, axis=1)

    def shape(corners: np.ndarray, colour: np.ndarray) -> None:
        points = np.round(corners * 16).astype(np.int32)  # drawn with 4 binary places
        cv2.fillPoly(picture, [points], tuple(colour.tolist()), lineType=cv2.LINE_AA, shift=4)

    left = -dice.uniform(0, 0.2) * size
    while left < size:
        right = left + dice.uniform(0.15, 0.5) * size
        top, bottom = dice.uniform(0.05, 0.45, 2) * size, dice.uniform(0.8, 1.1, 2) * size  # left and right edge

        def on_facade(across, up, edges=(left, right, top, bottom)):
            a, b, high, low = edges
            upper = high[0] + (high[1] - high[0]) * across
            lower = low[0] + (low[1] - low[0]) * across
            return np.stack([a + (b - a) * across, upper + (lower - upper) * up], -1)

        wall = dice.uniform(40, 230, 3)
        shape(on_facade(np.array([0.0, 1, 1, 0]), np.array([0.0, 0, 1, 1])), wall)
        columns, floors = dice.integers(2, 7), dice.integers(2, 8)
        pane, gap = wall * dice.uniform(0.3, 1.3, 3), dice.uniform(0.15, 0.35)
        for i in range(columns * floors):
            u = (i % columns + np.array([gap, 1 - gap, 1 - gap, gap])) / columns
            v = (i // columns + np.array([gap, gap, 1 - gap, 1 - gap])) / floors
            shape(on_facade(u, v), np.clip(pane, 0, 255))
        left = right
    for _ in range(dice.integers(0, 4)):
        ends = np.round(dice.uniform(0, size * 16, (2, 2))).astype(int)
        cv2.line(picture, ends[0].tolist(), ends[1].tolist(), (30.0, 30.0, 30.0), 1, cv2.LINE_AA, 4)
    picture += 6 * dice.standard_normal(picture.shape)
    return np.ascontiguousarray(np.clip(picture, 0, 255).astype(np.uint8).transpose(2, 0, 1))


def _window(photo: Tensor, side: int, place: float) -> Tensor:
    """The square window at a share of the way along the longer side."""
    top, left = (int(place * (length - side) + 0.5) for length in photo.shape[1:])
    return photo[:, top : top + side, left : left + side]
