"""Draws street corners: walls of brick, panels or plaster with windows, seen in perspective. No photos are involved."""

from __future__ import annotations

import cv2
import numpy as np

from unshutter_lab.synthesis.walls import TEXTURE, clouds, draw_wall

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
