"""Upright previews for the screen, and conversion of positions to and from them.

Positions for the page are shares of the upright picture's width and height, with (0, 0) at the top left corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from unshutter.orientation import Orientation, ScanDirection
from unshutter.page.opened import OpenFile, put
from unshutter.photo import Photo
from unshutter.photo.libvips import as_image, refusing
from unshutter.photo.photo import open_photo

# readout directions in the stored picture as (right, down), by quarter turns; names of those in the upright picture
_READ = ((0, 1), (-1, 0), (0, -1), (1, 0))
_ARROWS = {(0, 1): "down", (0, -1): "up", (1, 0): "right", (-1, 0): "left"}


def opened(open_file: OpenFile) -> Photo:
    """Opens the photo without decoding its pixels."""
    return open_photo(open_file.path, open_file.max_pixels)


def small_copy(open_file: OpenFile, photo: Photo, longest: int | None) -> np.ndarray:
    """Returns a copy of the stored pixels whose longer side is at most ``longest`` px, and caches it unless None."""
    if longest is None:
        return photo.screen_copy()
    file = open_file.path.with_name(f"copy-{longest}.npy")
    if file.exists():
        return np.load(file, mmap_mode="r")
    pixels = photo.screen_copy(longest)
    put(file, lambda part: np.save(part, pixels))
    return pixels


def as_jpeg(pixels: np.ndarray, orientation: int = 1) -> bytes:
    """Encodes stored pixels as an upright JPEG for the screen."""
    with refusing("cannot encode the copy for the screen"):
        return as_image(Orientation(orientation).upright(pixels)).jpegsave_buffer(Q=88, keep=0)


def shares(col: ArrayLike, row: ArrayLike, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts stored positions ([N] each, pixel centres at whole numbers) to [N, 2] shares of the upright picture.

    ``size`` is width and height of the stored picture [px].
    """
    across = (np.asarray(col) + 0.5) / size[0]
    down = (np.asarray(row) + 0.5) / size[1]
    return np.stack(Orientation(orientation).upright_point(across, down), axis=-1)


def pixels_of(across: ArrayLike, down: ArrayLike, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts shares ([N] each) of the upright picture to [N, 2] stored positions; inverts :func:`shares`."""
    across, down = Orientation(orientation).stored_point(np.asarray(across), np.asarray(down))
    return np.stack([across * size[0] - 0.5, down * size[1] - 0.5], axis=-1)


def corners_of(window: tuple[float, float, float, float], orientation: int) -> list[float]:
    """Converts a window (left, top, right, bottom) from shares of the stored picture to shares of the upright one."""
    left, top, right, bottom = window
    across, down = Orientation(orientation).upright_point(np.array([left, right]), np.array([top, bottom]))
    return [float(across.min()), float(down.min()), float(across.max()), float(down.max())]


def arrows(orientation: int) -> dict[str, str]:
    """Maps each readout direction to its direction in the upright picture: up, down, left or right."""
    upright = Orientation(orientation).upright_direction
    return {
        str(scan_direction): _ARROWS[upright(*_READ[scan_direction.quarter_turns])] for scan_direction in ScanDirection
    }
