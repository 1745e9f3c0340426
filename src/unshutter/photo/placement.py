"""Where a new picture shows what a photo shows, for metadata that state places in the photo.

Metadata state places in pixels or as fractions of the picture's sides, in the stored picture or as it is displayed.
Here they are fractions of the sides, from the upper left corner. A place that cannot be moved is None: it lies outside
the new picture, or nobody knows where.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

from unshutter.orientation import Orientation

# fractions across and down the photo -> those across and down the new picture
Position: TypeAlias = "Callable[[Sequence[float], Sequence[float]], tuple[Sequence[float], Sequence[float]]]"
_SAME_SHAPE = 0.02  # largest relative difference of aspect ratios of the same picture at different sizes


class Box(NamedTuple):
    """An upright rectangle, in fractions of the picture's sides."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True)
class Placement:
    """Where a new picture shows what a photo shows."""

    size: tuple[int, int]  # height and width of the photo [px]
    new_size: tuple[int, int]  # height and width of the new picture [px]
    position: Position | None = None  # None: unknown
    corner: tuple[int, int] = (0, 0)  # row and column of the photo's frame at which the new picture begins [px]
    orientation: Orientation = Orientation.NORMAL  # of both as they are stored
    scale: float = 1.0  # pixels of the photo per pixel of ``size``, where that is what metadata state

    def points(self, across: Sequence[float], down: Sequence[float]) -> list[tuple[float, float]] | None:
        """Moves points; None if the position of one is unknown."""
        if self.position is None:
            return None
        moved = [(float(x), float(y)) for x, y in zip(*self.position(across, down), strict=True)]
        return moved if all(map(math.isfinite, (number for point in moved for number in point))) else None

    def point(self, across: float, down: float) -> tuple[float, float] | None:
        """Moves a point."""
        moved = self.points([across], [down])
        return moved[0] if moved and all(0 <= number <= 1 for number in moved[0]) else None

    def box(self, box: Box) -> Box | None:
        """Returns the box of the moved corners of a box, as far as it lies inside the new picture."""
        corners = self.points([box.left, box.right] * 2, [box.top] * 2 + [box.bottom] * 2)
        if corners is None:
            return None
        across, down = ([min(max(number, 0.0), 1.0) for number in side] for side in zip(*corners, strict=True))
        moved = Box(min(across), min(down), max(across), max(down))
        return moved if moved.left < moved.right and moved.top < moved.bottom else None

    def framed(self, height: float, width: float) -> Placement | None:
        """Returns the placement for a photo whose metadata state its size [px], stored or as displayed.

        Its ``size`` is the stated one; None if that is the size of another picture.
        """
        stated = round(height), round(width)
        if min(stated) < 1:
            return None
        if _is_same_shape(stated, self.size):
            return replace(self, size=stated, scale=self.size[1] / stated[1])
        if self.orientation.quarter_turns % 2 and _is_same_shape(stated, self.size[::-1]):
            return replace(self.displayed, size=stated, scale=self.size[0] / stated[1])
        return None

    @property
    def displayed(self) -> Placement:
        """The placement in the pictures as viewers display them."""
        orientation = self.orientation
        position = self.position

        def turned(across: Sequence[float], down: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
            assert position is not None
            stored = [orientation.stored_point(*point) for point in zip(across, down, strict=True)]
            moved = zip(*position([x for x, _ in stored], [y for _, y in stored]), strict=True)
            shown = [orientation.upright_point(*point) for point in moved]
            return [x for x, _ in shown], [y for _, y in shown]

        return Placement(
            orientation.size(*self.size),
            orientation.size(*self.new_size),
            None if position is None else turned,
        )


def _is_same_shape(one: Sequence[float], other: Sequence[float]) -> bool:
    return abs(one[0] * other[1] / (one[1] * other[0]) - 1) <= _SAME_SHAPE
