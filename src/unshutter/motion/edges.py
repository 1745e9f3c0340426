"""The edges of a rectified picture, where the original shows nothing: how they are handled, and the best crop.

One policy serves photos, frames with neighbours, clips and the page's preview. A crop is searched for in cells: first
coarse ones, then ones that are a pixel wide where the sides of the coarse result lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.grid import SamplingGrid, Tile
from unshutter.motion.shapes import Bool
from unshutter.options import Edges

HAIRLINE = 1.0  # px that may be missing at an edge without becoming black
LEAST_CROP = 0.1  # share of a picture's area: a smaller crop is refused

Size: TypeAlias = tuple[int, int]  # height and width [px]


class EdgeDecision(NamedTuple):
    """The decision on how to handle the edges of a rectified picture."""

    edges: Edges  # ``keep``, ``crop``, ``fill`` or ``borrow``, never ``auto``
    window: Tile  # the part of the picture that is kept
    area_left: float | None = None  # share of the picture's area that a crop leaves; None if no crop was computed


@dataclass(frozen=True)
class EdgePolicy:
    """A user's choice of edges, and the resulting decision for a picture."""

    # ``keep`` leaves areas that the picture does not show black, ``fill`` mirrors the picture at its border,
    # ``borrow`` takes them from neighbouring frames, ``crop`` cuts them away, ``auto`` borrows what it can and crops
    edges: Edges

    @property
    def may_crop(self) -> bool:
        """Whether the decision depends on how much a crop would leave."""
        return self.edges in ("crop", "auto")

    @property
    def must_crop(self) -> bool:
        """Whether missing areas are cut away, however much that takes."""
        return self.edges == "crop"

    @property
    def borrows(self) -> bool:
        """Whether neighbouring frames are needed for the missing areas, whatever these are."""
        return self.edges == "borrow"

    @property
    def black_beyond(self) -> float | None:
        """Distance outside the picture [px] from which pixels are black; up to there, the border is repeated.

        None: the picture is mirrored at its border. Less than :data:`HAIRLINE` outside, no edge gets a black hairline.
        """
        return {"keep": HAIRLINE, "fill": None}.get(self.edges, math.inf)

    def decide(self, size: Size, largest_crop: Callable[[], Tile], subject: str = "photo") -> EdgeDecision:
        """Decides how to handle the edges of a picture, which is called ``subject`` in messages.

        ``largest_crop`` finds the largest window that the original shows entirely, if a crop is possible. Where that
        is less than :data:`LEAST_CROP` of the area, ``crop`` is refused, and ``auto`` keeps the whole picture.
        """
        whole = Tile(0, size[0], 0, size[1])
        if not self.may_crop:
            return EdgeDecision(self.edges, whole)
        window = largest_crop()
        share = window.area / whole.area
        if share >= LEAST_CROP:
            return EdgeDecision("crop", window, share)
        if self.must_crop:
            percent = 100 * share
            raise UnshutterError(
                f"cropping would leave {percent:.0f} % of the {subject}: use other edges, keep or fill"
            )
        return EdgeDecision("keep", whole, share)

    def without_motion(self, size: Size) -> EdgeDecision:
        """Returns the decision for an unchanged picture, which has no missing areas."""
        return EdgeDecision("keep" if self.edges == "auto" else self.edges, Tile(0, size[0], 0, size[1]))


# ---- the largest rectangle -------------------------------------------------------------------------------------

# borders of rows and of columns [px] -> which cells between them the original shows entirely
_SeenBetween = Callable[[np.ndarray, np.ndarray], Bool[np.ndarray, "rows cols"]]


def crop_window(grid: SamplingGrid, beyond: float = 0.0) -> Tile:
    """Finds the window to which a photo is cropped: a large upright rectangle whose pixels all sample the photo.

    It is the largest one of any shape, or the largest one of the photo's aspect ratio if that costs less than 3 % of
    the photo's area.

    Args:
        beyond: positions less than this far outside the photo count as inside [px].
    """

    def seen(rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
        # positions vary smoothly: a small cell is inside if its four corners are
        corners = grid.inside(*grid.at(_first_and_last(rows), _first_and_last(cols)), beyond=beyond)
        sides = corners[0::2] & corners[1::2]
        return sides[:, 0::2] & sides[:, 1::2]  # all(axis=...) takes thirty times as long

    return _Search(seen, grid.height, grid.width).best()


def valid_window(mask: Bool[np.ndarray, "height width"], any_shape: bool = False) -> Tile:
    """Finds the largest upright rectangle of True pixels with the mask's aspect ratio; empty if no pixel is True.

    Args:
        any_shape: whether it may have another aspect ratio, if that leaves 3 % of the area more.
    """

    def seen(rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
        across = np.minimum.reduceat(np.ascontiguousarray(mask).view(np.uint8), rows[:-1], axis=0)
        return np.minimum.reduceat(across, cols[:-1], axis=1).view(bool)

    search = _Search(seen, *mask.shape)
    return search.best() if any_shape else search.shaped()


def _first_and_last(borders: np.ndarray) -> np.ndarray:
    """Returns [2 * cells] first and last row (or column) of every cell, in order."""
    return np.stack([borders[:-1], borders[1:] - 1], axis=1).ravel()


@dataclass(frozen=True)
class _Search:
    """A search for rectangles of what the original shows in a picture of height x width [px]."""

    seen: _SeenBetween
    height: int
    width: int

    def best(self) -> Tile:
        """Returns the largest rectangle, or the largest one of the picture's shape if that is nearly as large."""
        coarse = self._coarse()
        if coarse.seen.all():
            return Tile(0, self.height, 0, self.width)
        free = self._refined(coarse, coarse.largest()).largest()
        shaped = self._refined(coarse, coarse.largest_shaped()).largest_shaped()
        # to keep the picture's aspect ratio, so much of its area may be lost
        return shaped if free.area - shaped.area < 0.03 * self.height * self.width else free

    def shaped(self) -> Tile:
        """Returns the largest rectangle of the picture's shape."""
        coarse = self._coarse()
        return self._refined(coarse, coarse.largest_shaped()).largest_shaped()

    @property
    def _block(self) -> int:
        """Side [px] of coarse cells."""
        return int(np.ceil(np.sqrt(self.height * self.width / 40_000)))

    def _coarse(self) -> _Cells:
        return self._cells(*(np.append(np.arange(0, size, self._block), size) for size in (self.height, self.width)))

    def _refined(self, coarse: _Cells, near: Tile) -> _Cells:
        """Returns cells that are a pixel wide near the sides of a rectangle."""
        if self._block == 1 or near.area == 0:
            return coarse
        reach = 2 * self._block
        sides = ((near.top, near.bottom), (near.left, near.right))
        borders = []
        for known, (begin, end) in zip((coarse.rows, coarse.cols), sides, strict=True):
            fine = np.concatenate([np.arange(side - reach, side + reach + 1) for side in (begin, end)])
            borders.append(np.union1d(known, fine[(fine > 0) & (fine < known[-1])]))
        return self._cells(*borders)

    def _cells(self, rows: np.ndarray, cols: np.ndarray) -> _Cells:
        return _Cells(rows, cols, self.seen(rows, cols))


@dataclass(frozen=True)
class _Cells:
    """A picture divided into cells, and which of them the original shows entirely."""

    rows: np.ndarray  # [R + 1] borders of the rows of cells [px]
    cols: np.ndarray  # [C + 1] borders of the columns of cells [px]
    seen: np.ndarray  # [R, C] bool

    def largest(self) -> Tile:
        """Returns the largest rectangle of cells that are seen; empty if none is.

        Dynamic programming down the rows: above each cell, the column of seen cells that ends with it, and how far
        this column can be widened to the left and to the right.
        """
        width = int(self.cols[-1])
        height = np.zeros(len(self.cols) - 1, int)
        left = np.zeros_like(height)
        right = np.full_like(height, width)
        best = Tile(0, 0, 0, 0)
        tall = np.diff(self.rows).tolist()
        from_left = np.maximum.accumulate(np.where(self.seen, 0, self.cols[1:]), axis=1)
        from_right = np.minimum.accumulate(np.where(self.seen, width, self.cols[:-1])[:, ::-1], axis=1)[:, ::-1]
        for row, seen in enumerate(self.seen):
            height = (height + tall[row]) * seen
            left = np.maximum(left * seen, from_left[row] * seen)
            right = np.minimum(np.where(seen, right, width), np.where(seen, from_right[row], width))
            area = (right - left) * height
            at = int(area.argmax())
            if area[at] > best.area:
                bottom = int(self.rows[row + 1])
                best = Tile(bottom - int(height[at]), bottom, int(left[at]), int(right[at]))
        return best

    def largest_shaped(self) -> Tile:
        """Returns the largest rectangle of the picture's aspect ratio, nearest to the centre; empty if none fits."""
        height, width = int(self.rows[-1]), int(self.cols[-1])
        unseen = np.pad((~self.seen).astype(np.int32).cumsum(0, np.int32).cumsum(1, np.int32), ((1, 0), (1, 0)))

        def size_at(long: int) -> tuple[int, int]:
            if width >= height:
                return max(round(long * height / width), 1), long
            return long, max(round(long * width / height), 1)

        def fits_at(long: int) -> np.ndarray:  # [N, 2] top and left at which such a rectangle fits
            tall, wide = size_at(long)
            ends = [np.searchsorted(at, at + side) for at, side in ((self.rows, tall), (self.cols, wide))]
            rows, cols = (np.searchsorted(end, len(end)) for end in ends)  # those that do not reach beyond the picture
            low, right = ends[0][:rows], ends[1][:cols]
            count = unseen[low][:, right] - unseen[low, :cols] - unseen[:rows][:, right] + unseen[:rows, :cols]
            found = np.argwhere(count == 0)
            return np.stack([self.rows[found[:, 0]], self.cols[found[:, 1]]], axis=1)

        # a rectangle that fits contains every smaller one
        fits = 0
        too_long = max(height, width) + 1
        while too_long - fits > 1:
            middle = (fits + too_long) // 2
            fits, too_long = (middle, too_long) if len(fits_at(middle)) else (fits, middle)
        if fits == 0:
            return Tile(0, 0, 0, 0)
        tall, wide = size_at(fits)
        places = fits_at(fits)
        from_centre = (places[:, 0] + tall / 2 - height / 2) ** 2 + (places[:, 1] + wide / 2 - width / 2) ** 2
        top, left = places[from_centre.argmin()].tolist()
        return Tile(top, top + tall, left, left + wide)
