"""How stored pixels lie: the direction in which the sensor read them out, and EXIF's orientation for viewers.

Convention: everything inside the package works in the **readout frame**: the picture turned (never
mirrored) so that the line read first is the top row. Only this file knows how to get there and back.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

from unshutter.errors import UsageError

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


# What a viewer does to the stored pixels: quarter turns clockwise, after mirroring them left to right or not.
_STEPS = {
    **{1: (0, False), 6: (1, False), 3: (2, False), 8: (3, False)},
    **{2: (0, True), 7: (1, True), 4: (2, True), 5: (3, True)},
}


class Orientation(IntEnum):
    """What a viewer does to stored pixels before it shows them; the values are EXIF's. Any other number counts as 1."""

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
        """The orientation that mirrors left to right or not, then makes that many quarter turns clockwise."""
        return next(cls(value) for value, steps in _STEPS.items() if steps == (quarter_turns % 4, mirrored))

    @property
    def quarter_turns(self) -> int:
        """Quarter turns clockwise, 0 to 3, made after the mirroring."""
        return _STEPS[self][0]

    @property
    def mirrored(self) -> bool:
        """Whether the stored pixels are mirrored left to right, before they are turned."""
        return _STEPS[self][1]

    @property
    def swaps_sides(self) -> bool:
        """Whether the width of the upright picture is the height of the stored one."""
        return self.quarter_turns % 2 == 1

    def then(self, other: Orientation) -> Orientation:
        """The single orientation that does what this one and then the other one do."""
        turns = -self.quarter_turns if other.mirrored else self.quarter_turns
        return Orientation.of_steps(turns + other.quarter_turns, self.mirrored != other.mirrored)

    def size(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) of the upright picture of a stored one of that size, and the reverse."""
        return (width, height) if self.swaps_sides else (height, width)

    def upright(self, pixels: np.ndarray) -> np.ndarray:
        """Stored pixels [H, W, ...] -> a view of them as a viewer shows them."""
        import numpy as np

        return np.rot90(pixels[:, ::-1] if self.mirrored else pixels, -self.quarter_turns)

    def stored(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels [H, W, ...] as a viewer shows them -> a view of them as they are stored."""
        import numpy as np

        turned = np.rot90(pixels, self.quarter_turns)
        return turned[:, ::-1] if self.mirrored else turned

    def upright_point(self, across, down):
        """A place in the stored picture, as shares of its width and height -> its shares of the upright picture's."""
        across = 1 - across if self.mirrored else across
        for _ in range(self.quarter_turns):
            across, down = 1 - down, across
        return across, down

    def stored_point(self, across, down):
        """A place in the upright picture, as shares of its width and height -> its shares of the stored picture's."""
        for _ in range(self.quarter_turns):
            across, down = down, 1 - across
        return 1 - across if self.mirrored else across, down

    def upright_direction(self, right: int, down: int) -> tuple[int, int]:
        """A direction in the stored picture -> the same direction in the upright one, both as (right, down)."""
        right = -right if self.mirrored else right
        for _ in range(self.quarter_turns):
            right, down = -down, right
        return right, down

    @property
    def scene_up(self) -> tuple[int, int]:
        """Unit vector (right, down) in the stored picture that points to the top of the upright one."""
        sides = ((0, -1), (1, 0), (0, 1), (-1, 0))
        return next(side for side in sides if self.upright_direction(*side) == (0, -1))
