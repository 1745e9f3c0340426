"""A job of a batch: one photo and where its result goes; and how it went."""

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
    """One photo and where its result goes.

    Attributes:
        source: the photo.
        target: its rectified picture.
        motion_target: its motion file, if there is to be one.
        mask_target: the mask of its valid pixels, if there is to be one.
        preview_px: long side [px] of the pictures before and after, 0 for their own size; None: no such pictures.
        overwrite: whether the target may replace what is there.
        max_pixels: of a photo that is read.
        may_repeat: whether an earlier attempt may have written the outputs, before its worker died or its run was
            killed: what is there stays if it is the same, byte for byte.
        left: digests of picture, motion file and mask as an earlier run left them from this photo: what still has them
            may be replaced.
        recorded: whether the manifest wants digests of what is written.
        motion: what its neighbours in a sequence say of its motion; None: it is found, or given for all photos.
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
        """The picture, the motion file, the mask; None for those that are not written."""
        return self.target, self.motion_target, self.mask_target

    @property
    def outputs(self) -> list[Place]:
        """All of them that are to be written."""
        return [target for target in self.targets if target is not None]


@dataclass(frozen=True)
class Outcome:
    """How a job went.

    Attributes:
        error: one line; empty where all went well.
        usage: the error is about the request rather than the photo.
        unknown_ratio: the error is that the frames do not show the readout ratio of their camera.
        note: something that the user should know.
        model: how the motion of a photo with neighbours was described (frames/frame.py); else empty.
        verdict: whether the photo was changed, and why not.
        seconds: that it took.
        source_is: fingerprint of the photo that was read.
        outputs_are: fingerprints of the job's outputs; None for a picture that was not written.
        digests: of their bytes, where they are recorded.
        preview: pictures before and after, for a preview.
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
        """Whether there is a picture: of a photo left unchanged, there may be none."""
        return self.outputs_are[:1] != (None,)
