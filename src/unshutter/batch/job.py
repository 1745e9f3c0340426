"""The job of processing one photo, and its outcome."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.storage.places import Place

if TYPE_CHECKING:
    import numpy as np

    from unshutter.frames.sequence import FrameMotion
    from unshutter.motion.verdict import Verdict


@dataclass(frozen=True)
class Job:
    """One photo and the places for its results.

    Attributes:
        source: the photo.
        target: its rectified picture.
        motion_target: its motion file; None: not written.
        mask_target: the mask of its valid pixels; None: not written.
        preview_px: long side [px] of the before and after pictures, 0 for full size; None: no preview.
        overwrite: whether outputs may replace existing files.
        max_pixels: pixel limit for photos that are read.
        may_repeat: whether an earlier attempt may have written outputs before its worker died or its run was killed;
            existing files with identical bytes are then kept.
        left: digests of picture, motion file and mask that an earlier run wrote for this photo; files that still have
            these digests may be replaced.
        recorded: whether the manifest needs digests of the outputs.
        motion: its motion, found from its neighbours in a sequence; None: estimated, or shared by all photos.
        before, after: its neighbours in a sequence.
    """

    source: Place
    target: Place
    motion_target: Place | None
    overwrite: bool
    max_pixels: int
    may_repeat: bool = False
    left: tuple[str | None, ...] = (None, None, None)
    recorded: bool = False
    motion: FrameMotion | None = None
    before: Place | None = None
    after: Place | None = None
    mask_target: Place | None = None
    preview_px: int | None = None

    @property
    def targets(self) -> tuple[Place, Place | None, Place | None]:
        """Picture, motion file and mask; None for those that are not written."""
        return self.target, self.motion_target, self.mask_target

    @property
    def outputs(self) -> list[Place]:
        """The targets that are to be written."""
        return [target for target in self.targets if target is not None]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a job.

    Attributes:
        error: one line; empty on success.
        usage: whether the error concerns the request rather than the photo.
        unknown_ratio: whether the frames do not show their camera's readout ratio.
        note: further information for the user.
        model: motion model used for a photo with neighbours (frames/frame.py); otherwise empty.
        verdict: whether the photo was changed, and why not.
        seconds: duration of the job.
        source_is: fingerprint of the photo that was read.
        outputs_are: fingerprints of the job's outputs; None for a picture that was not written.
        digests: digests of the outputs, if they are recorded.
        preview: the before and after pictures for a preview.
    """

    error: str = ""
    usage: bool = False
    unknown_ratio: bool = False
    note: str = ""
    model: str = ""
    verdict: Verdict | None = None
    seconds: float = 0.0
    source_is: str | None = None
    outputs_are: tuple[str | None, ...] = ()
    digests: tuple[str | None, ...] = ()
    preview: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def is_written(self) -> bool:
        """Whether a picture was written; for an unchanged photo there may be none."""
        return self.outputs_are[:1] != (None,)
