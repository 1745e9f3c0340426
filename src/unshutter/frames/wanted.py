"""What picture is wanted of a frame that has neighbours."""

from __future__ import annotations

from dataclasses import dataclass

from unshutter.errors import UsageError
from unshutter.frames.timing import Timing
from unshutter.geometry.readout import Readout
from unshutter.options import Clock, Find, FrameModel, Undo, model_for


@dataclass(frozen=True)
class Wanted:
    """What picture is wanted of a frame.

    Attributes:
        clock: how fast frames were taken and read out, if that is known.
        undo: reference row, strength and edges.
        readout: direction in which the stored pixels were read.
        at: moment of the picture, in frame intervals from the frame's first row; None: that of the reference row.
        model: how motion is described; None: as the frames say, or the other options need.
        focal_px: focal length of the camera [px of the photo]; None: EXIF's, else found.
        alone: how motion is found from a photo alone where its neighbours say nothing; None: it is not.

    Raises:
        UsageError: options that do not fit together, or a moment too far away.
    """

    clock: Clock
    undo: Undo
    readout: Readout
    at: float | None = None
    model: FrameModel | None = None
    focal_px: float | None = None
    alone: Find | None = None

    def __post_init__(self) -> None:
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"the moment must lie between -1 and 1 frame intervals, got {self.at:g}")
        object.__setattr__(self, "model", model_for(self.model, self.at, self.undo))

    def timing(self, height: int) -> Timing:
        """The clock of frames with so many rows."""
        return Timing(self.clock.ratio, height)

    def moment(self, timing: Timing) -> float:
        """Of the picture, in frame intervals from the frame's first row."""
        return timing.moment(self.undo.reference or "first") if self.at is None else self.at
