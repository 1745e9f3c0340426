"""Training data for pixel-based networks: photos held on the device and distorted there in batches.

A square window of a photo is the predecessor's canvas (356 px). A random motion (motions.py) distorts it about the
centre of its central 256 px, which the networks see. Every batch is newly drawn, so that no two samples are alike.
Needs only torch, NumPy and OpenCV.

Training windows may be seen by another camera (views.py), under other light (light.py), and moved as people move
cameras (motions.py); pictures held out for validation are not varied.

Positions are as in warping.py, in px of the picture shown to the network; motions have the first row as reference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from unshutter.errors import UsageError
from unshutter.geometry import rows as geometry
from unshutter_lab.training.config import from_table
from unshutter_lab.training.data.facades import draw_facades
from unshutter_lab.training.data.light import Light, LightConfig
from unshutter_lab.training.data.motions import MotionConfig, draw_kind, draw_mixture
from unshutter_lab.training.data.pictures import draw_picture, load_photos
from unshutter_lab.training.data.views import ViewConfig, draw_views, move
from unshutter_lab.training.warping import pixel_grid, polynomial_motion, sample

_VALIDATION_SEED, _VALIDATION_BATCH = 2**40, 32
_DRAWN_SEED = 2**20  # of pictures drawn in addition to photos
_DRAWINGS = {"streets": draw_picture, "facades": draw_facades}


@dataclass(frozen=True)
class PixelConfig:
    """The source of pictures, and how they are cropped."""

    folder: str = ""  # photos, its subfolders included; empty: drawn pictures
    validation_folder: str = ""  # photos not used for training; empty: some of the first folder's
    held_out: int = 40  # photos excluded from training if there is no validation folder
    photos: int = 0  # photos to train on, chosen by ``seed``; 0: all
    validation_motions: int = 2  # per held-out photo
    drawn: int = 120  # pictures to draw if there is no folder, or if some training pictures are drawn
    drawn_share: float = 0.0  # share of drawn pictures among the training pictures
    drawn_kind: str = "streets"  # streets (pictures.py) | facades (textured, in perspective: facades.py)
    size: int = 256  # side of the picture that the network sees [px]
    canvas: int = 356  # side of the window that is distorted [px]
    random_window: bool = True  # training windows lie anywhere along the photo's longer side, otherwise in its centre
    flip: bool = True  # half the training windows are mirrored left to right
    seed: int = 0
    views: dict[str, Any] = field(default_factory=dict)  # other cameras: fields of ViewConfig
    light: dict[str, Any] = field(default_factory=dict)  # other light: fields of LightConfig
    motions: dict[str, Any] = field(default_factory=dict)  # kinds of motion: fields of MotionConfig


@dataclass(frozen=True)
class Samples:
    """Pairs of pictures with the motion between them.

    Attributes:
        rs, gs: [B, 3, r, r] RGB in 0 ... 1; ``rs`` is black beyond the canvas.
            ``gs`` may be omitted: [B, 0, r, r].
        rs_valid: [B, 1, r, r] 1 where ``rs`` shows the canvas, otherwise 0.
        tx_coefficients, rz_coefficients: [B, 4] of u^0 ... u^3 with u = row / r; px and rad.
    """

    rs: Tensor
    gs: Tensor
    rs_valid: Tensor
    tx_coefficients: Tensor
    rz_coefficients: Tensor

    def __getitem__(self, some: slice) -> Samples:
        """Returns a part of the batch."""
        return Samples(*(getattr(self, f.name)[some] for f in fields(self)))

    @property
    def size(self) -> int:
        """Number of rows and columns r."""
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
        """Returns the true t_x [px] and r_z [rad] of every row, each [B, r]."""
        tx, rz, _ = self.motion(pixel_grid(self.size, self.rs)[1])
        return tx[..., 0], rz[..., 0]


class PixelData:
    """Pictures held on a device, and the samples made from them.

    Raises:
        UsageError: there are too few pictures, or sizes contradict each other.
    """

    def __init__(self, config: PixelConfig, device: torch.device):
        if config.canvas < config.size or (config.canvas - config.size) % 2:
            raise UsageError(f"[data]: canvas {config.canvas} must be size {config.size} plus an even margin")
        self.config, self.device = config, device
        if config.drawn_kind not in _DRAWINGS:
            raise UsageError(f"[data]: unknown drawn_kind '{config.drawn_kind}': choose {' or '.join(_DRAWINGS)}")
        self.views = from_table(ViewConfig, config.views, "[data.views]")
        self.light = from_table(LightConfig, config.light, "[data.light]")
        self.motions = from_table(MotionConfig, config.motions, "[data.motions]")
        pictures, held_out = _training_and_held_out(config)
        self.photos = [torch.from_numpy(picture).to(device) for picture in pictures]
        self.held_out = [torch.from_numpy(picture).to(device) for picture in held_out]
        drawn = _drawn(config, _DRAWN_SEED) if config.drawn_share else []
        self.drawn = [torch.from_numpy(picture).to(device) for picture in drawn]

    def batch(
        self, count: int, generator: torch.Generator, first_photos: int | None = None, *, with_gs: bool = True
    ) -> Samples:
        """Returns training samples drawn with ``generator``, from all photos or only the first ones.

        Args:
            count: number of samples.
            generator: random number generator.
            first_photos: number of photos to use; None for all.
            with_gs: whether the undistorted pictures are needed.
        """
        canvas = self._windows(count, generator, first_photos)
        motions = draw_mixture(count, generator, self.motions)
        views = None
        if self.views.share:
            views = draw_views(self.views, generator, count, self.config.size, self.config.canvas)
        samples = synthesise(canvas, *motions, self.config.size, views, with_gs=with_gs)
        if not self.light.share:
            return samples
        light = Light(self.light, generator, count)
        gs = light.on_scene(samples.gs) if with_gs else samples.gs
        rs = light.through_camera(light.on_scene(samples.rs)) * samples.rs_valid
        return replace(samples, rs=rs, gs=gs)

    def validation(self, kind: str = "quadratic") -> Iterator[Samples]:
        """Yields samples of held-out photos, central window, the same at each call."""
        return self._unchanged(self.held_out, kind)

    def other_checks(self) -> dict[str, Iterator[Samples]]:
        """Returns further samples to measure, by the figure's name in the log; the same at each call.

        Other kinds of motion on the held-out photos; and as many training photos, once made like the held-out ones and
        once as used in training. The latter two reveal memorisation.
        """
        kinds = [kind for kind in self.motions.kinds() if kind != "quadratic"]
        checks = {f"val_epe_{kind}": self.validation(kind) for kind in kinds}
        return checks | {
            "train_epe": self._unchanged(self.photos[: len(self.held_out)], "quadratic"),
            "train_epe_as_seen": self._augmented(len(self.held_out) * self.config.validation_motions),
        }

    def _augmented(self, count: int) -> Iterator[Samples]:
        generator = torch.Generator(self.device).manual_seed(_VALIDATION_SEED)
        for first in range(0, count, _VALIDATION_BATCH):
            yield self.batch(min(_VALIDATION_BATCH, count - first), generator, with_gs=False)

    def _windows(self, count: int, generator: torch.Generator, first_photos: int | None) -> Tensor:
        """Returns random windows of the training pictures, [B, 3, canvas, canvas] uint8."""
        photos = self.photos[:first_photos]
        dice = torch.rand(3, count, generator=generator, device=self.device)
        index, place, side = dice.tolist()
        chosen = [photos[int(i * len(photos))] for i in index]
        if self.drawn:
            is_drawn, which = torch.rand(2, count, generator=generator, device=self.device).tolist()
            pairs = zip(chosen, is_drawn, which, strict=True)
            chosen = [self.drawn[int(w * len(self.drawn))] if d < self.config.drawn_share else c for c, d, w in pairs]
        windows = [
            _window(photo, self.config.canvas, p if self.config.random_window else 0.5)
            for photo, p in zip(chosen, place, strict=True)
        ]
        mirrored = [self.config.flip and s < 0.5 for s in side]
        return torch.stack([w.flip(-1) if m else w for w, m in zip(windows, mirrored, strict=True)])

    def _unchanged(self, photos: list[Tensor], kind: str) -> Iterator[Samples]:
        generator = torch.Generator(self.device).manual_seed(_VALIDATION_SEED)
        repeated = [p for p in photos for _ in range(self.config.validation_motions)]
        windows = [_window(p, self.config.canvas, 0.5) for p in repeated]
        for first in range(0, len(windows), _VALIDATION_BATCH):
            canvas = torch.stack(windows[first : first + _VALIDATION_BATCH])
            yield synthesise(canvas, *draw_kind(kind, len(canvas), generator), self.config.size)


def _training_and_held_out(config: PixelConfig) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Returns the pictures to train on, and those held out for validation."""
    apart = bool(config.validation_folder)
    if not apart and config.held_out < 1:
        raise UsageError("[data]: held_out must be at least 1 where there is no validation_folder")
    first = 0 if apart else config.held_out
    pictures = _pictures(config.folder, config, first + 1)
    order = np.random.default_rng(config.seed).permutation(len(pictures)).tolist()
    held_out = _pictures(config.validation_folder, config, 1) if apart else [pictures[i] for i in order[:first]]
    return [pictures[i] for i in order[first:][: config.photos or None]], held_out


def _pictures(folder: str, config: PixelConfig, least: int) -> list[np.ndarray]:
    """[3, h, w] uint8 RGB each, short side = canvas: the photos of a folder, or drawn ones if none is given."""
    if not folder:
        pictures = _drawn(config, config.seed)
        supply, hint = f"{len(pictures)} pictures are drawn", "choose a larger 'drawn'"
    else:
        pictures = load_photos(Path(folder), config.canvas)
        here = Path(folder).is_dir()
        supply = f"{folder} holds {len(pictures)} readable photo(s)" if here else f"there is no folder {folder}"
        hint = "choose another folder with --photos"
    if len(pictures) < least:
        split = f" ({least - 1} held out for validation, one to train on)" if least > 1 else ""
        raise UsageError(f"[data]: {supply}; training needs at least {least}{split}: {hint}")
    return pictures


def _drawn(config: PixelConfig, seed: int) -> list[np.ndarray]:
    draw = _DRAWINGS[config.drawn_kind]
    return [draw(config.canvas, seed + i) for i in range(config.drawn)]


def synthesise(
    canvas: Tensor, tx: Tensor, rz: Tensor, size: int, views: Tensor | None = None, *, with_gs: bool = True
) -> Samples:
    """Distorts canvases and crops their centre.

    Args:
        canvas: [B, 3, C, C] uint8 RGB.
        tx: [B, 3] coefficients of u, u^2, u^3 with u = row / size of the central part, in units of ``size`` px
            (as returned by :func:`draw_motions`).
        rz: [B, 3] coefficients of u, u^2, u^3 for r_z [rad].
        size: side of the central part [px].
        views: [B, 3, 3] homographies of other cameras (views.py); None for the canvas itself.
        with_gs: False omits the undistorted pictures.
    """
    constant = torch.zeros_like(tx[:, :1])
    tx, rz = torch.cat([constant, tx * size], -1), torch.cat([constant, rz], -1)
    margin, middle = (canvas.shape[-1] - size) // 2, (size - 1) / 2
    whole = canvas.float().div_(255)
    col, row = pixel_grid(size, whole)
    t, r, _ = polynomial_motion(tx, rz, size)(row)
    gs_col, gs_row = geometry.rs_to_gs(col, row, t, r, (middle, middle))
    gs = whole[:, :0, :size, :size]
    if views is None:
        rs, valid = sample(whole, gs_col + margin, gs_row + margin)
        if with_gs:
            gs = whole[..., margin : margin + size, margin : margin + size]
        return Samples(rs, gs.contiguous(), valid, tx, rz)

    def sample_view(col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
        at_col, at_row = move(views, col - middle, row - middle)
        return sample(whole, at_col + (middle + margin), at_row + (middle + margin))

    rs, valid = sample_view(gs_col, gs_row)
    if with_gs:
        gs, _ = sample_view(col, row)
    return Samples(rs, gs, valid, tx, rz)


def _window(photo: Tensor, side: int, place: float) -> Tensor:
    """Returns the square window at a fraction of the way along the longer side."""
    top, left = (int(place * (length - side) + 0.5) for length in photo.shape[1:])
    return photo[:, top : top + side, left : left + side]
