"""Draws training samples from places: a new view of a cube map for every sample.

The camera is held as people hold theirs, at times towards towers. It moves by the paper's quadratics, or rotates about
all three axes, as hands and pans do; the network's answer is then the t_x and r_z that come nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from unshutter.errors import UsageError
from unshutter.motion.rotations import rotation_matrix
from unshutter_lab.synthesis.panorama import (
    Place,
    attitude_matrix,
    paper_matrices,
    pixel_directions,
    places_in,
    shipped_places,
)
from unshutter_lab.training.atlases import Atlases
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
    """Places, and the cameras that see them. Angles in degrees; a spread is a standard deviation."""

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
class _Cameras:
    attitude: Tensor  # [B, 3, 3] from the camera's axes to those of the place
    focal_px: Tensor  # [B]


@dataclass(frozen=True)
class _Moves:
    """Coefficients [B, 3] of u, u^2, u^3 of some motions."""

    tx: Tensor  # in rows of the picture
    rz: Tensor  # rad
    up: Tensor  # in rows of the picture
    rotates: Tensor  # [B] whether the camera rotates about all three axes; else these are the paper's t_x and r_z


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
        self._held: Atlases | None = None

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
        moves = self._motions(count, generator, motions)
        which = self._which(drawn, generator)
        cameras = self._cameras(which, size, generator)
        matrices, tx, rz = _rows(moves, cameras.focal_px, size)
        mirrored = Dice(generator, count).happens(0.5)
        sides = 1 - 2 * mirrored.float()[:, None]
        rs = _mirrored(self._seen(which, cameras, matrices, size), mirrored)
        gs = rs[..., :0, :0]
        if with_gs:
            standing = torch.eye(3, device=rs.device).expand(count, size, 3, 3)
            gs = _mirrored(self._seen(which, cameras, standing, size), mirrored)
        return rs, gs, sides * tx, sides * rz

    def _which(self, drawn: list[bool], generator: torch.Generator) -> Tensor:
        """Returns [B] numbers of places, or of drawn ones, which follow the places."""
        is_drawn = torch.tensor(drawn, device=generator.device)
        counts = torch.where(is_drawn, len(self.drawn), len(self.places))
        chosen = (Dice(generator, len(drawn)).each() * counts).long()
        return chosen + is_drawn * len(self.places)

    def _seen(self, which: Tensor, cameras: _Cameras, matrices: Tensor, size: int) -> Tensor:
        directions = pixel_directions(cameras.attitude[:, None] @ matrices, cameras.focal_px[:, None], size)
        return self._atlases(which.device).seen(which, directions, cameras.focal_px)

    def _atlases(self, device: torch.device) -> Atlases:
        if self._held is None:
            self._held = Atlases([*self.places, *self.drawn], device)
        return self._held

    def draw_anew(self, number: int, place: Place) -> None:
        """Replaces a drawn place by another of the same size."""
        self.drawn[number] = place
        if self._held is not None:
            self._held.replace(len(self.places) + number, self.drawn[number])

    def _motions(self, count: int, generator: torch.Generator, config: MotionConfig) -> _Moves:
        dice = Dice(generator, count)
        die = dice.each()
        edges = torch.tensor([1 - config.hand - config.pan, 1 - config.pan], device=die.device)
        kind = torch.bucketize(die, edges, right=True)  # index in KINDS
        tx, rz, up = (torch.zeros(count, 3, device=generator.device) for _ in range(3))
        for number, name in enumerate(KINDS):
            of_kind = (kind == number)[:, None]
            drawn_tx, drawn_rz = draw_kind(name, count, generator)
            tx, rz = torch.where(of_kind, drawn_tx, tx), torch.where(of_kind, drawn_rz, rz)
            spread = torch.tensor(_UPWARDS.get(name, (0.0, 0.0, 0.0)), device=generator.device)
            up = torch.where(of_kind, dice.normal(3) * spread, up)
        moves = 1.0 - dice.happens(self.config.still).float()[:, None]
        return _Moves(moves * tx, moves * rz, moves * up, kind > 0)

    def _cameras(self, which: Tensor, size: int, generator: torch.Generator) -> _Cameras:
        """Returns cameras that see more than the sky, if a few tries find any."""
        count = len(which)
        config, dice = self.config, Dice(generator, count)
        upwards = config.steepest * dice.each(_TRIES)
        tilt = torch.where(dice.happens(config.looking_up)[:, None], upwards, config.tilt * dice.normal(_TRIES))
        roll = config.roll * dice.normal() * torch.where(dice.happens(config.askew), 5.0, 1.0)
        view = dice.between(config.narrowest, config.widest)
        yaw = dice.between(0, 360, _TRIES)
        yaw, tilt, roll = (torch.deg2rad(angle) for angle in (yaw, tilt, roll))
        attitude = attitude_matrix(yaw, tilt, torch.zeros_like(yaw))  # [B, tries, 3, 3]
        thumbnails = self._thumbnails(which, view, attitude)
        rich = thumbnails.flatten(2).std(2) * 255 > _LEAST_CONTRAST
        rich[:, -1] = True
        chosen = rich.int().argmax(1)  # the first of them
        first = torch.arange(count, device=which.device)
        return _Cameras(attitude_matrix(yaw[first, chosen], tilt[first, chosen], roll), _focal_px(view, size))

    def _thumbnails(self, which: Tensor, view: Tensor, attitude: Tensor) -> Tensor:
        tries = attitude.shape[1]
        cameras = _Cameras(attitude.flatten(0, 1), _focal_px(view, _THUMBNAIL).repeat_interleave(tries))
        standing = torch.eye(3, device=view.device).expand(len(cameras.focal_px), _THUMBNAIL, 3, 3)
        seen = self._seen(which.repeat_interleave(tries), cameras, standing, _THUMBNAIL)
        return seen.unflatten(0, (-1, tries))


def _focal_px(view: Tensor, size: int) -> Tensor:
    return size / 2 / torch.tan(torch.deg2rad(view) / 2)


def _rows(moves: _Moves, focal_px: Tensor, size: int) -> tuple[Tensor, Tensor, Tensor]:
    """Returns row matrices [B, size, 3, 3], and the labels: coefficients [B, 4] of t_x [px] and r_z [rad]."""
    u = torch.arange(size, dtype=torch.float64, device=focal_px.device) / size
    powers = torch.stack([u, u**2, u**3])  # [3, rows]
    focal = focal_px.double()[:, None]
    tx, rz, up = (each.double() @ powers for each in (moves.tx * size, moves.rz, moves.up * size))
    rotated = rotation_matrix(torch.stack([torch.arctan(up / focal), torch.arctan(tx / focal), rz], -1))
    moved_px = focal * rotated[..., 0, 2] / rotated[..., 2, 2]
    angle = torch.arctan2(-rotated[..., 0, 1], rotated[..., 1, 1])
    nearest = torch.linalg.pinv(powers)
    rotations = moves.rotates[:, None]
    label_tx = torch.where(rotations, moved_px @ nearest, moves.tx * size)
    label_rz = torch.where(rotations, angle @ nearest, moves.rz)
    matrices = torch.where(rotations[..., None, None], rotated.transpose(-1, -2), paper_matrices(tx, rz, focal))
    return matrices.float(), _from_u(label_tx), _from_u(label_rz)


def _from_u(coefficients: Tensor) -> Tensor:
    """Adds the coefficient of u^0, which is zero."""
    return torch.nn.functional.pad(coefficients.float(), (1, 0))


def _mirrored(pictures: Tensor, mirrored: Tensor) -> Tensor:
    return torch.where(mirrored[:, None, None, None], pictures.flip(-1), pictures)
