"""When the frames of a film are shown: as its file says, or one after the other where it does not say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av import VideoFrame


@dataclass(frozen=True)
class Clock:
    """How a film's frames are given their times.

    Attributes:
        start: time of the first frame where it has none [ticks of the film].
        step: from one frame to the next, usually [ticks].
        delay: of files that store no time at which frames are shown, only the one at which they are decoded (AVI):
            from that to the other [ticks]; None: files with times.
    """

    start: int
    step: int
    delay: int | None = None


class Times:
    """Gives frames their times, in the order in which they are shown: later than the one before, always."""

    def __init__(self, clock: Clock):
        self._clock = clock
        self._last: int | None = None

    def set(self, frame: VideoFrame) -> None:
        """Gives the next frame its time."""
        clock = self._clock
        at = frame.pts
        if clock.delay is not None:
            at = None if frame.dts is None else frame.dts - clock.delay
        if at is None:
            at = clock.start if self._last is None else self._last + clock.step
        elif self._last is not None and at <= self._last:
            at = self._last + 1
        frame.pts = self._last = at
