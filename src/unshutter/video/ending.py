"""Where a film ends, and whether that is where it should: files that were cut off end early."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.video.containers import time_of
from unshutter.video.file_length import FileLength

if TYPE_CHECKING:
    from av import Packet

_NEAR = 1.5  # frame intervals: as far from where it should a film may end
_SHORT = 2.0  # the same where some other stream may be the longest of a file that was cut off
_REORDERED = 32  # frames among which the order of decoding may differ from that of showing
_SLOPPY, _SLOPPY_S = 4, 0.25  # frame intervals and seconds by which the headers of whole files may be wrong


@dataclass(frozen=True)
class ExpectedLength:
    """How much of a film there should be.

    Attributes:
        length: what the file says of its length.
        frames: of the film, as its tables have it; 0: unknown.
        counts_empty: whether some of these may have no data: AVI counts repeated frames.
        interval_s: from frame to frame [s].
        start_s: when the film begins [s].
        end_s: when it ends, by its tables [s]; None: unknown.
    """

    length: FileLength
    frames: int
    counts_empty: bool
    interval_s: float
    start_s: float
    end_s: float | None


class Ending:
    """How far a file was read, from its packets in their order.

    Args:
        path: of the file, for the user.
        expected: how much there should be.
    """

    def __init__(self, path: str, expected: ExpectedLength):
        self._path, self._expected = path, expected
        self._frames, self._film_s, self._all_s = 0, -math.inf, -math.inf
        self._latest: deque[float] = deque(maxlen=_REORDERED)  # ends of frames [s]

    def add(self, packet: Packet, of_film: bool) -> None:
        """The next packet."""
        at = time_of(packet)
        if at is not None:
            at += float((packet.duration or 0) * packet.time_base)
            self._all_s = max(self._all_s, at)
        if of_film and packet.size:
            self._frames += 1
            if at is not None:
                self._film_s = max(self._film_s, at)
                self._latest.append(at)

    def check(self, start: float | None, end: float | None) -> None:
        """After the last packet.

        Args:
            start, end: the part of the film that is kept [s]; None: all.

        Raises:
            UnshutterError: the file ends before that part does, and before it should.
        """
        expected, near = self._expected, _NEAR * self._expected.interval_s
        if end is not None and self._film_s >= end - near:
            return
        seconds, cut = expected.length.seconds, expected.length.cut
        if cut:
            self._film_s = self._without_gap(near)
        if expected.frames and (cut or not expected.counts_empty):
            few = self._frames < expected.frames
            late = expected.end_s is None or self._film_s < expected.end_s - near
            if few and (late or not start):
                statement = f"ends after {self._frames} of its {expected.frames} frames"
                raise self._early(f"ends early, {self._of(expected.end_s)}" if expected.end_s and late else statement)
        elif seconds is not None:
            missing = seconds - self._since(self._film_s if cut else self._all_s, seconds)
            if missing > (_SHORT * expected.interval_s if cut else max(_SLOPPY * expected.interval_s, _SLOPPY_S)):
                raise self._early(f"ends early, {self._of(seconds)}")
        elif cut and not expected.frames:
            raise self._early("ends in the middle of its data")

    def _without_gap(self, near: float) -> float:
        """When the film ends without those of its last frames that lie before others that are missing."""
        ends = sorted(self._latest)
        return next((a for a, b in pairwise(ends) if b - a > near), self._film_s)

    def _since(self, at: float, seconds: float) -> float:
        """How far a file of that length was read: files that begin late count from there, others from 0."""
        return at - self._expected.start_s if self._expected.start_s >= seconds else at

    def _of(self, seconds: float) -> str:
        return f"after {max(self._since(self._film_s, seconds), 0.0):.1f} of {seconds:.1f} s"

    def _early(self, statement: str) -> UnshutterError:
        until = math.floor(10 * self._film_s) / 10 if math.isfinite(self._film_s) else 0.0
        way = f"; --end {until:.1f} keeps what is there" if until > max(self._expected.start_s, 0.0) else ""
        return UnshutterError(f"{{clip}} {statement}: the file is cut off{way}", clip=self._path)
