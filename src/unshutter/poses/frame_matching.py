"""Matches the pictures of a model to the frames of a clip, by their names and the camera's rotations.

Pictures may have been thinned out and renumbered, or belong to another clip. The rotations between pictures of the
model are therefore compared with those between frames of the clip. Poses of a model are inexact, and in the clip's
tracks a camera that also moves appears to turn: so rotations over about a quarter of a second are compared, less their
mean over about two seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.motion.rotations import rotation_vector
from unshutter.motion.shapes import Float64

_SPAN, _AROUND = 8, 60  # frames between pictures whose rotation is compared, and frames over which the mean is taken
_TELLS_RAD = np.deg2rad(0.4)  # rms of the rotations of the model: smaller ones tell nothing
_FITS, _MATCHES, _CONTRADICTS = 0.7, 0.4, 1.0  # misfit: names are believed; others are; the clip is another one
_STRIDES = (2, 3)  # frames per picture are a multiple of one by these


def match_frames(
    rotations: Float64[np.ndarray, "pictures 3 3"], numbers: list[int], steps: Float64[np.ndarray, "frames 3 3"]
) -> list[int] | None:
    """Returns the frames that the pictures of one camera show; None if their rotations contradict the clip's.

    Where the rotations tell nothing, and where no frames match and the clip has no such numbers, these are returned.

    Args:
        rotations: of the model, from the world to the camera's axes, in the order of the names.
        numbers: frames by the names, from 0, increasing.
        steps: the camera's rotation from the previous frame of the clip to each, NaN where it is unknown.
    """
    path = _ClipPath.of(steps)
    named = np.array(numbers)
    are_in_clip = bool(named[0] >= 0 and named[-1] < len(steps))
    by_name = _Comparison.of(rotations, named).misfit(path, named) if are_in_clip else None
    if are_in_clip and (by_name is None or by_name <= _FITS):
        return numbers
    found = _searched(rotations, named, path)
    if found is not None:
        return found.tolist()
    return None if by_name is not None and by_name > _CONTRADICTS else numbers


@dataclass(frozen=True)
class _ClipPath:
    """How the camera turned during a clip."""

    rotations: Float64[np.ndarray, "frames 3 3"]  # from the first frame to each, taking unknown steps for none
    parts: np.ndarray  # [frames] number of unknown steps before each

    @classmethod
    def of(cls, steps: np.ndarray) -> _ClipPath:
        """Returns the path of steps [frames, 3, 3], NaN where unknown."""
        missing = np.isnan(steps[:, 0, 0])
        missing[0] = False
        path = np.tile(np.eye(3), (len(steps), 1, 1))
        for k in range(1, len(steps)):
            path[k] = path[k - 1] if missing[k] else steps[k] @ path[k - 1]
        return cls(path, np.cumsum(missing))

    def between(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Returns rotation vectors [N, 3] from some frames to others; NaN where unknown."""
        known = self.parts[first] == self.parts[last]
        return np.where(known[:, None], _between(self.rotations, first, last), np.nan)


@dataclass(frozen=True)
class _Comparison:
    """Pairs of pictures, and the rotations of the model between them."""

    first: np.ndarray  # [N] index of each pair's first picture
    last: np.ndarray
    around: int  # pairs over which the mean is taken
    posed: Float64[np.ndarray, "pairs 3"]

    @classmethod
    def of(cls, rotations: np.ndarray, frames: np.ndarray) -> _Comparison:
        """Chooses pairs for pictures of certain frames, of which only the distances count."""
        stride = max(float(np.median(np.diff(frames))), 1.0) if len(frames) > 1 else 1.0
        span = max(1, round(_SPAN / stride))
        first = np.arange(max(len(frames) - span, 0))
        return cls(first, first + span, max(5, round(_AROUND / stride)), _between(rotations, first, first + span))

    def misfit(self, path: _ClipPath, frames: np.ndarray) -> float | None:
        """Returns the share of the rotations' rms that the clip does not explain; None if they show nothing.

        Args:
            frames: [pictures] frame that each shows.
        """
        tracked = path.between(frames[self.first], frames[self.last])
        used = ~np.isnan(tracked[:, 0])
        posed = self.posed[used]
        if len(posed) < 5:  # fewer tell nothing
            return None
        signal = np.sum((posed - _smooth(posed, self.around)) ** 2, axis=1)
        if np.sqrt(signal.mean()) < _TELLS_RAD:
            return None
        left = tracked[used] - posed
        sizes = np.sum((left - _smooth(left, self.around)) ** 2, axis=1)
        return float(np.sqrt(np.minimum(sizes, 9 * np.median(sizes)).mean() / signal.mean()))  # a few poses are wrong


def _between(rotations: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Returns rotation vectors [N, 3] from some rotations to others."""
    return rotation_vector(rotations[last] @ np.swapaxes(rotations[first], -1, -2))


def _smooth(values: np.ndarray, count: int) -> np.ndarray:
    """Returns the running mean over ``count`` values [N, 3], fewer at the ends."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])
    at = np.arange(len(values))
    low, high = np.maximum(at - count // 2, 0), np.minimum(at + count // 2 + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)[:, None]


def _searched(rotations: np.ndarray, named: np.ndarray, path: _ClipPath) -> np.ndarray | None:
    """Searches evenly thinned frames whose rotations match those of the pictures, by the numbers or order of names."""
    best, found = _MATCHES, None
    used = slice(0, 200)
    for places in (named - named[0], np.arange(len(named))):
        longest = (len(path.parts) - 1) / max(places[-1], 1)
        strides = sorted({k / by for by in _STRIDES for k in range(by, int(longest * by) + 1)})
        for stride in strides:
            frames = np.floor(places * stride + 1e-9).astype(int)
            compared = _Comparison.of(rotations[used], frames[used])
            for begin in range(len(path.parts) - frames[-1]):
                misfit = compared.misfit(path, begin + frames[used])
                if misfit is not None and misfit < best:
                    best, found = misfit, begin + frames
    return found
