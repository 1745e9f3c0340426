"""The direction in which a sensor reads out its lines, and what that means for stored pixels.

Convention: everything inside the package works in the **readout frame**: the picture turned (never
mirrored) so that the line read first is the top row. Only this file knows how to get there and back.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from unshutter.errors import UsageError
from unshutter.geometry.orientation import Orientation

if TYPE_CHECKING:
    import numpy as np  # not imported above: options are checked while a photo is being decoded


class Readout(StrEnum):
    """Direction in which the lines of the *stored* pixels were read, first to last."""

    TOP_TO_BOTTOM = "top-to-bottom"
    BOTTOM_TO_TOP = "bottom-to-top"
    LEFT_TO_RIGHT = "left-to-right"
    RIGHT_TO_LEFT = "right-to-left"

    @classmethod
    def parse(cls, word: str) -> Readout:
        """Reads a direction; ``auto`` is top-to-bottom, the order in which cameras store what they read.

        Raises:
            UsageError: the word names no direction.
        """
        if word == "auto":
            return cls.TOP_TO_BOTTOM
        try:
            return cls(word)
        except ValueError:
            choices = ", ".join(["auto", *cls])
            raise UsageError(f"unknown readout direction '{word}': choose one of {choices}") from None

    @property
    def quarter_turns(self) -> int:
        """Counter-clockwise quarter turns that bring stored pixels into the readout frame."""
        return {"top-to-bottom": 0, "right-to-left": 1, "bottom-to-top": 2, "left-to-right": 3}[self.value]

    @property
    def sideways(self) -> bool:
        """Whether lines are columns of the stored pixels."""
        return self.quarter_turns % 2 == 1

    def frame_size(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) of the readout frame of stored pixels of that size; its own inverse."""
        return (width, height) if self.sideways else (height, width)

    def turn(self, pixels: np.ndarray) -> np.ndarray:
        """Stored pixels [H, W, ...] -> readout frame."""
        import numpy as np

        return np.rot90(pixels, self.quarter_turns)

    def points_to_frame(self, col, row, height: int, width: int):
        """Stored pixel positions (of a stored picture height x width) -> positions in the readout frame."""
        last_col, last_row = width - 1, height - 1
        return {
            0: lambda: (col, row),
            1: lambda: (row, last_col - col),
            2: lambda: (last_col - col, last_row - row),
            3: lambda: (last_row - row, col),
        }[self.quarter_turns]()

    def points_to_stored(self, col, row, height: int, width: int):
        """Positions in the readout frame -> positions in the stored picture of height x width."""
        last_col, last_row = width - 1, height - 1
        return {
            0: lambda: (col, row),
            1: lambda: (last_col - row, col),
            2: lambda: (last_col - col, last_row - row),
            3: lambda: (row, last_row - col),
        }[self.quarter_turns]()


def scene_up(orientation: int, readout: Readout) -> tuple[int, int]:
    """Unit vector (right, down) that points to the scene's top in the readout frame.

    Args:
        orientation: EXIF orientation 1-8 of the stored pixels; anything else counts as 1.
        readout: readout direction of the stored pixels.
    """
    right, down = Orientation(orientation).scene_up
    for _ in range(readout.quarter_turns):
        right, down = down, -right
    return right, down
