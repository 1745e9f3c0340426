"""A job of a batch: one photo and where its result goes; and how it went."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.storage.places import Place

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict


@dataclass(frozen=True)
class Job:
    """One photo and where its result goes.

    Attributes:
        source: the photo.
        target: its rectified picture.
        motion_target: its motion file, if one is wanted.
        overwrite: whether the target may replace what is there.
        max_pixels: of a photo that is read.
        may_repeat: whether an earlier attempt may have written the outputs, before its worker died or its run was
            killed: what is there stays if it is the same, byte for byte.
        left: digests of the picture and the motion file as an earlier run left them from this photo: what still has
            them may be replaced.
        recorded: whether the manifest wants digests of what is written.
    """

    source: Place
    target: Place
    motion_target: Place | None
    overwrite: bool
    max_pixels: int
    may_repeat: bool = False
    left: tuple[str | None, str | None] = (None, None)
    recorded: bool = False

    @property
    def outputs(self) -> list[Place]:
        """All that is to be written: the picture, then the motion file."""
        return [self.target] if self.motion_target is None else [self.target, self.motion_target]


@dataclass(frozen=True)
class Outcome:
    """How a job went.

    Attributes:
        error: one line; empty where all went well.
        usage: the error is about the request rather than the photo.
        note: something that the user should know.
        verdict: whether the photo was changed, and why not.
        seconds: that it took.
        source_is: fingerprint of the photo that was read.
        target_is, motion_is: fingerprints of what was written.
        target_digest, motion_digest: of its bytes, where they are recorded.
    """

    error: str = ""
    usage: bool = False
    note: str = ""
    verdict: Verdict | None = None
    seconds: float = 0.0
    source_is: str | None = None
    target_is: str | None = None
    motion_is: str | None = None
    target_digest: str | None = None
    motion_digest: str | None = None
