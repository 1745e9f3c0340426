"""Pictures to distort: the photos of a folder, or drawn streets if there are none.

Each is an array [3, h, w], uint8 RGB. Photos are read with OpenCV, so that a training machine does not need libvips.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp"}
_WIDEST = 2.0  # photos are cropped to this aspect, which bounds their memory


def photo_files(folder: Path) -> list[Path]:
    """Returns the photos of a folder and its subfolders, by name."""
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES and not p.name.startswith("."))


def load_photos(folder: Path, short_side: int) -> list[np.ndarray]:
    """Reads all photos of a folder and its subfolders, by name, upright, scaled to the short side.

    Unreadable files are skipped with a warning.

    Returns:
        [3, h, w] each, cropped to an aspect of at most 2:1.
    """
    files = photo_files(folder)
    photos = [photo for file in files if (photo := _load(file, short_side)) is not None]
    if len(photos) < len(files):
        bad = len(files) - len(photos)
        warnings.warn(f"{bad} of {len(files)} files in {folder} cannot be read as photos", stacklevel=2)
    return photos


def _load(file: Path, short_side: int) -> np.ndarray | None:
    import cv2

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
    import cv2

    dice = np.random.default_rng(seed)
    ramp = np.linspace(0, 1, size)[:, None, None]
    sky = dice.uniform(90, 250, 3) * (1 - ramp) + dice.uniform(60, 200, 3) * ramp
    picture = np.repeat(sky, size, axis=1)

    def shape(corners: np.ndarray, colour: np.ndarray) -> None:
        points = np.round(corners * 16).astype(np.int32)  # drawn with 4 binary places
        cv2.fillPoly(picture, [points], tuple(colour.tolist()), lineType=cv2.LINE_AA, shift=4)

    left = -dice.uniform(0, 0.2) * size
    while left < size:
        right = left + dice.uniform(0.15, 0.5) * size
        top, bottom = dice.uniform(0.05, 0.45, 2) * size, dice.uniform(0.8, 1.1, 2) * size  # left and right edge

        def on_facade(across, up, edges=(left, right, top, bottom)):
            a, b, high, low = edges
            upper = high[0] + (high[1] - high[0]) * across
            lower = low[0] + (low[1] - low[0]) * across
            return np.stack([a + (b - a) * across, upper + (lower - upper) * up], -1)

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
