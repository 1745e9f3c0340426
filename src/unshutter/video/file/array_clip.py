"""Frames that the caller decodes, as a clip: a sequence, of which any part can be examined, or another iterable.

The latter may be unable to start again. So only its first frames are examined; they are kept in memory until they
are rendered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.shapes import UInt
from unshutter.photo.photo import check_size
from unshutter.video.file.bars import may_have_bars, picture_within_bars
from unshutter.video.file.clip import Clip
from unshutter.video.file.pixels import ArrayFrame, PixelFormat

Pixels = UInt[np.ndarray, "height width *bands"]
_MOST_BANDS = 4
_LOOKED_AT = 24  # frames in which bars are looked for


@dataclass(frozen=True, kw_only=True, eq=False)
class ArrayClip(Clip):
    """Frames at even intervals."""

    arrays: Iterable[Pixels]
    first: Pixels  # the first of them, like which all must be

    @classmethod
    def of(cls, arrays: FirstFrames | Sequence[Pixels] | np.ndarray, interval_s: float) -> ArrayClip | None:
        """Returns the clip of these frames, or None if there are none.

        Raises:
            UsageError: the first cannot be a frame.
            UnshutterError: it is too small or too large.
        """
        for first in arrays:
            _check(first)
            frames = arrays.most if isinstance(arrays, FirstFrames) else len(arrays)
            pixels = PixelFormat.of_array(first)
            clip = cls(
                path="the clip",
                pixels=pixels,
                height=first.shape[0],
                width=first.shape[1],
                interval_s=interval_s,
                frames=frames,
                duration_s=frames * interval_s,
                arrays=arrays,
                first=first,
            )
            if not may_have_bars(pixels, ArrayFrame(first, 0.0)):
                return clip
            every = max(frames // _LOOKED_AT, 1)
            return replace(clip, picture=picture_within_bars(pixels, islice(clip.frames_between(), 0, None, every)))
        return None

    def frames_between(self, start: float | None = None, end: float | None = None) -> Generator[ArrayFrame]:
        """Yields the frames between two times [s]; None means no limit.

        Raises:
            UsageError: one cannot be a frame.
            UnshutterError: one differs in size or type from the first.
        """
        begin = max(int(np.ceil((start or 0.0) / self.interval_s - 1e-6)), 0)
        until = None if end is None else int(np.ceil(end / self.interval_s - 1e-6))
        arrays = self.arrays
        if begin and isinstance(arrays, Sequence | np.ndarray):
            wanted = (arrays[number] for number in range(len(arrays))[begin:until])
        else:
            wanted = islice(arrays, begin, until)
        for number, pixels in enumerate(wanted, begin):
            _check(pixels, self.first)
            yield ArrayFrame(pixels, number * self.interval_s)

    def most_ahead(self, frames: int) -> int:
        """Returns 0: the caller's decoder runs in the caller's thread, and only when a frame is needed."""
        return 0


class FirstFrames(Iterable[Pixels]):
    """The first frames of an iterator, which are needed repeatedly and so are kept until all are taken.

    Args:
        source: the iterator.
        most: number of frames that are kept.
    """

    def __init__(self, source: Iterator[Pixels], most: int):
        self.most = most
        self._source = source
        self._kept = deque[Pixels]()

    def __iter__(self) -> Iterator[Pixels]:
        """Yields the first frames."""
        for number in range(self.most):
            if not self._has(number):
                return
            yield self._kept[number]

    @property
    def has_more(self) -> bool:
        """Whether more frames follow."""
        return self._has(self.most)

    def take_all(self) -> Iterator[Pixels]:
        """Yields all frames, and keeps none of them any longer."""
        while self._kept:
            yield self._kept.popleft()
        yield from self._source

    def _has(self, number: int) -> bool:
        """Reads on until there is a frame of this number, if there is."""
        self._kept.extend(islice(self._source, max(number + 1 - len(self._kept), 0)))
        return number < len(self._kept)


def _check(frame: object, first: Pixels | None = None) -> None:
    """Raises UsageError if this is not a frame; UnshutterError if it differs in size or type from the first one."""
    if not isinstance(frame, np.ndarray) or frame.dtype not in (np.uint8, np.uint16) or frame.ndim not in (2, 3):
        raise UsageError("frames must be uint8 or uint16 arrays [H, W] or [H, W, bands]")
    if frame.ndim == 3 and not 1 <= frame.shape[2] <= _MOST_BANDS:
        raise UsageError(f"frames must have 1 to {_MOST_BANDS} bands, got {frame.shape[2]}")
    if first is not None and (frame.shape, frame.dtype) != (first.shape, first.dtype):
        shapes = [f"{each.dtype} {'x'.join(map(str, each.shape))}" for each in (first, frame)]
        raise UnshutterError(f"frames must have the same size and type: the first is {shapes[0]}, another {shapes[1]}")
    check_size(frame.shape[0], frame.shape[1], "a frame")
