"""EXIF's orientation: how stored pixels are mirrored and turned to be looked at.

Only this file knows what its numbers mean.

Source: CIPA DC-008 (EXIF 2.32), tag 0x0112.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np  # not imported above: a photo's header is read before NumPy is loaded

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
