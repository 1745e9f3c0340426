"""Draws street corners: walls of brick, panels or plaster with windows, seen in perspective. No photos are involved."""

from __future__ import annotations

import cv2
import numpy as np

TEXTURE = 640  # px of a wall's texture
_FINER = 2  # pictures are drawn this many times larger, then reduced


def draw_facades(size: int, seed: int) -> np.ndarray:
    """Draws a street corner: sky, ground, one to three textured walls, poles, bushes. [3, size, size] uint8 RGB.

    The camera is level; its walls stand at right angles to each other.
    """
    dice = np.random.default_rng(seed)
    side = size * _FINER
    picture = _sky_and_ground(dice, side)
    focal = side * dice.uniform(0.9, 1.8)
    azimuth = dice.uniform(-0.9, 0.9)
    corner = np.array([dice.uniform(-0.6, 0.6), dice.uniform(2.0, 5.0)])  # right, ahead [camera heights]
    for rotation in dice.permutation(3)[: dice.integers(1, 4)]:
        angle = azimuth + rotation * np.pi / 2
        end = corner + dice.uniform(2, 8) * np.array([np.cos(angle), np.sin(angle)])
        foot = np.array([corner, end])[np.argsort([corner[0], end[0]])]  # left end first
        if foot[:, 1].min() < 0.8:  # too close to the camera
            continue
        height = dice.uniform(1.5, 7)
        ground = [focal * np.array([right, 1.0]) / ahead for right, ahead in foot]
        top = [focal * np.array([right, -height]) / ahead for right, ahead in foot]
        quad = np.array([top[0], top[1], ground[1], ground[0]]) + side / 2
        _hang(picture, draw_wall(dice, height / np.hypot(*(foot[1] - foot[0]))), quad)
    _clutter(dice, picture)
    picture = cv2.resize(picture, (size, size), interpolation=cv2.INTER_AREA)
    picture += dice.uniform(0, 8) * dice.standard_normal(picture.shape)
    return np.ascontiguousarray(np.clip(picture, 0, 255).astype(np.uint8).transpose(2, 0, 1))


def _sky_and_ground(dice: np.random.Generator, side: int) -> np.ndarray:
    """Returns [side, side, 3] float32."""
    ramp = np.linspace(0, 1, side)[:, None, None]
    tint = dice.uniform(-30, 30, 3)
    sky = (dice.uniform(90, 230) + tint) * (1 - ramp) + (dice.uniform(140, 250) - tint / 3) * ramp
    picture = np.repeat(sky, side, axis=1).astype(np.float32)
    picture[side // 2 :] = dice.uniform(40, 160)
    picture[side // 2 :] += 30 * clouds(dice, side)[side // 2 :, :, None]
    return picture


def draw_wall(dice: np.random.Generator, aspect: float) -> np.ndarray:
    """Returns a [TEXTURE, TEXTURE, 3] float32 texture of a wall whose height is ``aspect`` times its width."""
    colour = dice.uniform(50, 230) + dice.uniform(-35, 35, 3)
    wall = np.full((TEXTURE, TEXTURE, 3), colour, np.float32)
    wall *= 1 + dice.uniform(0, 0.25) * clouds(dice, TEXTURE)[..., None]
    _joints(dice, wall)
    columns = int(dice.integers(2, 9))
    floors = max(1, round(columns * aspect * dice.uniform(0.6, 1.2)))
    _windows(dice, wall, min(floors, 12), columns)
    for _ in range(dice.integers(0, 4)):  # cornices
        row = int(dice.uniform(0, 0.95) * TEXTURE)
        wall[row : row + int(dice.integers(3, 14))] *= dice.uniform(0.6, 1.4)
    return wall


def _joints(dice: np.random.Generator, wall: np.ndarray) -> None:
    """Draws bricks or panels: lines between courses, and between the stones of a course."""
    if dice.random() < 0.35:  # plaster
        return
    course = int(dice.integers(6, 50))
    stone = int(course * dice.uniform(1.5, 4))
    offset = stone // 2 if dice.random() < 0.7 else 0
    shade, thick = dice.uniform(0.7, 1.2), int(dice.integers(1, 3))
    for number, row in enumerate(range(0, TEXTURE, course)):
        wall[row : row + thick] *= shade
        for col in range((number % 2) * offset, TEXTURE, stone):
            wall[row : row + course, col : col + thick] *= shade
            wall[row : row + course, col : col + stone] *= dice.uniform(0.93, 1.07)


def _windows(dice: np.random.Generator, wall: np.ndarray, floors: int, columns: int) -> None:
    """Draws a grid of windows with frames and cross-bars; occasionally one is missing or lit."""
    wide, high = TEXTURE // columns, TEXTURE // floors
    gap_col, gap_row = int(wide * dice.uniform(0.12, 0.35)), int(high * dice.uniform(0.12, 0.35))
    glass = dice.uniform(20, 110) + dice.uniform(-15, 15, 3)
    frame = dice.uniform(60, 230) + dice.uniform(-25, 25, 3)
    bar = max(1, int(min(wide, high) * dice.uniform(0.02, 0.08)))
    cross = dice.random() < 0.6
    for floor in range(floors):
        for column in range(columns):
            if dice.random() < 0.06:
                continue
            top, left = floor * high + gap_row, column * wide + gap_col
            bottom, right = (floor + 1) * high - gap_row, (column + 1) * wide - gap_col
            wall[top:bottom, left:right] = frame
            pane = wall[top + bar : bottom - bar, left + bar : right - bar]
            pane[:] = glass * dice.uniform(0.6, 1.6)
            if cross:
                wall[top:bottom, (left + right) // 2 : (left + right) // 2 + bar] = frame
            wall[bottom : bottom + 2 * bar, max(left - bar, 0) : right + bar] *= 0.6  # shadow of the sill


def _hang(picture: np.ndarray, texture: np.ndarray, quad: np.ndarray) -> None:
    """Draws a texture into the quadrilateral [4, 2] (top left, top right, bottom right, bottom left)."""
    last = TEXTURE - 1
    corners = np.array([[0, 0], [last, 0], [last, last], [0, last]], np.float32)
    matrix = cv2.getPerspectiveTransform(corners, quad.astype(np.float32))
    size = picture.shape[1], picture.shape[0]
    cv2.warpPerspective(texture, matrix, size, picture, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)


def _clutter(dice: np.random.Generator, picture: np.ndarray) -> None:
    """Draws poles, wires and bushes."""
    side = len(picture)
    for _ in range(dice.integers(0, 4)):
        col, top = dice.uniform(0, side), dice.uniform(0.1, 0.6) * side
        foot = int(col), int(side * dice.uniform(0.6, 1))
        colour = tuple(dice.uniform(0, 200, 3).tolist())
        cv2.line(picture, (int(col), int(top)), foot, colour, int(dice.integers(1, 8)), cv2.LINE_AA)
    for _ in range(dice.integers(0, 4)):
        start, end = dice.uniform(0, side, (2, 2)).astype(int).tolist()
        cv2.line(picture, start, end, (40.0, 40.0, 40.0), int(dice.integers(1, 3)), cv2.LINE_AA)
    for _ in range(dice.integers(0, 40)):
        middle = int(dice.uniform(0, side)), int(dice.normal(0.6, 0.1) * side)
        axes = int(dice.uniform(2, 30)), int(dice.uniform(2, 30))
        green = tuple((dice.uniform(20, 110) * np.array([0.8, 1.0, 0.5])).tolist())
        cv2.ellipse(picture, middle, axes, dice.uniform(0, 180), 0, 360, green, -1, cv2.LINE_AA)


def clouds(dice: np.random.Generator, side: int) -> np.ndarray:
    """Returns [side, side] smooth noise of about -1 ... 1."""
    coarse = dice.uniform(-1, 1, (int(dice.integers(3, 30)), int(dice.integers(3, 30)))).astype(np.float32)
    return cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
