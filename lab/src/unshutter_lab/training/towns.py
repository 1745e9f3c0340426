"""Draws places as cube maps: towns with streets and towers all around, and rooms. No photos are involved.

What stands upright is drawn upright, so a camera may look at it from any attitude: at towers from below, too. Axes are
those of synthesis/panorama.py; the unit is the height of the camera above the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from unshutter_lab.synthesis.panorama import FACES, face_directions
from unshutter_lab.synthesis.walls import TEXTURE, clouds, draw_wall

_NEAREST = 1e-6  # of a denominator that may be zero
_ROOMS = 0.25  # share of the places that are rooms


@dataclass(frozen=True)
class _Wall:
    """An upright wall from one point of the ground (x, z) to another."""

    start: np.ndarray
    end: np.ndarray
    height: float
    texture: np.ndarray  # float32 [rows, columns, 3], top row first


def draw_place(side: int, seed: int) -> dict[str, np.ndarray]:
    """Returns the six faces of a drawn place, uint8 [side, side, 3] RGB each, by name."""
    dice = np.random.default_rng(seed)
    is_room = dice.random() < _ROOMS
    walls = _room(dice, side) if is_room else _town(dice, side)
    ground = _tiles(dice)
    above = _tiles(dice) if is_room else None
    sky = _sky(dice)
    tile = dice.uniform(0.5, 3.0)
    height = walls[0].height if is_room else np.inf
    grain = dice.uniform(0, 8)
    faces = {}
    for name in FACES:
        directions = face_directions(name, side).astype(np.float32)
        picture = _background(directions, sky, ground, above, height, tile)
        _hang(picture, directions, walls)
        picture += grain * dice.standard_normal(picture.shape, np.float32)
        faces[name] = np.clip(picture, 0, 255).astype(np.uint8)
    return faces


def _room(dice: np.random.Generator, side: int) -> list[_Wall]:
    """Returns the four walls of a room."""
    low, high = -dice.uniform(0.8, 5, 2), dice.uniform(0.8, 5, 2)
    return _box(dice, low, high, dice.uniform(1.4, 3.5), dice.uniform(0, np.pi / 2), side, inside=True)


def _town(dice: np.random.Generator, side: int) -> list[_Wall]:
    """Returns the walls of houses and towers that can be seen, most of them along the same streets."""
    streets, walls = dice.uniform(0, np.pi / 2), []
    tall = dice.uniform(0, 0.8)  # share of towers
    for _ in range(int(dice.integers(5, 15))):
        angle = streets if dice.random() < 0.75 else dice.uniform(0, np.pi / 2)
        middle = dice.uniform(2.5, 22) * _unit(dice.uniform(0, 2 * np.pi))
        half = dice.uniform(1.2, 6, 2)
        low, high = middle - half, middle + half
        # the middle is meant in the box's own axes; the camera must not stand in it
        if (np.maximum(low, -high) > 0.8).any():
            height = dice.uniform(8, 45) if dice.random() < tall else dice.uniform(2, 8)
            walls += _box(dice, low, high, height, angle, side)
    return walls


def _unit(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _box(
    dice: np.random.Generator,
    low: np.ndarray,
    high: np.ndarray,
    height: float,
    angle: float,
    side: int,
    inside: bool = False,
) -> list[_Wall]:
    """Returns those walls of a box, between two corners in its own axes, that the camera sees."""
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    axes = np.stack([_unit(angle), _unit(angle + np.pi / 2)])
    base = draw_wall(dice, height / float(np.mean(high - low)))
    walls = []
    for first, second in zip(corners, corners[1:] + corners[:1], strict=True):
        start, end = np.array(first) @ axes, np.array(second) @ axes
        along = end - start
        outwards = along[1] * start[0] - along[0] * start[1]  # how far the wall lies ahead of the box's own middle
        if (outwards < 0) == inside:
            continue
        own = draw_wall(dice, height / float(np.hypot(*along))) if dice.random() < 0.5 else base
        walls.append(_Wall(start, end, height, _reduced(own * dice.uniform(0.55, 1.15), start, end, height, side)))
    return walls


def _reduced(texture: np.ndarray, start: np.ndarray, end: np.ndarray, height: float, side: int) -> np.ndarray:
    """Returns a texture about as large as the wall is seen, so that it is not sampled too coarsely."""
    near = max(float(min(np.hypot(*start), np.hypot(*end), np.hypot(*(start + end)) / 2)), 0.5)
    px = side / 2 / near
    columns, rows = (int(np.clip(px * length, 8, TEXTURE)) for length in (np.hypot(*(end - start)), height))
    return cv2.resize(texture, (columns, rows), interpolation=cv2.INTER_AREA)


def _tiles(dice: np.random.Generator) -> np.ndarray:
    """Returns the texture of a floor: tiles, or nothing but stains."""
    side = 128
    floor = np.full((side, side, 3), dice.uniform(40, 200) + dice.uniform(-25, 25, 3), np.float32)
    floor *= 1 + dice.uniform(0, 0.2) * clouds(dice, side)[..., None]
    if dice.random() < 0.7:
        shade, thick = dice.uniform(0.6, 1.3), int(dice.integers(2, 7))
        floor[:thick] *= shade
        floor[:, :thick] *= shade
    return floor


def _sky(dice: np.random.Generator) -> np.ndarray:
    """Returns the colours [2, 3] of the sky above and at the horizon."""
    tint = dice.uniform(-30, 30, 3)
    return np.stack([dice.uniform(60, 230) + tint, dice.uniform(110, 250) - tint / 3]).astype(np.float32)


def _background(
    directions: np.ndarray,
    sky: np.ndarray,
    ground: np.ndarray,
    above: np.ndarray | None,
    height: float,
    tile: float,
) -> np.ndarray:
    """Returns what is seen where no wall is: ground, and sky or ceiling. float32 [n, n, 3]."""
    x, y, z = np.moveaxis(directions, -1, 0)
    up = np.clip(-y / np.sqrt(x * x + y * y + z * z), 0, 1)[..., None]
    picture = sky[1] + (sky[0] - sky[1]) * np.sqrt(up)
    for texture, distance, visible in ((ground, 1.0, y > 0), (above, height - 1.0, y < 0)):
        if texture is not None:
            scale = distance / np.maximum(np.abs(y), _NEAREST) / tile
            tiled = _repeated(texture, x * scale, z * scale)
            far = np.clip(scale * tile / (8 * tile), 0, 1)[..., None]  # tiles too small to be seen become one colour
            tiled += (texture.mean((0, 1)) - tiled) * far
            picture = np.where(visible[..., None], tiled, picture)
    return picture


def _repeated(texture: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Samples a texture that repeats every unit."""
    side = len(texture)
    col, row = ((place - np.floor(place)) * side for place in (across, along))
    return cv2.remap(texture, col.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR, None, cv2.BORDER_WRAP)


def _hang(picture: np.ndarray, directions: np.ndarray, walls: list[_Wall]) -> None:
    """Draws the walls, the nearest in front."""
    x, y, z = np.moveaxis(directions, -1, 0)
    depth = np.full(x.shape, np.inf, np.float32)
    for wall in walls:
        (right, ahead), (along_x, along_z) = wall.start.tolist(), (wall.end - wall.start).tolist()
        slope = along_z * x - along_x * z
        scale = (along_z * right - along_x * ahead) / np.where(np.abs(slope) < _NEAREST, _NEAREST, slope)
        length = along_x**2 + along_z**2
        at = (x * scale - right) * (along_x / length) + (z * scale - ahead) * (along_z / length)
        down = (y * scale - 1) / wall.height + 1
        seen = (scale > 0) & (scale < depth) & (at >= 0) & (at <= 1) & (down >= 0) & (down <= 1)
        if seen.any():
            _paste(picture, wall.texture, at, down, seen)
            depth[seen] = scale[seen]


def _paste(picture: np.ndarray, texture: np.ndarray, at: np.ndarray, down: np.ndarray, seen: np.ndarray) -> None:
    """Draws a texture, at [n, n] and down [n, n] shares of its width and height, where it is seen."""
    part = tuple(slice(int(line.min()), int(line.max()) + 1) for line in np.nonzero(seen))
    rows, columns = texture.shape[:2]
    where = (at[part] * columns - 0.5).astype(np.float32), (down[part] * rows - 0.5).astype(np.float32)
    colours = cv2.remap(texture, *where, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    picture[part] = np.where(seen[part][..., None], colours, picture[part])
