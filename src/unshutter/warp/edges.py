"""The policy of edges: what is done about the parts of a rectified picture that the original does not show.

Photos, frames with neighbours, clips and the page's preview all decide by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from unshutter.errors import CropTooSmallError
from unshutter.options import Edges
from unshutter.warp.grid import Tile

LEAST_CROP = 0.1  # of a picture's area: a smaller crop is refused
LEAST_AUTO_CROP = 0.8  # of a picture's area: automatic edges do not crop away more than a fifth

Size: TypeAlias = tuple[int, int]  # height and width [px]


class EdgeDecision(NamedTuple):
    """What is done about the edges of a rectified picture.

    Attributes:
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``, never ``auto``.
        window: the part of the picture that is left.
        whole: share of the picture's area that a crop leaves; None where no crop was looked for.
    """

    edges: Edges
    window: Tile
    whole: float | None = None


@dataclass(frozen=True)
class EdgePolicy:
    """A user's choice of edges, and the decision that follows from it for a picture.

    Attributes:
        edges: ``keep`` leaves what the picture does not show black, ``fill`` repeats the border, ``borrow`` takes it
            from neighbouring frames, ``crop`` cuts it away, and ``auto`` crops where that leaves at least
            :data:`LEAST_AUTO_CROP` of the area, else keeps.
    """

    edges: Edges

    @property
    def may_crop(self) -> bool:
        """Whether the decision depends on what a crop would leave."""
        return self.edges in ("crop", "auto")

    def decide(self, size: Size, largest_crop: Callable[[], Tile], subject: str = "photo") -> EdgeDecision:
        """What is done about the edges of a picture.

        Args:
            size: height and width of the picture.
            largest_crop: finds the largest window that the original shows wholly; called only where a crop is possible.
            subject: what the picture is called in a message.

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
        """The decision for a picture that is not changed and so has no edges."""
        return EdgeDecision("keep" if self.edges == "auto" else self.edges, Tile(0, size[0], 0, size[1]))
