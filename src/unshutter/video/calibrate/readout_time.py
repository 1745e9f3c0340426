"""The readout time of a clip: as stated or listed, or from its frames.

The frames show it by regression (readout_regression.py) or, where that is not sure, by how smoothly the camera moved in
parts of the clip that must agree. They also bound the distortion that any time could cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import fewer, focal_from_motion, is_copy, ratio_from_motion
from unshutter.frames.tracks import GUESSED_RATIO, Tracks
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import cameras
from unshutter.video.calibrate.sampled_frames import SampledFrames, TrackedFrame
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.stages import Stage

PART, _MIN_PAIRS = 60, 20  # frames in a part, and fewest pairs of a usable one
MOST_PARTS = 12  # of a clip
_FAR = 3.0  # standard deviations: parts that differ by more disagree
_AGREE = 0.6  # least share of the parts' weight that agrees
SOLVED = 55  # how often a pair of frames is part of a fit, usually


# ---- known beforehand ------------------------------------------------------------------------------------------


def listed_time(request: ClipRequest) -> ReadoutTime | None:
    """Returns the readout time that the clip's file states, or that is listed for its camera."""
    clip = request.clip
    named = request.options.shutter.camera
    height, width = clip.picture_size
    return clip.camera.readout_time or cameras.listed_time(
        clip.tags, named, (width, height), rate=1 / clip.camera_interval_s
    )


def usual_time(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that is usual for cameras of the clip's kind, with its range."""
    return cameras.usual_time(request.clip.tags, request.clip.camera_interval_s)


def time_without_search(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that the user states, or that is listed or usual for the camera."""
    interval_s = request.clip.camera_interval_s
    return request.options.shutter.readout_time(interval_s) or listed_time(request) or usual_time(request)


# ---- in tracked frames -----------------------------------------------------------------------------------------


def wobble_in_frames(sampled: SampledFrames, rows: int) -> float | None:
    """Returns how far a clip wobbles from frame to frame because of its readout; None if its frames are too few.

    Args:
        rows: of the clip's frames.

    Returns:
        Root mean square at the first and last rows [px of the clip].
    """
    shown = sampled.regression
    px = sampled.px_of(rows)
    return None if shown is None or px is None else shown.wobble_px * px


def readout_time_in_frames(request: ClipRequest, sampled: SampledFrames) -> ReadoutTime:
    """Finds the readout time of a clip's camera in tracked frames; raises UnknownRatioError if they do not tell."""
    ratios: list[ReadoutRatio] = []
    unknown = UnknownRatioError.because(Reason.of(Code.NO_CLEAR_PART, frames=_MIN_PAIRS))
    runs = [_longest_run(part) for part in _parts(sampled)]
    count = request.work.counts(Stage.SEARCH)
    request.work.expect({Stage.SURVEY: 0, Stage.SEARCH: SOLVED * sum(len(run.pairs) for run in runs)})
    for run in runs:
        if len(run.pairs) >= _MIN_PAIRS:
            focal = request.focal and request.focal * ROWS
            try:
                focal = focal or focal_from_motion(run.pairs[: PART // 2], GUESSED_RATIO, count)
                starts = run.starts if run.is_uneven else None
                ratios.append(ratio_from_motion(run.pairs, focal, starts, is_checked=True, count=count))
            except UnknownRatioError as error:
                unknown = error
    request.work.expect({Stage.SEARCH: 0})
    if not ratios:
        raise unknown.of_clip()
    return agreed(ratios).seconds(request.clip.camera_interval_s)


def focal_in_frames(sampled: SampledFrames, ratio: float) -> float | None:
    """Returns the focal length that tracked frames show [heights of the frame]; None if they are too few."""
    run = max(map(_longest_run, sampled.parts), key=lambda run: len(run.pairs), default=_Run())
    if len(run.pairs) < _MIN_PAIRS:
        return None
    return focal_from_motion([fewer(pair) for pair in run.pairs[: PART // 2]], ratio) / ROWS


def agreed(parts: list[ReadoutRatio]) -> ReadoutRatio:
    """Returns the ratio on which the parts of a clip agree."""
    values = np.array([part.value for part in parts])
    errors = np.array([part.error for part in parts])
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
    return ReadoutRatio(value, error, ReadoutSource.FRAMES)


def _parts(sampled: SampledFrames) -> list[Sequence[TrackedFrame]]:
    """Returns consecutive frames: the sampled parts, or parts of a clip that was sampled from begin to end."""
    if len(sampled.parts) != 1:
        return [part[: PART + 1] for part in sampled.parts]
    (part,) = sampled.parts
    many = max(len(part) // PART, 1)
    return [part[PART * k : PART * (k + 1) + 1] for k in range(many)]


@dataclass(eq=False)
class _Run:
    """Consecutive frames of one shot."""

    pairs: list[Tracks] = field(default_factory=list)  # tracks of the background from each frame to the next
    # times of the frames [usual frame intervals], one more than pairs
    starts: list[float] = field(default_factory=lambda: [0.0])

    @property
    def is_uneven(self) -> bool:
        return any(after - before != 1.0 for before, after in pairwise(self.starts))


def _longest_run(frames: Sequence[TrackedFrame]) -> _Run:
    """Returns the longest run of connected frames."""
    runs = [_Run()]
    copies: list[float] = []  # times between copies of a frame
    for frame in frames[1:]:
        plane = frame.background
        run = runs[-1]
        if frame.since is None or (plane is not None and not plane.joined):
            runs.append(_Run())
            copies = []
        elif frame.tracks is not None and is_copy(frame.tracks, run.pairs[-1] if run.pairs else None, len(copies)):
            copies.append(frame.since)
        elif plane is not None:
            run.pairs.append(plane.tracks)
            run.starts.append(run.starts[-1] + frame.since + sum(copies))
            copies = []
    return max(runs, key=lambda run: len(run.pairs))


# ---- bound on the visible motion -------------------------------------------------------------------------------


def largest_displacement_px(request: ClipRequest, sampled: SampledFrames, longest_s: float, enough_px: float) -> float:
    """Returns a bound on the displacement within a frame that a clip can show [px]; infinite if there is none.

    Args:
        longest_s: longest plausible readout time [s].
        enough_px: a displacement [px] with which the rest of the clip is not examined.
    """
    undo = request.options.undo
    reach = longest_s / request.clip.camera_interval_s * undo.strength * (0.5 if undo.reference == "middle" else 1.0)
    largest = 0.0
    frames = 0
    lost = 0
    for frame in sampled.frames:
        frames += 1
        tracks = frame.tracks
        plane = frame.background
        if tracks is None or plane is None:
            continue
        lost += not plane.joined
        if plane.joined:
            moved = tracks if undo.model == "dense" else plane.tracks
            moved_px = float(np.percentile(np.hypot(*(moved.end - moved.start).T), 95))
            scale = min(request.frame_size) / min(tracks.height, tracks.width)
            largest = max(largest, reach * (moved_px * scale / (frame.since or 1.0)))
        if largest >= enough_px:
            return largest
    return np.inf if lost > 0.05 * frames or frames < 2 else largest
