"""Draws scenes: line segments as a detector would find them in a rolling-shutter photo.

No photos are involved. A camera with random roll, tilt and focal length looks at facades (verticals, horizontals of one
or more street directions, roof slopes) amid clutter. A random row motion (motions.py) distorts the segments exactly,
and noise like the detector's is added.

Units: one row height of the picture = 1 (coordinates centred, columns right, rows down), angles in radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from unshutter.motion import geometry
from unshutter_lab.training.config import from_table
from unshutter_lab.training.motions import Dice, MotionConfig, cubic_motion, draw_mixture


@dataclass(frozen=True)
class SceneConfig:
    """Properties of the drawn scenes. Lengths in px are those of a picture of 256 rows."""

    tokens: int = 128  # segments kept per scene
    drawn: int = 240  # segments drawn per scene, about half of which leave the frame
    min_share: float = 0.3  # scenes keep a random share of their segments, at least this
    square: float = 0.4  # share of square pictures
    widest: float = 2.4  # the others have an aspect of 1:widest ... widest:1, log-uniform
    zero_motion: float = 0.1  # share of the predecessor's quadratics that are set to no motion
    small_motion: float = 0.25  # share of the other quadratics that are multiplied by a random factor below 1
    sideways: float = 0.12  # share of pictures whose scene lies on its side, as in portrait photos
    tilted: float = 0.4  # share of cameras tilted by -6 to 25 degrees (upwards); the others are held level,
    steep: float = 0.1  # or tilted by 15 to 50
    focal_rows: float = 1.7  # median focal length in rows of a square picture; log-normal
    focal_spread: float = 0.35
    patches: int = 6  # regions of a scene: facades, roofs, trees; each with its own mixture of segments
    length_px: float = 11.5  # median length of a segment
    length_spread: float = 0.62
    long_share: float = 0.12  # share of segments that are three times longer: edges of roofs, poles, kerbs
    clutter_max: float = 0.6  # largest share of segments of arbitrary direction
    lens: float = 0.02  # spread of the radial distortion at the corner
    motions: dict[str, Any] = field(default_factory=dict)  # kinds of motion: fields of MotionConfig


@dataclass(frozen=True)
class Scenes:
    """A batch of drawn scenes."""

    tokens: Tensor  # [B, N, 6] end points (x1, y1, x2, y2) in the RS picture, unit vector towards the top of the scene
    mask: Tensor  # [B, N] True for valid segments
    # [B] width / height. tx, rz: [B, 3] coefficients of u, u^2, u^3 with u = row coordinate + 1/2; t_x in rows, r_z
    # in rad.
    aspect: Tensor
    tx: Tensor
    rz: Tensor
    camera: Tensor  # [B, 3] roll [rad], tilt [rad], log focal length [rows]


def draw_scenes(batch: int, config: SceneConfig, generator: torch.Generator) -> Scenes:
    """Draws a batch of scenes on the generator's device."""
    dice = Dice(generator, batch)
    aspect = torch.exp(math.log(config.widest) * dice.between(-1, 1))
    aspect = torch.where(dice.happens(config.square), 1.0, aspect)
    kinds = from_table(MotionConfig, config.motions, "[data.motions]")
    tx, rz = draw_mixture(batch, generator, kinds, config.zero_motion, config.small_motion)
    roll, tilt, focal = _camera(dice, config, aspect)
    turn = _quarter_turn(dice, config)
    scene_aspect = torch.where(turn % 2 == 1, 1 / aspect, aspect)

    patches = _Patches.draw(dice, config, scene_aspect)
    middle_scene, direction, kind, tangent = patches.segments(dice, config)
    scale = torch.where(turn % 2 == 1, aspect, torch.ones_like(aspect))[:, None, None]
    middle_rs = _rotate(middle_scene * scale, turn[:, None] * (math.pi / 2))
    motion = cubic_motion(tx, rz)
    t, r, _ = motion(middle_rs[..., 1])
    middle = torch.stack(geometry.rs_to_gs(middle_rs[..., 0], middle_rs[..., 1], t, r), -1)

    rotation = _camera_matrix(roll + turn * (math.pi / 2), tilt)
    in_camera = torch.einsum("bij,bnj->bni", rotation, direction)
    image = focal[:, None, None] * in_camera[..., :2] - middle * in_camera[..., 2:]
    angle = torch.atan2(image[..., 1], image[..., 0]) + _angle_noise(dice, kind)
    angle = torch.where(kind == CLUTTER, tangent + turn[:, None] * (math.pi / 2), angle)
    half = 0.5 * _lengths(dice, config, kind)
    step = torch.stack([torch.cos(angle), torch.sin(angle)], -1) * half[..., None]
    ends = torch.stack([middle - step, middle + step], 2)  # [B, N, 2 ends, 2]
    ends = _lens(dice, config, ends, aspect)
    flat = ends.flatten(1, 2)
    x, y = geometry.gs_to_rs(flat[..., 0], flat[..., 1], motion, steps=4)
    ends = torch.stack([x, y], -1).view_as(ends) + _end_noise(dice, config, ends, angle)

    inside = (ends[..., 1].abs() < 0.5).all(-1) & (ends[..., 0].abs() < aspect[:, None, None] / 2).all(-1)
    drawn = dice.each(config.drawn) < dice.between(config.min_share, 1.0)[:, None]
    up = torch.stack([torch.sin(turn * (math.pi / 2)), -torch.cos(turn * (math.pi / 2))], -1).round()
    tokens = torch.cat([ends.flatten(2), up[:, None].expand(-1, config.drawn, -1)], -1)
    tokens, mask = _compact(tokens, inside & drawn, config.tokens)
    return Scenes(tokens, mask, aspect, tx, rz, torch.stack([roll, tilt, torch.log(focal)], -1))


def _compact(tokens: Tensor, mask: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Returns the first ``count`` positions, valid tokens first; attention needs at least one."""
    order = torch.argsort(mask.to(torch.int8), dim=1, descending=True, stable=True)[:, :count]
    mask = torch.gather(mask, 1, order)
    mask[:, 0] = True
    return torch.gather(tokens, 1, order[..., None].expand(-1, -1, tokens.shape[-1])), mask


def _camera(dice: Dice, config: SceneConfig, aspect: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    degree = math.pi / 180
    roll = dice.normal() * torch.where(dice.happens(0.25), 4.0, 1.0)
    kind = dice.each()
    tilt = torch.where(kind < 1 - config.tilted - config.steep, 2 + 4 * dice.normal(), dice.between(-6, 25))
    tilt = torch.where(kind > 1 - config.steep, dice.between(15, 50), tilt)
    focal = config.focal_rows * torch.exp(config.focal_spread * dice.normal()) * (1 + aspect) / 2
    return roll * degree, tilt * degree, focal


def _quarter_turn(dice: Dice, config: SceneConfig) -> Tensor:
    side = torch.where(dice.happens(0.5), 1.0, 3.0)
    return torch.where(dice.happens(config.sideways), side, 0.0)


def _camera_matrix(roll: Tensor, tilt: Tensor) -> Tensor:
    """[B, 3, 3] world (x right, y down, z forward) -> camera; a positive tilt looks up."""
    zero, one = torch.zeros_like(roll), torch.ones_like(roll)
    c, s = torch.cos(tilt), torch.sin(tilt)
    about_x = torch.stack([one, zero, zero, zero, c, s, zero, -s, c], -1).view(-1, 3, 3)
    c, s = torch.cos(roll), torch.sin(roll)
    about_z = torch.stack([c, -s, zero, s, c, zero, zero, zero, one], -1).view(-1, 3, 3)
    return about_z @ about_x


def _rotate(points: Tensor, angle: Tensor) -> Tensor:
    c, s = torch.cos(angle), torch.sin(angle)
    return torch.stack([points[..., 0] * c - points[..., 1] * s, points[..., 0] * s + points[..., 1] * c], -1)


# Kinds of segments, by what determines their direction.
VERTICAL, HORIZONTAL, SLOPE, LEANING, CLUTTER = range(5)


@dataclass(frozen=True)
class _Patches:
    """The arrangement of regions in the scene's own frame (upright; one row height = 1)."""

    azimuth: Tensor  # [B, K] direction of each patch's horizontals
    center: Tensor  # [B, K, 2]
    extent: Tensor  # [B, K, 2] half width, half height
    weight: Tensor  # [B, K] relative number of segments
    shares: Tensor  # [B, K, kinds] cumulative shares of the kinds of segments
    ring: Tensor  # [B, K] radius of an arch or window rose
    aspect: Tensor  # [B]

    @classmethod
    def draw(cls, dice: Dice, config: SceneConfig, aspect: Tensor) -> _Patches:
        k = config.patches
        facing = math.radians(10) * dice.normal()  # many photos look straight at a facade
        street = torch.where(dice.happens(0.55), facing, dice.between(-math.pi, math.pi))[:, None]
        other = torch.where(dice.happens(0.35, 1), dice.between(-math.pi, math.pi, 1), street)
        own = torch.where(dice.happens(0.3, k), other, street)
        azimuth = own + (math.pi / 2) * dice.happens(0.5, k)
        wide = aspect[:, None]
        center = torch.stack([dice.between(-0.5, 0.5, k) * wide, 0.2 * dice.normal(k)], -1)
        extent = torch.stack([dice.between(0.04, 0.45, k) * wide, dice.between(0.06, 0.5, k)], -1)
        weight = dice.each(k) ** 2 * extent.prod(-1).sqrt() + 1e-3
        return cls(azimuth, center, extent, weight, cls._shares(dice, config), dice.between(0.03, 0.25, k), aspect)

    @staticmethod
    def _shares(dice: Dice, config: SceneConfig) -> Tensor:
        clutter = config.clutter_max * dice.each() ** 1.2
        leaning = 0.12 * dice.each() ** 2
        slope = 0.2 * dice.each() ** 3
        upright = dice.between(0.15, 0.6)
        rest = (1 - clutter - leaning - slope).clamp(min=0.05)
        scene = torch.stack([rest * upright, rest * (1 - upright), slope, leaning, clutter], -1)
        patch = scene[:, None] * torch.exp(dice.normal(config.patches, scene.shape[-1]))
        return torch.cumsum(patch / patch.sum(-1, keepdim=True), -1)

    def segments(self, dice: Dice, config: SceneConfig) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns centres [B, N, 2], world directions [B, N, 3], kinds [B, N] and tangents of arches [B, N]."""
        n = config.drawn
        index = dice.pick(self.weight, n)

        def of(table: Tensor) -> Tensor:
            return torch.gather(table, 1, index[..., None].expand(-1, -1, table.shape[-1]))

        kind = (dice.each(n)[..., None] > of(self.shares)).sum(-1).clamp(max=CLUTTER)
        place = dice.between(-1, 1, n, 2)
        in_patch = of(self.center) + of(self.extent) * place
        anywhere = 0.5 * dice.between(-1, 1, n, 2)
        anywhere = torch.stack([anywhere[..., 0] * self.aspect[:, None], anywhere[..., 1]], -1)
        round_ = dice.between(-math.pi, math.pi, n)
        on_ring = torch.gather(self.ring, 1, index)[..., None] * torch.stack([torch.cos(round_), torch.sin(round_)], -1)
        arch = (kind == CLUTTER) & dice.happens(0.25, n)
        loose = dice.happens(0.12, n) | ((kind >= LEANING) & dice.happens(0.4, n))
        middle = torch.where(loose[..., None], anywhere, in_patch)
        middle = torch.where(arch[..., None], of(self.center) + on_ring, middle)
        tangent = torch.where(arch, round_ + math.pi / 2, math.pi * dice.each(n))

        rise = torch.where(kind == SLOPE, self._slopes(dice, n), 0.0)
        rise = torch.where((kind == VERTICAL) | (kind == LEANING), math.pi / 2, rise)
        azimuth = torch.gather(self.azimuth, 1, index)
        flat = torch.cos(rise)
        direction = torch.stack([flat * torch.cos(azimuth), -torch.sin(rise), flat * torch.sin(azimuth)], -1)
        return middle, direction, kind, tangent

    def _slopes(self, dice: Dice, n: int) -> Tensor:
        pitch = dice.between(math.radians(12), math.radians(55), 1)
        side = torch.where(dice.happens(0.5, n), 1.0, -1.0)
        return side * torch.where(dice.happens(0.7, n), pitch, dice.between(0.2, 1.2, n))


def _angle_noise(dice: Dice, kind: Tensor) -> Tensor:
    """Returns deviations of directions from an exact drawing: building tolerances, open doors, shadows."""
    n = kind.shape[1]
    sloppy = math.radians(0.35) * torch.exp(0.6 * dice.normal(1)) * dice.normal(n)
    sloppy = sloppy * torch.where(dice.happens(0.12, n), 4.0, 1.0)
    return torch.where(kind == LEANING, math.radians(4) * dice.normal(n), sloppy)


def _lengths(dice: Dice, config: SceneConfig, kind: Tensor) -> Tensor:
    n = kind.shape[1]
    median = config.length_px * torch.exp(0.2 * dice.normal(1))
    length = median * torch.exp(config.length_spread * dice.normal(n))
    length = torch.where(kind == CLUTTER, 0.75 * length, 1.1 * length)
    length = torch.where((kind < LEANING) & dice.happens(config.long_share, n), 3 * length, length)
    return length.clamp(5, 160) / 256


def _end_noise(dice: Dice, config: SceneConfig, ends: Tensor, angle: Tensor) -> Tensor:
    """Returns detector noise across the segment, in px of a copy of 200 to 600 rows."""
    rows = torch.exp(dice.between(math.log(200), math.log(600), 1, 1))
    across = 0.22 * torch.exp(0.3 * dice.normal(1, 1)) / rows * dice.normal(ends.shape[1], 2)  # [B, N, 2]
    normal = torch.stack([-torch.sin(angle), torch.cos(angle)], -1)[:, :, None]
    return across[..., None] * normal


def _lens(dice: Dice, config: SceneConfig, ends: Tensor, aspect: Tensor) -> Tensor:
    """Applies radial lens distortion with relative displacement ``strength`` at the corner."""
    strength = torch.where(dice.happens(0.4), 0.0, config.lens * (dice.normal() - 0.4))
    corner2 = (1 + aspect**2) / 4
    r2 = ends.square().sum(-1, keepdim=True)
    return ends * (1 + (strength / corner2)[:, None, None, None] * r2)
