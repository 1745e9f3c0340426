"""Orientation of the stored pixels: the sensor's readout direction, and EXIF's orientation for viewers.

Convention: everything inside the package works in the **readout frame**: the picture rotated (never
mirrored) so that the line read first is the top row. Only this file converts to this frame and back.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

from unshutter.errors import UsageError, shortened

if TYPE_CHECKING:
    import numpy as np


class ScanDirection(StrEnum):
    """Direction in which the lines of the *stored* pixels were read out, first to last."""

    TOP_TO_BOTTOM = "top-to-bottom"
    BOTTOM_TO_TOP = "bottom-to-top"
    LEFT_TO_RIGHT = "left-to-right"
    RIGHT_TO_LEFT = "right-to-left"

    @classmethod
    def parse(cls, word: str) -> ScanDirection:
        """Parses a direction; ``auto`` is top-to-bottom, the order in which cameras store lines.

        Raises:
            UsageError: the word is not a direction.
        """
        if word == "auto":
            return cls.TOP_TO_BOTTOM
        try:
            return cls(word)
        except ValueError:
            choices = ", ".join(["auto", *cls])
            raise UsageError(f"unknown readout direction '{shortened(word)}': choose one of {choices}") from None

    @property
    def quarter_turns(self) -> int:
        """Counter-clockwise quarter turns that rotate stored pixels into the readout frame."""
        return {"top-to-bottom": 0, "right-to-left": 1, "bottom-to-top": 2, "left-to-right": 3}[self.value]

    @property
    def sideways(self) -> bool:
        """Whether readout lines are columns of the stored pixels."""
        return self.quarter_turns % 2 == 1

    def frame_size(self, height: int, width: int) -> tuple[int, int]:
        """Returns (height, width) of the readout frame for stored pixels of that size, or the reverse."""
        return (width, height) if self.sideways else (height, width)

    def to_scan_frame(self, pixels: np.ndarray) -> np.ndarray:
        """Rotates stored pixels [H, W, ...] into the readout frame."""
        return _rotated_pixels(pixels, self.quarter_turns)

    def points_to_frame(self, col, row, height: int, width: int):
        """Converts stored pixel positions (in a stored picture of height x width) to positions in the readout frame."""
        return _rotated(col, row, height, width, self.quarter_turns)

    def points_to_stored(self, col, row, height: int, width: int):
        """Converts positions in the readout frame to positions in the stored picture of height x width."""
        return _rotated(col, row, *self.frame_size(height, width), -self.quarter_turns % 4)


def _rotated_pixels(pixels: np.ndarray, quarter_turns: int) -> np.ndarray:
    """Returns a view of pixels [H, W, ...] rotated counter-clockwise by 0 to 3 quarter turns."""
    if quarter_turns % 2 == 0:
        return pixels[::-1, ::-1] if quarter_turns else pixels[:]
    transposed = pixels.swapaxes(0, 1)
    return transposed[::-1] if quarter_turns == 1 else transposed[:, ::-1]


def _rotated(col, row, height: int, width: int, quarter_turns: int):
    """Rotates positions in a picture of height x width counter-clockwise."""
    if quarter_turns == 0:
        return col, row
    if quarter_turns == 1:
        return row, width - 1 - col
    return (width - 1 - col, height - 1 - row) if quarter_turns == 2 else (height - 1 - row, col)


def scene_up(orientation: int, scan_direction: ScanDirection) -> tuple[int, int]:
    """Returns the unit vector (right, down) that points to the top of the scene in the readout frame.

    The EXIF orientation is that of the stored pixels, 1-8; any other number counts as 1.
    """
    right, down = Orientation(orientation).scene_up
    for _ in range(scan_direction.quarter_turns):
        right, down = down, -right
    return right, down


# (quarter turns clockwise, whether mirrored left to right before) that a viewer applies to stored pixels.
_STEPS = {
    **{1: (0, False), 6: (1, False), 3: (2, False), 8: (3, False)},
    **{2: (0, True), 7: (1, True), 4: (2, True), 5: (3, True)},
}


class Orientation(IntEnum):
    """The transformation that a viewer applies to stored pixels, with EXIF's values. Other numbers count as 1."""

    NORMAL = 1
    FLIP_LEFT_RIGHT = 2
    ROTATE_180 = 3
    FLIP_TOP_BOTTOM = 4
    TRANSPOSE = 5
    ROTATE_CLOCKWISE = 6
    TRANSVERSE = 7
    ROTATE_COUNTERCLOCKWISE = 8

    @classmethod
    def _missing_(cls, value: object) -> Orientation | None:
        return cls.NORMAL if isinstance(value, int) else None

    @classmethod
    def of_steps(cls, quarter_turns: int, mirrored: bool = False) -> Orientation:
        """Returns the orientation that optionally mirrors left to right, then makes some quarter turns clockwise."""
        return next(cls(value) for value, steps in _STEPS.items() if steps == (quarter_turns % 4, mirrored))

    @property
    def quarter_turns(self) -> int:
        """Quarter turns clockwise, 0 to 3, made after mirroring."""
        return _STEPS[self][0]

    @property
    def mirrored(self) -> bool:
        """Whether the stored pixels are mirrored left to right before they are rotated."""
        return _STEPS[self][1]

    def then(self, other: Orientation) -> Orientation:
        """Returns the single orientation equivalent to this one followed by the other one."""
        rotations = -self.quarter_turns if other.mirrored else self.quarter_turns
        return Orientation.of_steps(rotations + other.quarter_turns, self.mirrored != other.mirrored)

    def size(self, height: int, width: int) -> tuple[int, int]:
        """Returns (height, width) of the upright picture for a stored one of that size, or the reverse."""
        return (width, height) if self.quarter_turns % 2 else (height, width)

    def upright(self, pixels: np.ndarray) -> np.ndarray:
        """Returns a view of stored pixels [H, W, ...] as shown by a viewer."""
        return _rotated_pixels(pixels[:, ::-1] if self.mirrored else pixels, -self.quarter_turns % 4)

    def stored(self, pixels: np.ndarray) -> np.ndarray:
        """Returns a view of upright pixels [H, W, ...] as they are stored."""
        rotated = _rotated_pixels(pixels, self.quarter_turns)
        return rotated[:, ::-1] if self.mirrored else rotated

    def upright_point(self, across, down):
        """Converts a position in the stored picture to the upright picture, as fractions of width and height."""
        across = 1 - across if self.mirrored else across
        for _ in range(self.quarter_turns):
            across, down = 1 - down, across
        return across, down

    def stored_point(self, across, down):
        """Converts a position in the upright picture to the stored picture, as fractions of width and height."""
        for _ in range(self.quarter_turns):
            across, down = down, 1 - across
        return 1 - across if self.mirrored else across, down

    def upright_direction(self, right: int, down: int) -> tuple[int, int]:
        """Converts a direction (right, down) in the stored picture to the upright one."""
        origin = self.upright_point(0, 0)
        end = self.upright_point(right, down)
        return end[0] - origin[0], end[1] - origin[1]

    @property
    def scene_up(self) -> tuple[int, int]:
        """Unit vector (right, down) in the stored picture that points to the top of the upright one."""
        sides = ((0, -1), (1, 0), (0, 1), (-1, 0))
        return next(side for side in sides if self.upright_direction(*side) == (0, -1))
