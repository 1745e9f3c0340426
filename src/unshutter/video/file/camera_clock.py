"""How a camera's frames follow one another in a clip's file, if it does not hold them one by one and in real time.

Programs that convert a clip to another frame rate repeat frames or leave some out. Slow motion is shown more slowly
than it was taken. Readout times are counted on the camera's clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np

if TYPE_CHECKING:
    from unshutter.motion.shapes import UInt8

Number = TypeVar("Number", int, "np.ndarray")
SIDE = 128  # px, short side of the copies in which frames are compared


@dataclass(frozen=True)
class CameraClock:
    """The camera's clock, compared with that of the file."""

    slowed: float = 1.0  # seconds of the file for each second of the camera
    # frames of the camera for each frame of the file: 4/5 if every fourth is shown twice, 5/4 if every fifth is missing
    share: Fraction = Fraction(1)
    same_px: float = 0.0  # a frame that differs by less from the one before repeats it, if some do (:class:`Changes`)
    missing: int = 0  # number of the first frame of the file before which one is missing, if some are

    @property
    def is_files(self) -> bool:
        """Whether it is the file's clock."""
        return self == CameraClock()

    @property
    def repeats(self) -> bool:
        """Whether some frames repeat the one before them."""
        return self.share < 1

    def interval_s(self, shown_s: float) -> float:
        """Returns the camera's time from one frame to the next, for that of the file [s]."""
        return shown_s / self.slowed / float(self.share)

    def since(self, shown: float, number: int) -> float:
        """Returns the time since the camera's previous frame in the file [intervals of the camera].

        Args:
            shown: the same in intervals of the file.
            number: of the frame in the file.
        """
        if self.share < 1:
            return float(max(floor(shown * self.share + 1e-6), 1))
        if self.share > 1 and shown == round(shown):
            return float(self.taken(number) - self.taken(number - round(shown)))
        return shown * float(self.share)

    def taken(self, number: Number) -> Number:
        """Returns the number of a frame of the file, or of each of some, among those that the camera took.

        They are counted from any of them. No frame may repeat another one.
        """
        taken, shown = max(self.share, Fraction(1)).as_integer_ratio()
        return -((self.missing - number - 1) * taken // shown)


class Changes:
    """How far frames, in order, differ from the one before them, and which of them repeat it.

    Attributes:
        px: apparent displacement since the previous frame that repeats none [px of a copy with a short side of 128];
            None for the first frame.
    """

    def __init__(self, clock: CameraClock):
        self._clock = clock
        self._before: np.ndarray | None = None
        self._shown = 1
        self.px: float | None = None

    def is_repeated(self, grey: UInt8[np.ndarray, "rows columns"]) -> bool:
        """Returns whether the next frame, given as a small grey copy, repeats the one before it."""
        scale = min(1.0, SIDE / min(grey.shape))
        size = max(round(grey.shape[1] * scale), 2), max(round(grey.shape[0] * scale), 2)
        small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA)).astype(np.float32)
        self.px = None if self._before is None else _apart(self._before, small)
        is_same = self._clock.repeats and self.px is not None and self.px < self._clock.same_px
        if is_same and self._shown < ceil(1 / self._clock.share):
            self._shown += 1
            return True
        self._before = small
        self._shown = 1
        return False


def _apart(before: np.ndarray, after: np.ndarray) -> float:
    slope = float(np.abs(np.diff(before, axis=1)).mean())
    return float(np.abs(after - before).mean()) / max(slope, 1e-3)
