"""The readout time of a clip's camera, found from the clip: parts of it are asked one by one, and have to agree."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

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
from unshutter.video.frame_motion import look
from unshutter.video.pipeline import ahead

_PART, _FEWEST = 60, 20  # frames that are asked together, and those that are worth asking
_MOST_PARTS = 12
_FAR = 3.0  # standard deviations: parts that differ by more do not agree
_AGREE = 0.6  # share of the parts' weight that has to
_GUESSED_RATIO = 0.5


def find_ratio(
    clip: Clip, readout: Readout, focal_px: float | None, span: tuple[float, float], watch: Watch | None = None
) -> ReadoutRatio:
    """The readout ratio of a clip's camera.

    Args:
        clip: the clip.
        readout: direction in which the stored pixels were read.
        focal_px: focal length [px of a frame]; None: found, too.
        span: the part of the clip that is looked at [s].
        watch: called for every part of it.

    Raises:
        UnknownRatioError: the clip does not show it.
        UnshutterError: the clip cannot be read.
    """
    ratios: list[ReadoutRatio] = []
    unknown = UnknownRatioError.because(Reason.of(Code.NO_CLEAR_PART, frames=_FEWEST))
    steps = Steps("readout time", _MOST_PARTS, watch)
    for pairs in _parts(clip, readout, span):
        focal = None if focal_px is None else focal_px * ROWS / pairs[0].height
        try:
            focal = focal or focal_from_motion(pairs[: _PART // 2], _GUESSED_RATIO)
            ratios.append(ratio_from_motion(pairs, focal))
        except UnknownRatioError as error:
            unknown = error
        steps.advance()
    if not ratios:
        raise unknown.of_clip()
    return agreed(ratios)


def agreed(parts: list[ReadoutRatio]) -> ReadoutRatio:
    """The ratio that the parts of a clip agree on.

    Raises:
        UnknownRatioError: they do not agree.
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


def _parts(clip: Clip, readout: Readout, span: tuple[float, float]) -> Iterator[list[Tracks]]:
    """Parts of the clip, evenly over it: the tracks between consecutive frames of one shot."""
    length = _PART * clip.interval_s
    starts = np.linspace(span[0], max(span[1] - 1.1 * length, span[0]), _MOST_PARTS)
    if (span[1] - span[0]) < _MOST_PARTS * length:
        starts = span[0] + length * np.arange(max(1, int((span[1] - span[0]) / length)))
    for start in starts:
        pairs = _tracked(clip, readout, float(start), float(start) + length * 1.001)
        if len(pairs) >= _FEWEST:
            yield pairs


def _tracked(clip: Clip, readout: Readout, start: float, end: float) -> list[Tracks]:
    """The longest run of neighbours between two moments, as tracks."""
    camera = CameraMotion(readout=readout)
    runs: list[list[Tracks]] = [[]]
    before = copy = None
    with suppress(StopIteration):
        for frame in ahead(clip.iter_frames(start, end), 3):
            since = clip.since(before, frame)
            next_copy = look(clip, frame, camera, 1.0, TRACKED_SIDE)
            pair = background(follow(copy.grey, next_copy.grey)) if copy is not None else None
            if since != 1.0 or (pair is not None and not pair.joined):
                runs.append([])
            elif pair is not None:
                runs[-1].append(pair.tracks)
            before, copy = frame, next_copy
    return max(runs, key=len)
