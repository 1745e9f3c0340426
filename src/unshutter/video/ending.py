"""Detects films that end early because their file was cut off."""

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

_NEAR = 1.5  # frame intervals: tolerance of the end of a film
_SHORT = 2.0  # frame intervals: tolerance if another stream may be the longest in a cut-off file
_REORDERED = 32  # frames within which decoding and presentation order may differ
_SLOPPY, _SLOPPY_S = 4, 0.25  # frame intervals and seconds by which headers of complete files may be wrong


@dataclass(frozen=True)
class ExpectedLength:
    """The expected length of a film.

    Attributes:
        length: the length stated by the file.
        frames: number of frames in its tables; 0 if unknown.
        counts_empty: whether some of them may be empty: AVI counts repeated frames.
        interval_s: usual frame interval [s].
        start_s: start time of the film [s].
        end_s: end time according to its tables [s]; None if unknown.
    """

    length: FileLength
    frames: int
    counts_empty: bool
    interval_s: float
    start_s: float
    end_s: float | None


class Ending:
    """Tracks how far a file has been read, from its packets in order.

    Args:
        path: path of the file, for messages.
        expected: the expected length.
    """

    def __init__(self, path: str, expected: ExpectedLength):
        self._path, self._expected = path, expected
        self._frames, self._film_s, self._all_s = 0, -math.inf, -math.inf
        self._latest: deque[float] = deque(maxlen=_REORDERED)  # ends of frames [s]

    def add(self, packet: Packet, of_film: bool) -> None:
        """Registers the next packet."""
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
        """Checks the end of the film after the last packet.

        Args:
            start, end: the selected part of the film [s]; None for no limit.

        Raises:
            UnshutterError: the file ends before that part does, and earlier than expected.
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
        """Returns the end of the film before the first gap among its last frames."""
        ends = sorted(self._latest)
        return next((a for a, b in pairwise(ends) if b - a > near), self._film_s)

    def _since(self, at: float, seconds: float) -> float:
        """Returns how much of the stated length was read: late-starting files count from their start, others from 0."""
        return at - self._expected.start_s if self._expected.start_s >= seconds else at

    def _of(self, seconds: float) -> str:
        return f"after {max(self._since(self._film_s, seconds), 0.0):.1f} of {seconds:.1f} s"

    def _early(self, statement: str) -> UnshutterError:
        until = math.floor(10 * self._film_s) / 10 if math.isfinite(self._film_s) else 0.0
        way = f"; --end {until:.1f} keeps what is there" if until > max(self._expected.start_s, 0.0) else ""
        return UnshutterError(f"{{clip}} {statement}: the file is cut off{way}", clip=self._path)
