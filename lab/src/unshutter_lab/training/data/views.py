"""Views of training windows by another camera: homographies between that camera's picture and the window.

A camera that rotates about its centre, or changes its focal length, sees the same picture under a homography. The
window is treated as the picture of a level camera; a view of it is rolled, tilted, panned and zoomed in. Applied to
training pictures only; photos held out for validation keep their own camera.

Positions are in px from the centre of the picture or of the window, columns right, rows down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from unshutter.errors import UsageError
from unshutter_lab.training.data.dice import Dice


@dataclass(frozen=True)
class ViewConfig:
    """Variation of the cameras of training windows. Angles in degrees; a spread is a standard deviation.

    Raises:
        UsageError: a share is outside 0 ... 1.
    """

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
        if not all(0 <= share <= 1 for share in (self.share, self.askew, self.looking_up)):
            raise UsageError("[data.views]: shares must lie between 0 and 1")
        if self.zoom < 1:
            raise UsageError(f"[data.views]: 'zoom' must be at least 1, got {self.zoom}")


def draw_views(config: ViewConfig, generator: torch.Generator, batch: int, size: int, window: int) -> Tensor:
    """Draws random views of square windows.

    Args:
        config: their variation.
        generator: random number generator.
        batch: number of views.
        size: side of the pictures [px].
        window: side of the windows [px].

    Returns:
        [B, 3, 3] homographies from positions in the picture to positions in the window.
    """
    dice = Dice(generator, batch)
    turned = dice.happens(config.share).float()
    degrees = turned * math.pi / 180
    roll = config.roll * dice.normal() * torch.where(dice.happens(config.askew), 5.0, 1.0) * degrees
    upwards = config.steepest * dice.each()
    tilt = torch.where(dice.happens(config.looking_up), upwards, config.tilt * dice.normal()) * degrees
    yaw = config.yaw * dice.normal().clamp(-2.5, 2.5) * degrees
    zoom = torch.exp(turned * math.log(config.zoom) * dice.each())
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
    rays = _about_y(yaw) @ _about_x(tilt) @ _about_z(roll) @ to_ray
    centre = focal[:, None] * rays[:, :2, 2] / rays[:, 2:, 2]
    to_window = torch.diag_embed(torch.stack([focal, focal, torch.ones_like(focal)], -1))
    to_window[:, :2, 2] = place - centre
    return to_window @ rays


def move(homography: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Maps positions [B, h, w] by homographies [B, 3, 3]."""
    a = homography[..., None, None]  # [B, 3, 3, 1, 1]
    x, y, w = (a[:, i, 0] * col + a[:, i, 1] * row + a[:, i, 2] for i in range(3))
    return x / w, y / w


def _about_x(angle: Tensor) -> Tensor:
    """[B, 3, 3]; a positive angle turns the forward ray upwards."""
    return _rotation(angle, 2, 1)


def _about_y(angle: Tensor) -> Tensor:
    """[B, 3, 3]; a positive angle turns the forward ray to the right."""
    return _rotation(angle, 2, 0, -1.0)


def _about_z(angle: Tensor) -> Tensor:
    """[B, 3, 3]; a positive angle turns the camera clockwise."""
    return _rotation(angle, 0, 1, -1.0)


def _rotation(angle: Tensor, i: int, j: int, sign: float = 1.0) -> Tensor:
    """[B, 3, 3] rotations in the plane of two axes."""
    matrix = torch.eye(3, dtype=angle.dtype, device=angle.device).repeat(len(angle), 1, 1)
    cosine, sine = torch.cos(angle), sign * torch.sin(angle)
    matrix[:, i, i] = matrix[:, j, j] = cosine
    matrix[:, i, j], matrix[:, j, i] = sine, -sine
    return matrix
