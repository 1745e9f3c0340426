"""The packets of a clip's frames: when they are decoded, how large they are, and from which decoding can begin."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from unshutter.motion.shapes import Bool, Float64
from unshutter.video.file.containers import VideoFile

_MOST_READ = 1 << 28  # bytes of a file without an index that are read for its packets


@dataclass(frozen=True, eq=False)
class Packets:
    """The packets of a clip's frames, as the index of its file lists them, in the order of decoding."""

    times_s: Float64[np.ndarray, "packets"]  # times of decoding [s]
    sizes: Float64[np.ndarray, "packets"]  # [bytes]
    are_keys: Bool[np.ndarray, "packets"]  # whether each is decoded by itself
    frames: int | None  # number of frames that are shown; None if the file ends before its packets do

    def liveliest(self, begin_s: float, end_s: float, frames: int) -> float | None:
        """Returns where the consecutive packets with most bytes begin [s]; None if there are too few to tell.

        Packets that are decoded by themselves do not count, unless all are.
        """
        inside = (self.times_s >= begin_s) & (self.times_s < end_s)
        sizes = np.where(self.are_keys & ~self.are_keys[inside].all(), 0.0, self.sizes)[inside]
        if len(sizes) < 2 * frames:
            return None
        sums = np.convolve(sizes, np.ones(frames), "valid")
        return float(self.times_s[inside][int(sums.argmax())])

    def key_before(self, at_s: float) -> float:
        """Returns the time of the last packet until then from which decoding can begin [s]."""
        keys = self.times_s[self.are_keys & (self.times_s <= at_s + 1e-6)]
        return float(keys[-1]) if len(keys) else at_s

    @classmethod
    def of(cls, file: VideoFile, frames: int) -> Packets | None:
        """Returns the packets of an open file; None if it has no index and is large.

        Args:
            frames: number of frames, as the file states it.
        """
        entries = list(file.video.index_entries)
        size = os.path.getsize(file.path)
        if 2 * len(entries) >= frames and entries:
            listed = [(each.timestamp, each.size, each.is_keyframe) for each in entries]
            is_whole = max(each.pos + each.size for each in entries) <= size
            shown = sum(not each.is_discard for each in entries) if is_whole else None
        elif size <= _MOST_READ:
            packets = [each for each in file.packets() if file.is_of_video(each) and each.size and each.dts is not None]
            listed = [(each.dts, each.size, each.is_keyframe) for each in packets]
            shown = None  # a packet may hold two fields of a frame, or be cut off
        else:
            return None
        if not listed:
            return None
        times, sizes, keys = map(np.array, zip(*listed, strict=True))
        return cls(times * float(file.video.time_base), sizes.astype(np.float64), keys.astype(bool), shown)
