"""Shots: consecutive frames that show one scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from unshutter.frames.self_calibration import REST_PX, STILL_PX, ReadoutRatio, drift, flow
from unshutter.frames.tracks import Background, Tracks, background, follow
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    import numpy as np

    from unshutter.geometry.shapes import UInt8
    from unshutter.photo import Photo

_LEAST_CORNERS = 24  # fewest corners of a usable picture
_CHANCE = 2  # pairs of frames in which apparent motion may be a mistake


@dataclass(eq=False)
class GreyFrame:
    """A frame as used for estimating motion.

    It holds the full size, a small grey copy, the photo if it may be examined closely, and the time since the
    previous frame: ``after`` is in usual frame intervals, and so is ``at``, the time since the shot began. ``time_s``
    is its time on the clip's clock [s], if there is one, and ``tracks`` are those from the previous frame.
    """

    height: int
    width: int
    grey: UInt8[np.ndarray, "rows columns"]
    number: int = 0
    photo: Photo | None = None
    after: float = 1.0
    at: float = 0.0
    time_s: float = 0.0
    tracks: Tracks | None = None


@dataclass(eq=False)
class Shot:
    """Frames that show one scene: those awaiting their motion and a few before them.

    Attributes:
        broken_by: why the shot began here; None for the first one, and after a gap.
        number: number of the shot in its sequence.
        scene: number of the scene it shows; several shots may show the same one.
        pairs: tracks of the background from each kept frame to the next.
        times: times of the frames of ``pairs``, one more than those [frame intervals].
        clock_s: times of those frames on the clip's clock [s].
        waiting: frames awaiting their motion.
        first: number of the frame at which ``pairs`` begin.
        before: number of kept frames that are no longer waiting.
        why_unknown: why the readout ratio could not be estimated; None if it was, or was not attempted.
    """

    broken_by: Reason | None = None
    number: int = 0
    scene: int = 0
    pairs: list[Tracks] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    clock_s: list[float] = field(default_factory=list)
    waiting: list[GreyFrame] = field(default_factory=list)
    first: int = 0
    before: int = 0
    why_unknown: Reason | None = None
    _last: GreyFrame | None = None
    _next: Background | None = None
    _moving: list[bool] = field(default_factory=list)
    _passing: list[bool] = field(default_factory=list)

    @property
    def still(self) -> bool:
        """Whether there is no sign that the camera moved."""
        return not any(self._moving)

    @property
    def at_rest(self) -> bool:
        """Whether the camera was at rest, without even the slight motion that is too small to count."""
        return all(drift(pair) < REST_PX for pair in self.pairs if len(pair))

    @property
    def passed(self) -> bool:
        """Whether something moved in front of the camera."""
        return sum(self._passing) > _CHANCE

    def joins(self, frame: GreyFrame, ratio: ReadoutRatio | None) -> bool:
        """Whether a frame shows the same scene as the previous one."""
        self._next = None
        if self._last is None:
            return True
        if (frame.height, frame.width) != (self._last.height, self._last.width):
            self.broken_by = Reason(Code.OTHER_SIZE)
            return False
        tracks = follow(self._last.grey, frame.grey)
        self._next = background(tracks, ratio.value if ratio else None)
        frame.tracks = self._next.tracks if self._next.joined else tracks
        if not self._next.joined:
            few = tracks.looked_for < _LEAST_CORNERS
            near_and_far = Code.SCENES_DIFFER if self._next.cut else Code.NO_COMMON_MOTION
            self.broken_by = Reason(Code.TOO_LITTLE_TO_FOLLOW if few else near_and_far)
        return self._next.joined

    def next_shot(self) -> Shot:
        """Returns the shot that begins with a frame that does not join this one."""
        cut = self.broken_by is not None and self.broken_by.code in (Code.SCENES_DIFFER, Code.OTHER_SIZE)
        return Shot(broken_by=self.broken_by, number=self.number + 1, scene=self.scene + cut)

    def add(self, frame: GreyFrame) -> None:
        """Adds the next frame, after :meth:`joins`."""
        if self._last is not None and self._next is not None:
            self.pairs.append(self._next.tracks)
            self._moving.append(not self._next.still and flow(self._next.tracks) > STILL_PX)
            self._passing.append(self._next.passing)
            frame.at = self._last.at + frame.after
            frame.number = self._last.number + 1
            self._last.grey = frame.grey[:0]  # no longer needed
        self.times.append(frame.at)
        self.clock_s.append(frame.time_s)
        self.waiting.append(frame)
        self._last = frame

    def pair_beside(self, frame: GreyFrame) -> Tracks:
        """Returns the tracks from a frame to the next; for the last frame, those from the previous one."""
        at = min(frame.number - self.first, len(self.pairs) - 1)
        return self.pairs[at]

    def drop(self, many: int, margin: int) -> None:
        """Removes frames from the waiting list, keeping a few of them."""
        del self.waiting[:many]
        self.before += many
        surplus = max(self.before - margin, 0)
        del self.pairs[:surplus], self._moving[:surplus], self._passing[:surplus]
        del self.times[:surplus], self.clock_s[:surplus]
        self.first += surplus
        self.before -= surplus
