"""Small upright JPEGs for the screen, and positions in them.

Positions for the page are shares of the upright picture's width and height, with (0, 0) at the top left corner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from unshutter.geometry.readout import Orientation, Readout
from unshutter.photo import Photo
from unshutter.photo.libvips import as_image, refusing
from unshutter.serve.jobs.cache import OpenFile, put

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np


_QUALITY = 88

# Readout directions in the stored picture as (right, down), and names of directions in the upright picture.
_READ = {
    Readout.TOP_TO_BOTTOM: (0, 1),
    Readout.BOTTOM_TO_TOP: (0, -1),
    Readout.LEFT_TO_RIGHT: (1, 0),
    Readout.RIGHT_TO_LEFT: (-1, 0),
}
_ARROWS = {(0, 1): "down", (0, -1): "up", (1, 0): "right", (-1, 0): "left"}


def small_copy(open_file: OpenFile, photo: Photo, longest: int | None) -> np.ndarray:
    """Returns a copy of the stored pixels whose longer side is at most ``longest`` px, and caches it.

    Args:
        open_file: the photo's file.
        photo: the opened photo.
        longest: longer side [px], or None for full size, which is not cached.
    """
    import numpy as np

    if longest is None:
        return photo.screen_copy()
    file = open_file.path.with_name(f"copy-{longest}.npy")
    if file.exists():
        return np.load(file, mmap_mode="r")
    pixels = photo.screen_copy(longest)

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.save(stream, pixels)

    put(file, write)
    return pixels


def as_jpeg(pixels: np.ndarray, orientation: int = 1) -> bytes:
    """Encodes stored pixels as an upright JPEG for the screen."""
    with refusing("cannot encode the copy for the screen"):
        return as_image(Orientation(orientation).upright(pixels)).jpegsave_buffer(Q=_QUALITY, keep=0)


def shares(col: Any, row: Any, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts stored pixel positions to [N, 2] shares (across, down) of the upright picture.

    Args:
        col, row: [N] positions, with pixel centres at whole numbers.
        size: width and height of the stored picture [px].
        orientation: EXIF orientation.
    """
    import numpy as np

    across, down = (np.asarray(col) + 0.5) / size[0], (np.asarray(row) + 0.5) / size[1]
    return np.stack(Orientation(orientation).upright_point(across, down), axis=-1)


def pixels_of(across: Any, down: Any, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts shares of the upright picture to [N, 2] stored pixel positions (col, row); inverts :func:`shares`.

    Args:
        across, down: [N] shares.
        size: width and height of the stored picture [px].
        orientation: EXIF orientation.
    """
    import numpy as np

    across, down = Orientation(orientation).stored_point(np.asarray(across), np.asarray(down))
    return np.stack([across * size[0] - 0.5, down * size[1] - 0.5], axis=-1)


def corners_of(window: tuple[float, float, float, float], orientation: int) -> list[float]:
    """Converts a window (left, top, right, bottom) from shares of the stored picture to shares of the upright one."""
    import numpy as np

    left, top, right, bottom = window
    across, down = Orientation(orientation).upright_point(np.array([left, right]), np.array([top, bottom]))
    return [float(across.min()), float(down.min()), float(across.max()), float(down.max())]


def arrows(orientation: int) -> dict[str, str]:
    """Maps each readout direction to its direction in the upright picture: up, down, left or right."""
    upright = Orientation(orientation).upright_direction
    return {str(readout): _ARROWS[upright(*direction)] for readout, direction in _READ.items()}
