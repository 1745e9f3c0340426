"""Whether a clip was converted to another frame rate, by frames that are shown again, or left out, at regular places.

Frames that are repeated now and then fill gaps where the camera took none: the file's clock is the camera's. Where they
come as regularly as a conversion makes them, the camera's frames were taken at even intervals, and are shown at uneven
ones, unless the picture moves twice as far after a frame that is repeated: then they fill gaps, too. Missing frames
show in how the picture's speed jumps: it is even once each interval has its true length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

import numpy as np

from unshutter.motion.shapes import Bool, Float64
from unshutter.video.calibrate.readout_regression import PairMotion
from unshutter.video.calibrate.sampled_frames import SampledFrames, TrackedFrame
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.clip import Clip


@dataclass(frozen=True)
class ConversionParams:
    """When frames come as regularly as a conversion makes them."""

    around: int = 8  # frames on each side with which a change is compared: with the third largest change there
    repeated: float = 0.3  # of that: a repeated frame changes less
    moves_px: float = 0.04  # a picture that changes less there may be at rest
    fewest: int = 5  # repeated frames
    regular: float = 0.75  # share of the repeated frames that stand where they should, and of such places that have one
    even: float = 0.9  # share of the unevenness by the camera's clock: by the file's it is less where gaps are filled
    longest: int = 25  # frames after which the pattern recurs, at most: 24 frames a second shown at 25
    near: float = 0.06  # difference of the share of the camera's frames from what was counted

    missing: tuple[str, ...] = ("5/4", "6/5", "25/24", "5/2", "12/5", "25/12", "5/3")  # 30 to 24, 60 to 24 ...
    fewest_pairs: int = 40  # between frames that tell whether some are missing
    least_px: float = 0.1  # per frame, in the median: a picture that moves less may be at rest
    smoother: float = 0.75  # the speed then varies less than this, as a share (0.93 in real clips, at least)
    distinct: float = 0.9  # and less than this share of how it does with any other pattern


_PARAMS = ConversionParams()


def clock_in_frames(clip: Clip, sampled: SampledFrames) -> CameraClock | None:
    """Returns the clock of the camera whose frames a converted clip shows; None if it was not converted."""
    if clip.clock.share != 1 or not sampled.parts:
        return None
    repeats = _with_repeats(clip.clock, [part for part in sampled.parts if len(part) > 2])
    if repeats is None:
        return _with_gaps(clip, sampled)
    return None if _fill_gaps(repeats, sampled) else repeats


def _with_repeats(clock: CameraClock, parts: Sequence[Sequence[TrackedFrame]]) -> CameraClock | None:
    if not parts:
        return None
    changes = [np.array([frame.changed_px or 0.0 for frame in part[1:]]) for part in parts]
    judged = [_judged(each) for each in changes]
    known = np.concatenate([known for _, known in judged])
    is_same = np.concatenate([same for same, _ in judged])[known]
    if is_same.sum() < _PARAMS.fewest:
        return None
    counted = 1 - is_same.mean()
    shares = {Fraction(p, q) for q in range(2, _PARAMS.longest + 1) for p in range(1, q)}
    near = sorted((each for each in shares if abs(float(each) - counted) < _PARAMS.near), key=lambda s: s.denominator)
    best = max(near, key=lambda share: _hits(share, judged), default=None)
    if best is None:
        return None
    hits, expected = _hits(best, judged), float(known.sum()) * float(1 - best)
    if hits < max(_PARAMS.fewest, _PARAMS.regular * is_same.sum(), _PARAMS.regular * expected - 1):
        return None
    every = np.concatenate(changes)[known]
    same, other = every[is_same], every[~is_same]
    limit = min(4 * float(np.percentile(same, 75)) + 0.02, float(np.percentile(other, 10)) / 2)
    return replace(clock, share=best, same_px=limit)


def _judged(changes: Float64[np.ndarray, "frames"]) -> tuple[Bool[np.ndarray, "frames"], Bool[np.ndarray, "frames"]]:
    """Returns which frames of a part repeat the one before, and of which that is known since the picture moves."""
    usual = np.zeros(len(changes))
    for k in range(len(changes)):
        first = max(k - _PARAMS.around, 0)
        beside = np.sort(np.delete(changes[first : k + _PARAMS.around + 1], k - first))
        usual[k] = beside[-min(3, len(beside))] if len(beside) else 0.0
    return changes < _PARAMS.repeated * usual, usual > _PARAMS.moves_px


def _hits(share: Fraction, judged: Sequence[tuple[np.ndarray, np.ndarray]]) -> int:
    """Returns how many repeated frames stand where they should with such a share; less those that should, but do not.

    Each part has a pattern of its own, since an editor may have cut it.
    """
    hits = 0
    for same, known in judged:
        numbers = np.arange(len(same) + 1) * share.numerator
        patterns = (np.diff((numbers + k) // share.denominator) == 0 for k in range(share.denominator))
        hits += max(int((pattern & same & known).sum() - (pattern & ~same & known).sum()) for pattern in patterns)
    return hits


def _fill_gaps(clock: CameraClock, sampled: SampledFrames) -> bool:
    """Whether the picture moves on while frames are repeated, as it does where the camera took none."""
    by_file: list[np.ndarray] = []
    by_camera: list[np.ndarray] = []
    for part, motions in zip(sampled.parts, sampled.motions, strict=True):
        shifts: list[np.ndarray] = []
        gaps: list[float] = []
        waited = 0
        for frame, motion in zip(part[1:], motions, strict=True):
            if frame.changed_px is not None and frame.changed_px < clock.same_px:
                waited += 1
                continue
            if motion is not None:
                shifts.append(motion.shift)
                gaps.append(1.0 + waited)
            waited = 0
        if len(shifts) > _PARAMS.around:
            by_camera.append(_second_differences(np.array(shifts)))
            by_file.append(_second_differences(np.array(shifts) / (np.array(gaps) * float(clock.share))[:, None]))
    if not by_file:
        return False
    return float(np.concatenate(by_file).mean()) < _PARAMS.even * float(np.concatenate(by_camera).mean())


def _second_differences(speeds: Float64[np.ndarray, "pairs 2"]) -> Float64[np.ndarray, "inner"]:
    """Returns how far speeds differ from what those before and after let expect."""
    return np.hypot(*(speeds[1:-1] - (speeds[:-2] + speeds[2:]) / 2).T)


def _with_gaps(clip: Clip, sampled: SampledFrames) -> CameraClock | None:
    runs = [run for each in zip(sampled.parts, sampled.motions, strict=True) for run in _speeds(clip, *each)]
    if sum(len(speeds) for _, speeds in runs) < _PARAMS.fewest_pairs:
        return None
    if np.median(np.concatenate([np.hypot(*speeds.T) for _, speeds in runs])) < _PARAMS.least_px:
        return None
    as_shown = _unevenness(clip.clock, runs)
    shares = map(Fraction, _PARAMS.missing)
    clocks = [replace(clip.clock, share=share, missing=k) for share in shares for k in range(share.denominator)]
    left = [_unevenness(clock, runs) for clock in clocks]
    first, second = np.argsort(left)[:2]
    is_sure = left[first] < min(_PARAMS.smoother * as_shown, _PARAMS.distinct * left[second])
    return clocks[first] if is_sure else None


def _speeds(
    clip: Clip, part: Sequence[TrackedFrame], motions: Sequence[PairMotion | None]
) -> list[tuple[int, np.ndarray]]:
    """Returns runs of frames that follow each other evenly: number of the first, and the picture's speed at each."""
    runs: list[tuple[int, list[np.ndarray]]] = []
    last = None
    for frame, motion in zip(part[1:], motions, strict=True):
        number = round((frame.time_s * clip.clock.slowed - clip.begin_s) / clip.interval_s)
        if motion is not None and frame.since == 1.0:
            if last != number - 1:
                runs.append((number, []))
            runs[-1][1].append(motion.shift)
            last = number
    return [(first, np.array(speeds)) for first, speeds in runs if len(speeds) > ceil(_PARAMS.around / 2)]


def _unevenness(clock: CameraClock, runs: Sequence[tuple[int, np.ndarray]]) -> float:
    """Returns how far speeds differ from what those before and after let expect, with a camera of this clock."""
    left = []
    for first, shifts in runs:
        taken = np.diff(clock.taken(np.arange(first - 1, first + len(shifts))))
        speeds = shifts * float(clock.share) / taken[:, None]
        left.append(_second_differences(speeds))
    return float(np.concatenate(left).mean())
