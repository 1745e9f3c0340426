"""SequenceOptions: how a frame that has neighbours is rectified."""

from __future__ import annotations

from dataclasses import dataclass

from unshutter.errors import UsageError
from unshutter.frames.timing import Timing
from unshutter.geometry.readout import Readout
from unshutter.options import Clock, Find, FrameModel, Undo, model_for


@dataclass(frozen=True)
class SequenceOptions:
    """How the frames of a sequence are rectified.

    Attributes:
        clock: how fast frames were taken and read out, if that is known.
        undo: reference row, strength and edges.
        readout: direction in which the stored pixels were read.
        at: moment of the picture, in frame intervals from the frame's first row; None: that of the reference row.
        model: how motion is to be described; None: as other options need it, else as the frames bear out.
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
        _ = self.needed_model  # raises where no model does all that is asked for

    @property
    def needed_model(self) -> FrameModel | None:
        """How motion has to be described; None: as the frames bear out."""
        return model_for(self.model, self.at, self.undo)

    def timing(self, height: int) -> Timing:
        """The clock of frames with so many rows."""
        return Timing(self.clock.ratio, height)

    def moment(self, timing: Timing) -> float:
        """The moment of the picture, in frame intervals from the frame's first row."""
        return timing.moment(self.undo.reference or "first") if self.at is None else self.at
