"""Training samples from places: views of cube maps, a new one for every sample, so that none is seen twice.

The camera turns as people hold theirs, at times towards towers. It moves by the paper's quadratics, or turns about all
three axes as hands do and when it pans; the network's answer is then the t_x and r_z that come nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from unshutter.errors import UsageError
from unshutter.motion.rotations import rotation_matrix
from unshutter_lab.synthesis.panorama import Camera, Place, paper_matrices, places_in, shipped_places
from unshutter_lab.training.motions import KINDS, Dice, MotionConfig, draw_kind
from unshutter_lab.training.towns import draw_place
from unshutter_lab.training.variation import check_shares

_THUMBNAIL = 24  # px
_LEAST_CONTRAST = 16.0  # standard deviation of a thumbnail's values; below it, there is little but sky
_TRIES = 4
_DRAWN_SEED = 2**21
# standard deviations of the coefficients of u, u^2, u^3 by which hands and pans move the picture up, in rows
_UPWARDS = {"hand": (0.05, 0.015, 0.004), "pan": (0.012, 0.004, 0.002)}


@dataclass(frozen=True)
class PlacesConfig:
    """Places, and how they are looked at. Angles in degrees; a spread is a standard deviation."""

    folder: str = ""  # cube maps, a folder each (synthesis/panorama.py); those of the benchmark are left out
    share: float = 0.0  # share of the training samples that show them
    drawn: int = 0  # places to draw (towns.py)
    drawn_share: float = 0.0  # share of the training samples that show these
    drawn_side: int = 384  # of their faces [px]
    still: float = 0.1  # share of the samples in which the camera stands still
    narrowest: float = 40.0  # angle that the picture shows from side to side
    widest: float = 75.0
    roll: float = 0.8  # spread of the roll: most cameras are held nearly level,
    askew: float = 0.12  # except this share, with five times the spread
    tilt: float = 4.0  # spread of the tilt
    looking_up: float = 0.25  # share tilted upwards by up to ``steepest`` instead
    steepest: float = 40.0

    def __post_init__(self) -> None:
        check_shares("[data.places]", self.share, self.drawn_share, self.still, self.askew, self.looking_up)
        if self.share + self.drawn_share > 1:
            raise UsageError("[data.places]: share and drawn_share must not be more than 1 together")
        if (self.share > 0) != bool(self.folder) or (self.drawn_share > 0) != bool(self.drawn):
            raise UsageError("[data.places]: a share needs its places, and places their share")


@dataclass(frozen=True)
class _Attitudes:
    """What a batch of cameras needs: drawn numbers, each [B] or [B, tries]."""

    yaw: list[list[float]]
    tilt: list[list[float]]
    roll: list[float]
    view: list[float]
    mirrored: list[bool]


class PlaceViews:
    """Places held in memory, and samples of them."""

    def __init__(self, config: PlacesConfig):
        self.config = config
        kept = set(shipped_places())
        folders = places_in(Path(config.folder)) if config.folder else []
        self.places = [Place.load(folder) for folder in folders if folder.name not in kept]
        if config.folder and not self.places:
            raise UsageError(f"[data.places]: {config.folder} holds no places but those of the benchmark")
        self.drawn = [Place(draw_place(config.drawn_side, _DRAWN_SEED + k)) for k in range(config.drawn)]

    def share_of(self, count: int, generator: torch.Generator) -> tuple[int, int]:
        """Returns how many samples of a batch show places, and how many drawn ones."""
        dice = torch.rand(2, generator=generator, device=generator.device).tolist()
        shares = self.config.share, self.config.drawn_share
        of_places, of_drawn = (int(share * count + die) for share, die in zip(shares, dice, strict=True))
        of_places = min(of_places, count)
        return of_places, min(of_drawn, count - of_places)

    def pictures(
        self, drawn: list[bool], size: int, generator: torch.Generator, motions: MotionConfig, *, with_gs: bool
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns views of places or drawn places, and their motions.

        Returns:
            [B, 3, size, size] in 0 ... 1 distorted and undistorted pictures (if wanted), and the coefficients [B, 4] of
            t_x [px] and r_z [rad] as in Samples.
        """
        count = len(drawn)
        tx, rz, up, turns = self._motions(count, generator, motions)
        attitudes = self._attitudes(count, generator)
        which = Dice(generator, count).each().tolist()
        rs, gs, labels = [], [], []
        for k, is_drawn in enumerate(drawn):
            supply = self.drawn if is_drawn else self.places
            place = supply[int(which[k] * len(supply))]
            camera = _camera(place, attitudes, k, size)
            rows, label = _rows(tx[k] * size, up[k] * size, rz[k], size, camera.focal_px, bool(turns[k]))
            sides = -1 if attitudes.mirrored[k] else 1
            rs.append(place.seen(camera, rows)[:, ::sides])
            labels.append(sides * label)
            if with_gs:
                gs.append(place.seen(camera)[:, ::sides])
        device = generator.device
        coefficients = torch.from_numpy(np.stack(labels)).float().to(device)
        undistorted = _as_pictures(gs, device) if with_gs else torch.zeros(count, 3, 0, 0, device=device)
        return _as_pictures(rs, device), undistorted, coefficients[:, 0], coefficients[:, 1]

    def _motions(
        self, count: int, generator: torch.Generator, config: MotionConfig
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Returns coefficients [B, 3] of t_x, r_z and of the motion upwards [rows], and whether the camera turns."""
        dice = Dice(generator, count)
        die = dice.each()
        edges = torch.tensor([1 - config.hand - config.pan, 1 - config.pan])
        kind = torch.bucketize(die, edges.to(die.device), right=True)  # index in KINDS
        tx, rz, up = (torch.zeros(count, 3, device=generator.device) for _ in range(3))
        for number, name in enumerate(KINDS):
            of_kind = (kind == number)[:, None]
            drawn_tx, drawn_rz = draw_kind(name, count, generator)
            tx, rz = torch.where(of_kind, drawn_tx, tx), torch.where(of_kind, drawn_rz, rz)
            spread = torch.tensor(_UPWARDS.get(name, (0.0, 0.0, 0.0)), device=generator.device)
            up = torch.where(of_kind, dice.normal(3) * spread, up)
        moves = 1.0 - dice.happens(self.config.still).float()[:, None]
        scaled = [(moves * each).double().cpu().numpy() for each in (tx, rz, up)]
        return scaled[0], scaled[1], scaled[2], (kind > 0).cpu().numpy()

    def _attitudes(self, count: int, generator: torch.Generator) -> _Attitudes:
        config, dice = self.config, Dice(generator, count)
        upwards = config.steepest * dice.each(_TRIES)
        tilt = torch.where(dice.happens(config.looking_up)[:, None], upwards, config.tilt * dice.normal(_TRIES))
        roll = config.roll * dice.normal() * torch.where(dice.happens(config.askew), 5.0, 1.0)
        view = dice.between(config.narrowest, config.widest)
        yaw = dice.between(0, 360, _TRIES)
        return _Attitudes(yaw.tolist(), tilt.tolist(), roll.tolist(), view.tolist(), dice.happens(0.5).tolist())


def _camera(place: Place, attitudes: _Attitudes, k: int, size: int) -> Camera:
    """Returns the first of some cameras that sees more than the sky."""
    roll, view = attitudes.roll[k], attitudes.view[k]
    yaw, tilt = attitudes.yaw[k][0], attitudes.tilt[k][0]
    for yaw, tilt in zip(attitudes.yaw[k], attitudes.tilt[k], strict=True):
        if place.seen(Camera.of_view(_THUMBNAIL, _THUMBNAIL, view, yaw=yaw, tilt=tilt)).std() > _LEAST_CONTRAST:
            break
    return Camera.of_view(size, size, view, yaw=yaw, tilt=tilt, roll=roll)


def _rows(
    tx: np.ndarray, up: np.ndarray, rz: np.ndarray, size: int, focal_px: float, turns: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the row matrices of a motion with coefficients [3] of u, u^2, u^3, and its label [2, 4]."""
    u = np.arange(size) / size
    powers = np.stack([u, u**2, u**3], -1)  # [rows, 3]
    if not turns:
        return paper_matrices(powers @ tx, powers @ rz, focal_px), np.stack([_from_u(tx), _from_u(rz)])
    angles = np.stack([np.arctan(powers @ up / focal_px), np.arctan(powers @ tx / focal_px), powers @ rz], -1)
    matrices = rotation_matrix(angles)
    moved = focal_px * matrices[:, 0, 2] / matrices[:, 2, 2]
    turned = np.arctan2(-matrices[:, 0, 1], matrices[:, 1, 1])
    fit = np.linalg.lstsq(powers, np.stack([moved, turned], -1), rcond=None)[0]
    return matrices.transpose(0, 2, 1), np.stack([_from_u(fit[:, 0]), _from_u(fit[:, 1])])


def _from_u(coefficients: np.ndarray) -> np.ndarray:
    """Adds the coefficient of u^0, which is zero."""
    return np.concatenate([[0.0], coefficients])


def _as_pictures(pictures: list[np.ndarray], device: torch.device) -> Tensor:
    """[B, 3, h, w] in 0 ... 1 of uint8 [h, w, 3] each."""
    stacked = np.ascontiguousarray(np.stack(pictures).transpose(0, 3, 1, 2))
    return torch.from_numpy(stacked).to(device).float().div_(255)
