"""Fuses several frames into one picture of a single moment.

Each frame is warped to that moment. Where the frames agree, they are averaged, with more weight for those nearer in
time; where they disagree because one shows what another hides, only the nearest one is used. This avoids ghosts.
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

_AGREEING = 60.0  # grey levels of 8 bits at which a frame's weight falls to 1 / e
_NEAREST = 0.02  # frame intervals: weights do not increase further below this
_FALL = 0.7  # exponent of the distance in time


@dataclass(frozen=True)
class Warped:
    """A frame warped to the time of the picture.

    Attributes:
        pixels: uint8 or uint16 [H, W, bands]; content outside the frame is mirrored at its border.
        grid: position at which each pixel was sampled.
        frame: time of its first row [frame intervals after that of frame 0].
    """

    pixels: UInt[np.ndarray, "height width bands"]
    grid: SamplingGrid
    frame: float


def fuse(
    own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> tuple[UInt[np.ndarray, "height width bands"], Bool[np.ndarray, "height width"]]:
    """Fuses frames into the picture of a moment, written into ``own.pixels``.

    Args:
        own: the frame to which the picture belongs.
        others: its neighbours.
        timing: the clock of the frames.
        moment: time of the picture.
        borrow: whether content that ``own`` does not show is taken from the others; otherwise left unchanged.

    Returns:
        The pixels, and a mask of those shown by any frame (``borrow``) or by ``own``.
    """
    height, width = own.pixels.shape[:2]
    valid = np.empty((height, width), bool)

    def make(tile: Tile) -> None:
        at = tile.within(own.grid.whole)
        valid[at] = _fuse_tile(tile, own, others, timing, moment, borrow)

    with ThreadPoolExecutor(thread_count()) as threads:
        for _ in threads.map(make, own.grid.whole.tiles()):
            pass  # re-raises errors of the threads
    return own.pixels, valid


def _fuse_tile(
    tile: Tile, own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> np.ndarray:
    """Writes a tile into ``own.pixels`` and returns the mask of pixels that were seen.

    Frames are added one by one: where one differs from the current result, whichever is farther from the moment loses
    its weight.
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
    """Returns which pixels a frame shows, and its weight there, which grows as their time approaches the moment."""
    column, row = warped.grid.positions(tile)
    visible = warped.grid.inside(column, row)
    away = cv2.absdiff(row * np.float32(timing.per_row), np.full_like(row, moment - timing.start(warped.frame)))
    return visible, cv2.pow(np.maximum(away, np.float32(_NEAREST)), -_FALL) * visible


def _agreement(first: np.ndarray, second: np.ndarray) -> Float32[np.ndarray, "rows cols"]:
    """Returns 1 where two pictures are alike and 0 where they differ, with a smooth transition."""
    difference = reduce(cv2.max, cv2.split(cv2.absdiff(first, second))).astype(np.float32)  # largest of the bands
    scale = 255 / np.iinfo(first.dtype).max / _AGREEING
    return cv2.exp(-((cv2.blur(difference, (3, 3)) * scale) ** 2))


def _mixed(first: np.ndarray, second: np.ndarray, weight: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Returns the weighted average of two pictures; black where both weights are 0."""
    if first.dtype == np.uint8:
        return cv2.blendLinear(first, second, weight, share).reshape(first.shape)
    mixed = cv2.blendLinear(first.astype(np.float32), second.astype(np.float32), weight, share)
    return np.rint(mixed).astype(first.dtype).reshape(first.shape)
