"""Exposure times of every row of every frame.

Time is counted in frame intervals. The readout ratio is the readout time of one frame divided by the frame interval:
row y of frame k, of H rows, is exposed at k + ratio * y / H. Frames are those of the readout frame: row 0 is read
first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from unshutter.options import check_ratio

if TYPE_CHECKING:
    import numpy as np

    from unshutter.options import Reference

SHARES = {"first": 0.0, "middle": 0.5, "last": 1.0}


@dataclass(frozen=True)
class Timing:
    """The clock of a sequence of frames.

    Attributes:
        readout_ratio: readout time / frame interval, above 0 and at most 1.
        height: rows of a frame, or of the smaller copy whose rows are counted.
        first_row: position of row 0 of that copy relative to the frame's first row, in rows of the copy; 0 for the
            frame itself.

    Raises:
        UsageError: the readout ratio is out of range.
    """

    readout_ratio: float
    height: int
    first_row: float = 0.0

    def __post_init__(self) -> None:
        check_ratio(self.readout_ratio)

    @property
    def per_row(self) -> float:
        """Time from one row to the next."""
        return self.readout_ratio / self.height

    def start(self, frame: float) -> float:
        """Returns the time at which row 0 of a frame is exposed."""
        return frame + self.per_row * self.first_row

    def exposed(self, frame: float, row: np.ndarray) -> np.ndarray:
        """Returns the times at which rows of a frame are exposed."""
        return self.start(frame) + self.per_row * row

    def moment(self, reference: Reference, frame: float = 0) -> float:
        """Returns the time of a frame's first, middle or last row."""
        return frame + self.readout_ratio * SHARES[reference]

    def of_copy(self, height: int) -> Timing:
        """Returns the clock of a copy of the frames with this number of rows."""
        return replace(self, height=height, first_row=0.5 - 0.5 * height / self.height)
