"""Several frames into one picture of one moment.

Each frame is warped to the moment. Where they agree, they are averaged, the nearer in time counting more; where they do
not, because one shows what the other hides, the nearest one alone is taken: no ghosts.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.warp.grid import SamplingGrid, Tile
from unshutter.warp.pixels import thread_count

if TYPE_CHECKING:
    from unshutter.frames.timing import Timing
    from unshutter.geometry.shapes import Bool, Float32, UInt

_AGREEING = 60.0  # grey levels of 8 bits at which a frame counts 1 / e of its share
_NEAREST = 0.02  # frame intervals: nearer than that, no frame counts more
_FALL = 0.7  # exponent of the time to the moment


@dataclass(frozen=True)
class Warped:
    """A frame warped to the moment of the picture.

    Attributes:
        pixels: uint8 or uint16 [H, W, bands]; what the frame did not see repeats its border.
        grid: where each pixel was looked up.
        frame: its number.
    """

    pixels: UInt[np.ndarray, "height width bands"]
    grid: SamplingGrid
    frame: int


def fuse(
    own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> tuple[UInt[np.ndarray, "height width bands"], Bool[np.ndarray, "height width"]]:
    """The picture of a moment, written into ``own.pixels``.

    Args:
        own: the frame that the picture is of.
        others: its neighbours.
        timing: the clock of the frames.
        moment: of the picture.
        borrow: whether what ``own`` did not see is taken from the others; else it stays as it is.

    Returns:
        The pixels, and which of them some frame saw (``borrow``) or ``own`` did.
    """
    height, width = own.pixels.shape[:2]
    valid = np.empty((height, width), bool)

    def make(tile: Tile) -> None:
        at = tile.within(own.grid.whole)
        valid[at] = _fuse_tile(tile, own, others, timing, moment, borrow)

    with ThreadPoolExecutor(thread_count()) as threads:
        for _ in threads.map(make, own.grid.whole.tiles()):
            pass  # errors come out here
    return own.pixels, valid


def _fuse_tile(
    tile: Tile, own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> np.ndarray:
    """Writes a tile into ``own.pixels``; returns which of its pixels were seen."""
    at = tile.within(own.grid.whole)
    frames = [own, *others]
    seen = [_seen(frame, tile) for frame in frames]
    weights = [_weight(frame, tile, timing, moment) * saw for frame, saw in zip(frames, seen, strict=True)]
    pictures = [frame.pixels[at].astype(np.float32) for frame in frames]
    nearest, most = pictures[0].copy(), weights[0].copy()
    for picture, weight in zip(pictures[1:], weights[1:], strict=True):
        nearer = weight > most
        nearest[nearer], most[nearer] = picture[nearer], weight[nearer]
    mixed, total = np.zeros_like(nearest), np.zeros_like(most)
    for picture, weight in zip(pictures, weights, strict=True):
        share = weight * _agreement(picture, nearest, np.iinfo(own.pixels.dtype).max)
        mixed += picture * share[..., None]
        total += share
    valid = np.logical_or.reduce(seen) if borrow else seen[0]
    made = mixed / np.maximum(total, 1e-6)[..., None]
    np.copyto(own.pixels[at], np.rint(made).astype(own.pixels.dtype), where=valid[..., None])
    return valid


def _seen(warped: Warped, tile: Tile) -> np.ndarray:
    """bool: which pixels a frame saw."""
    return warped.grid.inside(*warped.grid.positions(tile))


def _weight(warped: Warped, tile: Tile, timing: Timing, moment: float) -> Float32[np.ndarray, "rows cols"]:
    """The more, the nearer to the moment a frame saw what it shows there."""
    _, row = warped.grid.positions(tile)
    away = np.abs(timing.exposed(warped.frame, row) - moment)
    return np.maximum(away, _NEAREST).astype(np.float32) ** -_FALL


def _agreement(mine: np.ndarray, theirs: np.ndarray, top: int) -> np.ndarray:
    """1 where two pictures are alike, 0 where they are not."""
    difference = cv2.blur(np.abs(mine - theirs).max(axis=-1), (3, 3)) * (255 / top)
    return np.exp(-((difference / _AGREEING) ** 2))
