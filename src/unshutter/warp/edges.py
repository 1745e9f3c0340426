"""Edges of a rectified picture that the original does not show: the policy for handling them, and the largest crop.

Photos, frames with neighbours, clips and the page's preview all use this policy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from unshutter.errors import CropTooSmallError
from unshutter.options import Edges
from unshutter.warp.grid import SamplingGrid, Tile

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Bool

LEAST_CROP = 0.1  # share of a picture's area: a smaller crop is refused
LEAST_AUTO_CROP = 0.8  # share of a picture's area: automatic edges do not crop more than a fifth

Size: TypeAlias = tuple[int, int]  # height and width [px]


class EdgeDecision(NamedTuple):
    """The decision on how to handle the edges of a rectified picture.

    Attributes:
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``, never ``auto``.
        window: the part of the picture that is kept.
        whole: share of the picture's area that a crop leaves; None if no crop was computed.
    """

    edges: Edges
    window: Tile
    whole: float | None = None


@dataclass(frozen=True)
class EdgePolicy:
    """A user's choice of edges, and the resulting decision for a picture.

    Attributes:
        edges: ``keep`` leaves areas that the picture does not show black, ``fill`` mirrors the picture at its border,
            ``borrow`` takes them from neighbouring frames, ``crop`` cuts them away, ``auto`` crops if that leaves at
            least :data:`LEAST_AUTO_CROP` of the area, otherwise keeps.
    """

    edges: Edges

    @property
    def may_crop(self) -> bool:
        """Whether the decision depends on how much a crop would leave."""
        return self.edges in ("crop", "auto")

    def decide(self, size: Size, largest_crop: Callable[[], Tile], subject: str = "photo") -> EdgeDecision:
        """Decides how to handle the edges of a picture.

        Args:
            size: height and width of the picture.
            largest_crop: finds the largest window that the original shows entirely; called only if a crop is possible.
            subject: word for the picture in messages.

        Raises:
            CropTooSmallError: ``crop`` would leave less than :data:`LEAST_CROP` of the area.
        """
        whole = Tile(0, size[0], 0, size[1])
        if not self.may_crop:
            return EdgeDecision(self.edges, whole)
        window = largest_crop()
        share = window.area / whole.area
        if self.edges == "crop" and share < LEAST_CROP:
            raise CropTooSmallError.leaving(share, subject)
        if self.edges == "crop" or share >= LEAST_AUTO_CROP:
            return EdgeDecision("crop", window, share)
        return EdgeDecision("keep", whole, share)

    def without_motion(self, size: Size) -> EdgeDecision:
        """Returns the decision for an unchanged picture, which has no missing areas."""
        return EdgeDecision("keep" if self.edges == "auto" else self.edges, Tile(0, size[0], 0, size[1]))


_SEARCH_CELLS = 250_000


def crop_window(grid: SamplingGrid, beyond: float = 0.0) -> Tile:
    """Finds the largest upright rectangle of the picture's aspect ratio whose pixels all sample the input picture.

    Args:
        grid: positions that the picture samples.
        beyond: positions less than this far outside the input picture count as inside [px].

    Returns:
        The rectangle; empty if there is none.
    """
    block = _block(grid.height, grid.width)
    # positions vary smoothly: a block is inside if its four corners are
    rows, cols = (_first_and_last(size, block) for size in (grid.height, grid.width))
    corners = grid.inside(*grid.at(rows, cols), beyond=beyond)
    if corners.all():
        return grid.whole
    down, across = grid.height // block, grid.width // block  # number of whole blocks
    corners = corners[: 2 * down, : 2 * across]
    rows_inside = corners[0::2] & corners[1::2]
    whole = rows_inside[:, 0::2] & rows_inside[:, 1::2]  # all(axis=...) takes thirty times as long
    left, top, width, height = _largest(whole, block, grid.height, grid.width)
    return Tile(top, top + height, left, left + width)


def valid_window(mask: Bool[np.ndarray, "height width"]) -> Tile:
    """Returns the rectangle of :func:`largest_valid_rectangle` as a tile."""
    left, top, width, height = largest_valid_rectangle(mask)
    return Tile(top, top + height, left, left + width)


def largest_valid_rectangle(mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int, int]:
    """Finds the largest upright rectangle of True pixels with the mask's aspect ratio, nearest to the centre.

    Exact up to a quarter of a million pixels; larger masks are searched in blocks whose pixels are all True,
    which loses a few pixels (at 12 megapixels up to 14 of 4000).

    Args:
        mask: bool [H, W].

    Returns:
        (left, top, width, height) [px]; width and height are 0 if no pixel is True.
    """
    height, width = mask.shape
    if mask.all():
        return 0, 0, width, height
    block = _block(height, width)
    rows, cols = height // block, width // block
    whole = np.asarray(mask[: rows * block, : cols * block].reshape(rows, block, cols, block).all(axis=(1, 3)))
    return _largest(whole, block, height, width)


def _block(height: int, width: int) -> int:
    """Returns the side [px] of the square blocks in which a picture is searched."""
    return int(np.ceil(np.sqrt(height * width / _SEARCH_CELLS)))


def _first_and_last(size: int, block: int) -> np.ndarray:
    """Returns [2 * blocks] first and last row (or column) of every block, in order; the last block may be truncated."""
    first = np.arange(0, size, block)
    return np.stack([first, np.minimum(first + block, size) - 1], axis=1).ravel()


def _largest(whole: np.ndarray, block: int, height: int, width: int) -> tuple[int, int, int, int]:
    """Finds the largest rectangle in a picture of height x width [px], given which blocks [rows, cols] are whole."""
    filled = np.pad(whole.astype(np.int32).cumsum(0, np.int32).cumsum(1, np.int32), ((1, 0), (1, 0)))

    def size_at(blocks_long: int) -> tuple[int, int]:  # px
        if width >= height:
            w = min(blocks_long * block, width)
            return w, max(round(w * height / width), 1)
        h = min(blocks_long * block, height)
        return max(round(h * width / height), 1), h

    def fits_at(blocks_long: int) -> np.ndarray:  # top and left blocks at which such a rectangle fits
        w, h = (-(-side // block) for side in size_at(blocks_long))
        count = filled[h:, w:] - filled[:-h, w:] - filled[h:, :-w] + filled[:-h, :-w]
        return count == h * w

    fits, too_long = 0, max(whole.shape) + 1  # a rectangle that fits contains every smaller one
    while too_long - fits > 1:
        middle = (fits + too_long) // 2
        fits, too_long = (middle, too_long) if fits_at(middle).any() else (fits, middle)
    if fits == 0:
        return 0, 0, 0, 0
    (w, h), places = size_at(fits), np.argwhere(fits_at(fits)) * block
    from_centre = (places[:, 0] + h / 2 - height / 2) ** 2 + (places[:, 1] + w / 2 - width / 2) ** 2
    top, left = places[from_centre.argmin()].tolist()
    return left, top, w, h
