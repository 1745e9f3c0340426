"""What an estimator is given, and what it must be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter.readout import Readout, scene_up


@dataclass(frozen=True)
class View:
    """A photo as an estimator sees it: in its readout frame, first line on top (readout.py)."""

    photo: Photo
    readout: Readout = Readout.TOP_TO_BOTTOM

    @property
    def height(self) -> int:
        """Rows of the full-size readout frame."""
        return self.readout.frame_size(self.photo.height, self.photo.width)[0]

    @property
    def width(self) -> int:
        """Columns of the full-size readout frame."""
        return self.readout.frame_size(self.photo.height, self.photo.width)[1]

    @property
    def up(self) -> tuple[int, int]:
        """Unit vector (right, down) to the scene's top, from the EXIF orientation."""
        return scene_up(self.photo.orientation, self.readout)

    def grey(self, short_side: int | None = None) -> np.ndarray:
        """[h, w] uint8 grey copy whose short side is about ``short_side`` px; never enlarged."""
        return self.readout.turn(self.photo.grey(short_side))

    def focal_px(self) -> float | None:
        """Focal length [px of the full-size picture] from EXIF, or None."""
        return self.photo.focal_px()

    def no_motion(self, estimator: str, reason: str) -> Motion:
        """The answer of an estimator that declines, and why."""
        return Motion.zero(self.height, self.width, readout=self.readout, estimator=estimator, reason=reason)


class Estimator(Protocol):
    """Finds the row motion of a photo.

    Attributes:
        name: under which it is registered.
    """

    name: str

    def estimate(self, view: View) -> Motion:
        """The motion of the full-size photo in its readout frame, first row as the reference.

        Where the photo does not say enough the motion is zero and carries a reason; it never raises for that.
        """
        ...
