"""Draws the textures of walls: brick, panels or plaster with windows. No photos are involved."""

from __future__ import annotations

import cv2
import numpy as np

TEXTURE = 640  # px of a wall's texture


def draw_wall(dice: np.random.Generator, aspect: float, grid: tuple[int, int] | None = None) -> np.ndarray:
    """Returns a [TEXTURE, TEXTURE, 3] float32 texture of a wall whose height is ``aspect`` times its width.

    ``grid`` is its number of storeys and of windows in each, if known.
    """
    colour = dice.uniform(50, 230) + dice.uniform(-35, 35, 3)
    wall = np.full((TEXTURE, TEXTURE, 3), colour, np.float32)
    wall *= 1 + dice.uniform(0, 0.25) * clouds(dice, TEXTURE)[..., None]
    _joints(dice, wall)
    columns = int(dice.integers(2, 9))
    floors = max(1, round(columns * aspect * dice.uniform(0.6, 1.2)))
    _windows(dice, wall, *(grid or (min(floors, 12), columns)))
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


def clouds(dice: np.random.Generator, side: int) -> np.ndarray:
    """Returns [side, side] smooth noise of about -1 ... 1."""
    coarse = dice.uniform(-1, 1, (int(dice.integers(3, 30)), int(dice.integers(3, 30)))).astype(np.float32)
    return cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
