"""Variation of training pictures: of light and camera, and views of training windows by another camera.

Light falls on the scene, so it is the same for the distorted and the undistorted picture. Blur, noise and compression
are the camera's: they affect only the distorted picture, which the network sees.

A camera that rotates about its centre, or changes its focal length, sees the same picture under a homography. The
window is treated as the picture of a level camera; a view of it is rolled, tilted, panned and zoomed in. Positions are
in px from the centre of the picture or of the window, columns right, rows down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter_lab.training.motions import Dice

_BLOCK = 8  # of JPEG [px]
_LUMA = torch.tensor([0.299, 0.587, 0.114])


def check_shares(table: str, *shares: float) -> None:
    """Raises UsageError if a share of a configuration's table is not one."""
    if not all(0 <= share <= 1 for share in shares):
        raise UsageError(f"{table}: shares must lie between 0 and 1")


@dataclass(frozen=True)
class LightConfig:
    """Variation of light and cameras. A spread is a standard deviation of the logarithm."""

    share: float = 0.0  # share of the pictures that are varied
    exposure: float = 0.2  # spread
    gamma: float = 0.2  # spread
    balance: float = 0.06  # spread of each channel
    grey: float = 0.1  # share without colour
    blurred: float = 0.3  # share
    blur_px: float = 1.2  # largest standard deviation of the blur
    noisy: float = 0.3  # share
    noise: float = 0.04  # largest standard deviation of the noise, of white = 1
    compressed: float = 0.25  # share with JPEG artefacts
    quantum: float = 0.25  # largest step of JPEG's coefficients, of white = 1

    def __post_init__(self) -> None:
        check_shares("[data.light]", self.share, self.grey, self.blurred, self.noisy, self.compressed)


class Light:
    """The light and the camera of one batch of pictures."""

    def __init__(self, config: LightConfig, generator: torch.Generator, batch: int):
        dice = Dice(generator, batch)
        self._dice, changed = dice, dice.happens(config.share)
        spread = changed.float()[:, None]
        gain = config.exposure * dice.normal(1) + config.balance * dice.normal(3)
        self._gain = torch.exp(spread * gain)[..., None, None]  # [B, 3, 1, 1]
        self._gamma = torch.exp(spread * config.gamma * dice.normal(1))[..., None, None]
        self._grey = changed & dice.happens(config.grey)
        blurred, noisy, compressed = (
            changed & dice.happens(share) for share in (config.blurred, config.noisy, config.compressed)
        )
        self._blur = torch.where(blurred, config.blur_px * dice.each(), 0.0)
        self._noise = torch.where(noisy, config.noise * dice.each(), 0.0)
        self._quantum = torch.where(compressed, config.quantum * dice.each(), 0.0)

    def on_scene(self, pictures: Tensor) -> Tensor:
        """Returns [B, 3, h, w] in 0 ... 1 under the varied light. Black remains black."""
        pictures = (pictures * self._gain).clamp_(0, 1)
        pictures = torch.pow(pictures, self._gamma)
        some = self._grey.nonzero()[:, 0]
        if len(some):
            luma = (pictures[some] * _LUMA.to(pictures)[:, None, None]).sum(1, keepdim=True)
            pictures[some] = luma.expand(-1, 3, -1, -1)
        return pictures

    def through_camera(self, pictures: Tensor) -> Tensor:
        """Returns [B, 3, h, w] as recorded by the camera: blurred, noisy, compressed."""
        pictures = _of_some(pictures, self._blur, blur)
        some = self._noise.nonzero()[:, 0]
        if len(some):
            noise = torch.randn(len(some), *pictures.shape[1:], generator=self._dice.generator, device=pictures.device)
            pictures = pictures.index_add(0, some, noise * self._noise[some, None, None, None])
        return _of_some(pictures, self._quantum, compress).clamp_(0, 1)


def blur(pictures: Tensor, deviation: Tensor) -> Tensor:
    """Blurs [B, C, h, w] by Gaussians with standard deviations [B] px."""
    places = torch.arange(-3, 4, dtype=pictures.dtype, device=pictures.device)
    weights = torch.exp(-0.5 * (places / deviation.clamp(min=1e-3)[:, None]).square())
    weights = (weights / weights.sum(1, keepdim=True))[..., None, None, None]  # [B, 7, 1, 1, 1]
    height, width = pictures.shape[-2:]
    for padding, axis, length in (((0, 0, 3, 3), 2, height), ((3, 3, 0, 0), 3, width)):
        padded = F.pad(pictures, padding, mode="replicate")
        pictures = sum((weights[:, k] * padded.narrow(axis, k, length) for k in range(7)), torch.zeros(()))
    return pictures


def compress(pictures: Tensor, quantum: Tensor) -> Tensor:
    """Adds JPEG artefacts to [B, C, h, w]: rounds the cosine coefficients of blocks of 8 px.

    Args:
        pictures: their sides must be multiples of 8.
        quantum: [B] step of the highest frequencies; that of the lowest is a sixth.
    """
    frequency = torch.arange(_BLOCK, dtype=pictures.dtype, device=pictures.device)
    cosines = torch.cos(math.pi / _BLOCK * frequency[:, None] * (frequency + 0.5)) * math.sqrt(2 / _BLOCK)
    cosines[0] *= math.sqrt(0.5)
    height, width = pictures.shape[-2:]
    blocks = pictures.unflatten(3, (width // _BLOCK, _BLOCK)).unflatten(2, (height // _BLOCK, _BLOCK))
    blocks = blocks.transpose(3, 4)  # [B, C, h / 8, w / 8, 8, 8]
    steps = (1 + 5 * (frequency[:, None] + frequency) / (2 * _BLOCK - 2)) / 6
    steps = quantum[:, None, None, None, None, None] * steps
    coefficients = torch.round(cosines @ blocks @ cosines.T / steps) * steps
    return (cosines.T @ coefficients @ cosines).transpose(3, 4).reshape(pictures.shape)


def _of_some(pictures: Tensor, amount: Tensor, change) -> Tensor:
    """Applies a change to the pictures whose amount [B] is not zero."""
    some = amount.nonzero()[:, 0]
    if len(some):
        pictures = pictures.index_copy(0, some, change(pictures[some], amount[some]))
    return pictures


@dataclass(frozen=True)
class ViewConfig:
    """Variation of the cameras of training windows. Angles in degrees; a spread is a standard deviation."""

    share: float = 0.0  # share of the windows seen by another camera
    roll: float = 0.8  # spread of the roll: most cameras are held nearly level,
    askew: float = 0.12  # except this share, with five times the spread
    tilt: float = 4.0  # spread of the tilt
    looking_up: float = 0.2  # share tilted upwards by up to ``steepest`` instead, as in front of towers
    steepest: float = 20.0
    yaw: float = 12.0  # spread of the yaw
    focal_rows: float = 1.4  # median focal length of photos, in rows of the window; log-normal
    focal_spread: float = 0.25
    zoom: float = 1.35  # pictures are magnified by 1 ... this, log-uniform

    def __post_init__(self) -> None:
        check_shares("[data.views]", self.share, self.askew, self.looking_up)
        if self.zoom < 1:
            raise UsageError(f"[data.views]: 'zoom' must be at least 1, got {self.zoom}")


def draw_views(config: ViewConfig, generator: torch.Generator, batch: int, size: int, window: int) -> Tensor:
    """[B, 3, 3] random homographies from positions in pictures of ``size`` px to positions in windows [px]."""
    dice = Dice(generator, batch)
    seen_askew = dice.happens(config.share).float()
    degrees = seen_askew * math.pi / 180
    roll = config.roll * dice.normal() * torch.where(dice.happens(config.askew), 5.0, 1.0) * degrees
    upwards = config.steepest * dice.each()
    tilt = torch.where(dice.happens(config.looking_up), upwards, config.tilt * dice.normal()) * degrees
    yaw = config.yaw * dice.normal().clamp(-2.5, 2.5) * degrees
    zoom = torch.exp(seen_askew * math.log(config.zoom) * dice.each())
    focal = window * config.focal_rows * torch.exp(config.focal_spread * dice.normal())
    room = (size / 2) * (1 - 1 / zoom)  # a magnified picture may show any part of the original one
    place = torch.stack([room * dice.between(-1, 1), room * dice.between(-1, 1)], -1)
    return view_homography(roll, tilt, yaw, focal, zoom, place)


def view_homography(roll: Tensor, tilt: Tensor, yaw: Tensor, focal: Tensor, zoom: Tensor, place: Tensor) -> Tensor:
    """[B, 3, 3] homographies from positions in the picture to positions in the window.

    Args:
        roll, tilt, yaw: [B] of the camera relative to the window's [rad]; positive: clockwise, up, to the right.
        focal: [B] focal length of the window [px].
        zoom: [B] magnification.
        place: [B, 2] (col, row) in the window at the picture's centre [px].
    """
    to_ray = torch.diag_embed(torch.stack([1 / (focal * zoom), 1 / (focal * zoom), torch.ones_like(focal)], -1))
    rays = _rotation(yaw, 2, 0, -1.0) @ _rotation(tilt, 2, 1) @ _rotation(roll, 0, 1, -1.0) @ to_ray
    centre = focal[:, None] * rays[:, :2, 2] / rays[:, 2:, 2]
    to_window = torch.diag_embed(torch.stack([focal, focal, torch.ones_like(focal)], -1))
    to_window[:, :2, 2] = place - centre
    return to_window @ rays


def move(homography: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Maps positions [B, h, w] by homographies [B, 3, 3]."""
    a = homography[..., None, None]  # [B, 3, 3, 1, 1]
    x, y, w = (a[:, i, 0] * col + a[:, i, 1] * row + a[:, i, 2] for i in range(3))
    return x / w, y / w


def _rotation(angle: Tensor, i: int, j: int, sign: float = 1.0) -> Tensor:
    """[B, 3, 3] rotations in the plane of two axes."""
    matrix = torch.eye(3, dtype=angle.dtype, device=angle.device).repeat(len(angle), 1, 1)
    cosine, sine = torch.cos(angle), sign * torch.sin(angle)
    matrix[:, i, i] = matrix[:, j, j] = cosine
    matrix[:, i, j], matrix[:, j, i] = sine, -sine
    return matrix
