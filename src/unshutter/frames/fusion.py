"""Several frames into one picture of one moment.

Each frame is warped to the moment. Where they agree, they are averaged, the nearer in time counting more; where they do
not, because one shows what the other hides, the nearest one alone is taken: no ghosts.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
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
        pixels: uint8 or uint16 [H, W, bands]; what the frame did not see is mirrored at its border.
        grid: where each pixel was looked up.
        frame: when its first row was exposed [frame intervals after that of frame 0].
    """

    pixels: UInt[np.ndarray, "height width bands"]
    grid: SamplingGrid
    frame: float


def fuse(
    own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> tuple[UInt[np.ndarray, "height width bands"], Bool[np.ndarray, "height width"]]:
    """The picture of a moment, written into ``own.pixels``.

    Args:
        own: the frame that the picture is of.
        others: its neighbours.
        timing: the clock of the frames.
        moment: of the picture.
        borrow: whether what ``own`` did not see is taken from the others; else it is left unchanged.

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
    """Writes a tile into ``own.pixels``; returns which of its pixels were seen.

    Frames are taken in one after the other: where one differs from what there is, whichever is farther from the moment
    loses its weight.
    """
    at = tile.within(own.grid.whole)
    visible, most = _visibility_and_weight(own, tile, timing, moment)
    valid, mixed, total = visible, np.ascontiguousarray(own.pixels[at]), most
    for other in others:
        theirs = np.ascontiguousarray(other.pixels[at])
        visible_there, weight = _visibility_and_weight(other, tile, timing, moment)
        agreement = _agreement(mixed, theirs)
        nearer = weight > most
        total = np.where(nearer, total * agreement, total)
        share = np.where(nearer, weight, weight * agreement)
        mixed = _mixed(mixed, theirs, total, share)
        total, most = total + share, np.maximum(most, weight)
        valid = valid | visible_there if borrow else valid
    np.copyto(own.pixels[at], mixed, where=True if valid.all() else valid[..., None])  # a mask takes ten times as long
    return valid


def _visibility_and_weight(
    warped: Warped, tile: Tile, timing: Timing, moment: float
) -> tuple[Bool[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]:
    """Which pixels a frame saw; and its weight there: the more, the nearer to the moment it saw them."""
    column, row = warped.grid.positions(tile)
    visible = warped.grid.inside(column, row)
    away = cv2.absdiff(row * np.float32(timing.per_row), np.full_like(row, moment - timing.start(warped.frame)))
    return visible, cv2.pow(np.maximum(away, np.float32(_NEAREST)), -_FALL) * visible


def _agreement(first: np.ndarray, second: np.ndarray) -> Float32[np.ndarray, "rows cols"]:
    """1 where two pictures are alike, 0 where they are not."""
    difference = reduce(cv2.max, cv2.split(cv2.absdiff(first, second))).astype(np.float32)  # largest of the bands
    scale = 255 / np.iinfo(first.dtype).max / _AGREEING
    return cv2.exp(-((cv2.blur(difference, (3, 3)) * scale) ** 2))


def _mixed(first: np.ndarray, second: np.ndarray, weight: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Two pictures averaged with weights; black where both are 0."""
    if first.dtype == np.uint8:
        return cv2.blendLinear(first, second, weight, share).reshape(first.shape)
    mixed = cv2.blendLinear(first.astype(np.float32), second.astype(np.float32), weight, share)
    return np.rint(mixed).astype(first.dtype).reshape(first.shape)
