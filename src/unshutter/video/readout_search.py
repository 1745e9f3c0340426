"""Estimates the readout time of a clip's camera from parts of the clip, which must agree."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import ReadoutRatio, focal_from_motion, ratio_from_motion
from unshutter.frames.sequence import CameraMotion
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, background, follow
from unshutter.geometry.readout import Readout
from unshutter.progress import Steps, Watch
from unshutter.reasons import Code, Reason
from unshutter.video.clip import Clip
from unshutter.video.moving_frames import look
from unshutter.video.pipeline import ahead

_PART, _FEWEST = 60, 20  # frames in a part, and fewest pairs of a usable one
_MOST_PARTS = 12
_FAR = 3.0  # standard deviations: parts that differ by more disagree
_AGREE = 0.6  # least share of the parts' weight that agrees
_GUESSED_RATIO = 0.5


def find_ratio(
    clip: Clip, readout: Readout, focal_px: float | None, span: tuple[float, float], watch: Watch | None = None
) -> ReadoutRatio:
    """Estimates the readout ratio of a clip's camera.

    Args:
        clip: the clip.
        readout: direction in which the stored pixels were read.
        focal_px: focal length [px of a frame]; None to estimate it.
        span: the part of the clip to examine [s].
        watch: called for every part of it.

    Raises:
        UnknownRatioError: the clip does not reveal it.
        UnshutterError: the clip cannot be read.
    """
    ratios: list[ReadoutRatio] = []
    unknown = UnknownRatioError.because(Reason.of(Code.NO_CLEAR_PART, frames=_FEWEST))
    starts, length_s = _parts(clip, span)
    steps = Steps("readout time", 2 * _PART * len(starts), watch)  # tracking takes half of the time
    for number, start in enumerate(starts):
        run = _tracked(clip, readout, start, start + 1.001 * length_s, steps)
        if len(run.pairs) >= _FEWEST:
            focal = None if focal_px is None else focal_px * ROWS / run.pairs[0].height
            try:
                focal = focal or focal_from_motion(run.pairs[: _PART // 2], _GUESSED_RATIO)
                ratios.append(ratio_from_motion(run.pairs, focal, run.starts if run.is_uneven else None))
            except UnknownRatioError as error:
                unknown = error
        steps.advance_to(2 * _PART * (number + 1))
    if not ratios:
        raise unknown.of_clip()
    return agreed(ratios)


def agreed(parts: list[ReadoutRatio]) -> ReadoutRatio:
    """Returns the ratio on which the parts of a clip agree.

    Raises:
        UnknownRatioError: they disagree.
    """
    values, errors = np.array([part.value for part in parts]), np.array([part.error for part in parts])
    weights = 1 / errors**2
    order = np.argsort(values)
    middle = values[order][np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)]
    near = np.abs(values - middle) <= _FAR * np.hypot(errors, errors.min())
    if weights[near].sum() < _AGREE * weights.sum():
        listed = ", ".join(f"{value:.2f}" for value in values)
        raise UnknownRatioError.because(Reason.of(Code.PARTS_DISAGREE, ratios=listed)).of_clip()
    value = float(np.average(values[near], weights=weights[near]))
    spread = ((values[near] - value) ** 2 * weights[near]).sum() / max(near.sum() - 1, 1)
    error = float(np.sqrt(max(spread, 1.0) / weights[near].sum()))
    return ReadoutRatio(value, error, "motion")


def _parts(clip: Clip, span: tuple[float, float]) -> tuple[list[float], float]:
    """Returns the start times of parts, spread evenly over the selected span, and their length [s]."""
    length = _PART * clip.interval_s
    starts = np.linspace(span[0], max(span[1] - 1.1 * length, span[0]), _MOST_PARTS)
    if (span[1] - span[0]) < _MOST_PARTS * length:
        starts = span[0] + length * np.arange(max(1, int((span[1] - span[0]) / length)))
    return [float(start) for start in starts], length


@dataclass(eq=False)
class _Run:
    """Consecutive frames of one shot.

    Attributes:
        pairs: tracks of the background from each frame to the next.
        starts: times of the frames [usual frame intervals], one more than pairs.
    """

    pairs: list[Tracks] = field(default_factory=list)
    starts: list[float] = field(default_factory=lambda: [0.0])

    @property
    def is_uneven(self) -> bool:
        return any(after - before != 1.0 for before, after in pairwise(self.starts))


def _tracked(clip: Clip, readout: Readout, start: float, end: float, steps: Steps) -> _Run:
    """Returns the longest run of connected frames between two times."""
    camera = CameraMotion(readout=readout)
    runs, frames = [_Run()], 0
    before = copy = None
    with suppress(StopIteration):
        for frame in ahead(clip.iter_frames(start, end), 3):
            since = clip.since(before, frame)
            next_copy = look(clip, frame, camera, 1.0, TRACKED_SIDE)
            pair = background(follow(copy.grey, next_copy.grey)) if copy is not None else None
            if since is None or (pair is not None and not pair.joined):
                runs.append(_Run())
            elif pair is not None:
                runs[-1].pairs.append(pair.tracks)
                runs[-1].starts.append(runs[-1].starts[-1] + since)
            before, copy, frames = frame, next_copy, frames + 1
            if frames <= _PART:
                steps.advance()
    return max(runs, key=lambda run: len(run.pairs))
