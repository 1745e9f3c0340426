"""Training data for networks that read pixels: photos held on the device, distorted there in batches, and their warps.

A square window of a photo is the predecessor's canvas (356 px). A random motion (motions.py) distorts it about the
centre of its central 256 px, which the networks see. Every batch is newly drawn, so that no two samples are alike.
Training windows may be seen by another camera, under other light (variation.py), and moved as people move cameras;
pictures held out for validation are not varied. Needs only torch, NumPy and OpenCV, which reads the photos.

Positions are (col, row) [px] of the picture shown to the network, r x r, pixel centres at integers. A motion is a
tensor [B, 2, r]: t_x [px] and r_z [rad] of every row, with the signs of motion/geometry.py. Warps are differentiable in
pictures, positions and motions.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter.motion import geometry
from unshutter_lab.methods.row_map import gs_to_rs_by_row_map
from unshutter_lab.training.config import from_table
from unshutter_lab.training.facades import draw_facades
from unshutter_lab.training.motions import MotionConfig, draw_kind, draw_mixture
from unshutter_lab.training.places import PlacesConfig, PlaceViews
from unshutter_lab.training.variation import Light, LightConfig, ViewConfig, draw_views, move


def pixel_grid(size: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Returns (col [1, size], row [size, 1]) of every pixel."""
    line = torch.arange(size, dtype=like.dtype, device=like.device)
    return line[None], line[:, None]


def sample(pictures: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Samples pictures [B, C, H, W] bilinearly at positions [B, h, w] [px].

    Returns:
        [B, C, h, w] values, exactly 0 at positions outside the picture; [B, 1, h, w] 1 inside, 0 outside.
    """
    height, width = pictures.shape[-2:]
    inside = ((col >= 0) & (col <= width - 1) & (row >= 0) & (row <= height - 1))[:, None].to(pictures.dtype)
    grid = torch.stack([col * (2 / (width - 1)) - 1, row * (2 / (height - 1)) - 1], -1)
    values = F.grid_sample(pictures, grid, mode="bilinear", padding_mode="border", align_corners=True)
    return values * inside, inside


def polynomial_motion(tx: Tensor, rz: Tensor, size: int) -> geometry.MotionAtRow:
    """Returns the row motion with coefficients [B, K] in u = row / size, for rows that broadcast to [B, h, w]."""
    return geometry.row_motion_from_polynomial(tx[:, None, None], rz[:, None, None], first=0.0, last=float(size))


def sampled_motion(motion: Tensor) -> geometry.MotionAtRow:
    """Returns the row motion of a batch by linear interpolation of its samples [B, 2, r], for rows [B, h, w]."""
    last = motion.shape[-1] - 1

    def row_motion(v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        inside = v.clamp(0, last)
        below = inside.detach().floor().clamp(max=last - 1)
        weight = (inside - below).flatten(1)[:, None]  # [B, 1, h w]
        # a motion that folds has no inverse everywhere: v may be NaN, and then so is the result
        index = below.nan_to_num().long().flatten(1)[:, None].expand(-1, 2, -1)
        low, high = motion.gather(2, index), motion.gather(2, index + 1)
        tx, rz = (low + (high - low) * weight).unflatten(2, v.shape[1:]).unbind(1)
        moving = (v >= 0) & (v <= last)
        return tx, rz, (high - low)[:, 1].view_as(v) * moving

    return row_motion


def rs_positions(motion: Tensor, row_map: Tensor | None, center_shift: Tensor | float = 0.0) -> tuple[Tensor, Tensor]:
    """Returns the RS position (col, row) [px] of every GS pixel, each [B, r, r].

    Args:
        motion: [B, 2, r] t_x [px] and r_z [rad] of every row.
        row_map: [B, r, r] row whose motion applies to each GS pixel; None for the row that read it (exact inverse).
        center_shift: shift of the rotation centre along the columns [px], 0 or [B, 1, 1].
    """
    size = motion.shape[-1]
    look_up, center = sampled_motion(motion), ((size - 1) / 2 + center_shift, (size - 1) / 2)
    col, row = (a.expand(motion.shape[0], size, size) for a in pixel_grid(size, motion))
    if row_map is None:
        return geometry.gs_to_rs(col, row, look_up, center)
    tx, rz, _ = look_up(row_map)
    return gs_to_rs_by_row_map(col, row, tx, rz, center)


def from_first_row(motion: Tensor) -> tuple[Tensor, Tensor]:
    """Returns a motion [B, 2, r] with the first row as its reference, and the shift [B, 1, 1] of its centre.

    A network's output is not constrained to zero in the first row; ``Motion.rereferenced`` explains the shift.
    """
    return motion - motion[..., :1], motion[:, 0, :1, None]


_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp"}
_WIDEST = 2.0  # photos are cropped to this aspect, which bounds their memory


def photo_files(folder: Path) -> list[Path]:
    """Returns the photos of a folder and its subfolders, by name."""
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES and not p.name.startswith("."))


def load_photos(folder: Path, short_side: int) -> list[np.ndarray]:
    """Reads all photos of a folder, upright, scaled to the short side, cropped to at most 2:1: uint8 RGB [3, h, w].

    Unreadable files are skipped with a warning.
    """
    files = photo_files(folder)
    photos = [photo for file in files if (photo := _load(file, short_side)) is not None]
    if bad := len(files) - len(photos):
        warnings.warn(f"{bad} of {len(files)} files in {folder} cannot be read as photos", stacklevel=2)
    return photos


def _load(file: Path, short_side: int) -> np.ndarray | None:
    try:
        data = np.fromfile(file, dtype=np.uint8)
    except OSError:
        return None
    photo = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if photo is None:
        return None
    scale = short_side / min(photo.shape[:2])
    size = (max(round(photo.shape[1] * scale), short_side), max(round(photo.shape[0] * scale), short_side))
    photo = cv2.resize(photo, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    cut = [max(int(side - _WIDEST * short_side), 0) // 2 for side in photo.shape[:2]]
    photo = photo[cut[0] : photo.shape[0] - cut[0], cut[1] : photo.shape[1] - cut[1], ::-1]
    return np.ascontiguousarray(photo.transpose(2, 0, 1))


def draw_picture(size: int, seed: int) -> np.ndarray:
    """Draws a street: sky, facades with windows, wires, grain. [3, size, size] uint8 RGB."""
    dice = np.random.default_rng(seed)
    ramp = np.linspace(0, 1, size)[:, None, None]
    sky = dice.uniform(90, 250, 3) * (1 - ramp) + dice.uniform(60, 200, 3) * ramp
    picture = np.repeat(sky, size, axis=1)

    def shape(corners: np.ndarray, colour: np.ndarray) -> None:
        points = np.round(corners * 16).astype(np.int32)  # drawn with 4 binary places
        cv2.fillPoly(picture, [points], tuple(colour.tolist()), lineType=cv2.LINE_AA, shift=4)

    def on_facade(across: np.ndarray, up: np.ndarray) -> np.ndarray:
        upper, lower = (edge[0] + (edge[1] - edge[0]) * across for edge in (top, bottom))
        return np.stack([left + (right - left) * across, upper + (lower - upper) * up], -1)

    left = -dice.uniform(0, 0.2) * size
    while left < size:
        right = left + dice.uniform(0.15, 0.5) * size
        top, bottom = dice.uniform(0.05, 0.45, 2) * size, dice.uniform(0.8, 1.1, 2) * size  # left and right edge
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


_VALIDATION_SEED, _VALIDATION_BATCH = 2**40, 32
_DRAWN_SEED = 2**20  # of pictures drawn in addition to photos


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
    drawn_kind: Literal["streets", "facades"] = "streets"  # facades: textured, in perspective (facades.py)
    size: int = 256  # side of the picture that the network sees [px]
    canvas: int = 356  # side of the window that is distorted [px]
    random_window: bool = True  # training windows lie anywhere along the photo's longer side, otherwise in its centre
    flip: bool = True  # half the training windows are mirrored left to right
    seed: int = 0
    views: dict[str, Any] = field(default_factory=dict)  # other cameras: fields of ViewConfig
    light: dict[str, Any] = field(default_factory=dict)  # other light: fields of LightConfig
    motions: dict[str, Any] = field(default_factory=dict)  # kinds of motion: fields of MotionConfig
    places: dict[str, Any] = field(default_factory=dict)  # views of places among the samples: fields of PlacesConfig


@dataclass(frozen=True)
class Samples:
    """Pairs of pictures with the motion between them."""

    rs: Tensor
    gs: Tensor
    # [B, 1, r, r] 1 where ``rs`` shows the canvas, otherwise 0. tx_coefficients, rz_coefficients: [B, 4] of u^0 ...
    # u^3 with u = row / r; px and rad.
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


def _together(parts: list[Samples]) -> Samples:
    return Samples(*(torch.cat([getattr(part, f.name) for part in parts]) for f in fields(Samples)))


class PixelData:
    """Pictures held on a device, and the samples made from them."""

    def __init__(self, config: PixelConfig, device: torch.device):
        if config.canvas < config.size or (config.canvas - config.size) % 2:
            raise UsageError(f"[data]: canvas {config.canvas} must be size {config.size} plus an even margin")
        self.config, self.device = config, device
        self.views = from_table(ViewConfig, config.views, "[data.views]")
        self.light = from_table(LightConfig, config.light, "[data.light]")
        self.motions = from_table(MotionConfig, config.motions, "[data.motions]")
        self.places = PlaceViews(from_table(PlacesConfig, config.places, "[data.places]")) if config.places else None
        pictures, held_out = _training_and_held_out(config)
        drawn = _drawn(config, _DRAWN_SEED) if config.drawn_share else []
        self.photos, self.held_out, self.drawn = (
            [self.held(picture) for picture in some] for some in (pictures, held_out, drawn)
        )

    def held(self, picture: np.ndarray) -> Tensor:
        """Returns a picture, uint8 [3, h, w], as this object holds them."""
        return torch.from_numpy(picture).to(self.device)

    def batch(
        self, count: int, generator: torch.Generator, first_photos: int | None = None, *, with_gs: bool = True
    ) -> Samples:
        """Returns new training samples, from all photos or only the first ones; the undistorted pictures if needed."""
        with torch.autocast(self.device.type, enabled=False):  # half precision is for the network alone
            return self._batch(count, generator, first_photos, with_gs=with_gs)

    def _batch(self, count: int, generator: torch.Generator, first_photos: int | None, *, with_gs: bool) -> Samples:
        of_places = sum(numbers := self.places.share_of(count, generator)) if self.places else 0
        parts = []
        if of_places < count:
            parts.append(self._of_photos(count - of_places, generator, first_photos, with_gs=with_gs))
        if self.places and of_places:
            drawn = [False] * numbers[0] + [True] * numbers[1]
            parts.append(self._of_places(self.places, drawn, generator, with_gs=with_gs))
        samples = parts[0] if len(parts) == 1 else _together(parts)
        if not self.light.share:
            return samples
        light = Light(self.light, generator, count)
        gs = light.on_scene(samples.gs) if with_gs else samples.gs
        rs = light.through_camera(light.on_scene(samples.rs)) * samples.rs_valid
        return replace(samples, rs=rs, gs=gs)

    def _of_photos(self, count: int, generator: torch.Generator, first_photos: int | None, *, with_gs: bool) -> Samples:
        canvas = self._windows(count, generator, first_photos)
        motions = draw_mixture(count, generator, self.motions)
        size = self.config.size
        views = draw_views(self.views, generator, count, size, self.config.canvas) if self.views.share else None
        return synthesise(canvas, *motions, size, views, with_gs=with_gs)

    def _of_places(
        self, places: PlaceViews, drawn: list[bool], generator: torch.Generator, *, with_gs: bool
    ) -> Samples:
        rs, gs, tx, rz = places.pictures(drawn, self.config.size, generator, self.motions, with_gs=with_gs)
        return Samples(rs, gs if with_gs else rs[:, :0], torch.ones_like(rs[:, :1]), tx, rz)

    def validation(self, kind: str = "quadratic") -> Iterator[Samples]:
        """Yields samples of held-out photos, central window, the same at each call."""
        return self._unchanged(self.held_out, kind)

    def other_checks(self) -> dict[str, Iterator[Samples]]:
        """Returns further samples to measure, by the figure's name in the log; the same at each call.

        Other motions on the held-out photos; and as many training photos, made like those and as used in training.
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
        windows = []
        for photo, p, s in zip(chosen, place, side, strict=True):
            window = _window(photo, self.config.canvas, p if self.config.random_window else 0.5)
            windows.append(window.flip(-1) if self.config.flip and s < 0.5 else window)
        return torch.stack(windows)

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
    draw = draw_facades if config.drawn_kind == "facades" else draw_picture
    return [draw(config.canvas, seed + i) for i in range(config.drawn)]


def synthesise(
    canvas: Tensor, tx: Tensor, rz: Tensor, size: int, views: Tensor | None = None, *, with_gs: bool = True
) -> Samples:
    """Distorts canvases [B, 3, C, C] (uint8 RGB) and crops their centre of ``size`` px.

    Args:
        canvas: the windows.
        tx, rz: [B, 3] coefficients of u, u^2, u^3 with u = row / size of the central part: t_x in units of ``size`` px,
            r_z in radians (as returned by :func:`draw_motions`).
        size: side of the central part.
        views: [B, 3, 3] homographies of other cameras (variation.py); None for the canvas itself.
        with_gs: False omits the undistorted pictures.
    """
    constant = torch.zeros_like(tx[:, :1])
    tx, rz = torch.cat([constant, tx * size], -1), torch.cat([constant, rz], -1)
    margin, middle = (canvas.shape[-1] - size) // 2, (size - 1) / 2
    whole = canvas.float().div_(255)
    col, row = pixel_grid(size, whole)
    t, r, _ = polynomial_motion(tx, rz, size)(row)
    gs_col, gs_row = geometry.rs_to_gs(col, row, t, r, (middle, middle))

    def seen(col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
        if views is None:
            return sample(whole, col + margin, row + margin)
        at_col, at_row = move(views, col - middle, row - middle)
        return sample(whole, at_col + (middle + margin), at_row + (middle + margin))

    rs, valid = seen(gs_col, gs_row)
    gs = whole[:, :0, :size, :size]
    if with_gs:
        central = slice(margin, margin + size)
        gs = whole[..., central, central].contiguous() if views is None else seen(col, row)[0]
    return Samples(rs, gs, valid, tx, rz)


def _window(photo: Tensor, side: int, place: float) -> Tensor:
    """Returns the square window at a fraction of the way along the longer side."""
    top, left = (int(place * (length - side) + 0.5) for length in photo.shape[1:])
    return photo[:, top : top + side, left : left + side]
