"""Determines the readout time of a clip: from its file, the table of cameras, its frames, or a usual value.

The frames are searched in parts of the clip, which must agree. A clip is never rejected because its readout time is
unknown. The usual value comes with a range, and if the frames cannot show a difference for any time in that range,
nothing is changed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import focal_from_motion, ratio_from_motion
from unshutter.frames.tracks import TRACKED_SIDE, Tracks
from unshutter.motion.verdict import LEAST_PX
from unshutter.progress import Steps
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video import cameras
from unshutter.video.clip import ClipRequest
from unshutter.video.clip_gyro import ClipGyro, gyro_of_clip
from unshutter.video.decode import followed

_PART, _FEWEST = 60, 20  # frames in a part, and fewest pairs of a usable one
_MOST_PARTS = 12
_FAR = 3.0  # standard deviations: parts that differ by more disagree
_AGREE = 0.6  # least share of the parts' weight that agrees
_GUESSED_RATIO = 0.5
_FAST_SHARE = 95  # percentile of the background corners' speed that is used
_LOST_SHARE = 0.05  # share of pairs of frames that cannot be tracked; with more, there is no bound
_ROUNDING_PX = 0.05


def camera_of_clip(request: ClipRequest, found: ReadoutTime | None = None) -> tuple[ReadoutTime, ClipGyro | None]:
    """Returns the readout time of a clip's camera, from the user or the clip unless it was found, and its gyro log."""
    clip, shutter = request.clip, request.options.shutter
    stated = shutter.readout_time(clip.interval_s)
    tag = clip.camera.readout if stated is None else None
    gyro = gyro_of_clip(request, stated or tag)
    time = stated or found or (gyro and gyro.readout_time)
    if time is None:
        stabilised = None if gyro is None else gyro.stabilised
        if stabilised is None and (gyro is None or gyro.turns is None) and clip.camera.is_stabilised:
            stabilised = Reason(Code.STABILISED_IN_CAMERA)
        time = readout_time_of_clip(request, tag, stabilised)
    time = time.in_frames(clip.interval_s)
    if gyro is not None and gyro.turns is not None:  # the time of the middle row does not change
        alignment = replace(gyro.turns.alignment, ratio=time.value)
        gyro = replace(gyro, turns=replace(gyro.turns, alignment=alignment))
    return time, gyro


def readout_time_of_clip(
    request: ClipRequest, tag: ReadoutTime | None = None, stabilised: Reason | None = None
) -> ReadoutTime:
    """Returns the readout time of a clip's camera, or the usual one with its range if it is unknown.

    The rows of a clip that was stabilised in the camera have moved: only its frames can tell their times.

    Args:
        tag: readout time stated in the clip's file.
        stabilised: what tells that the clip was stabilised; None if nothing does.
    """
    clip, listed = request.clip, None
    usual = cameras.usual_time(clip.tags, clip.interval_s)
    if stabilised is None:
        mode = (clip.width, clip.height), 1 / clip.interval_s
        listed = tag or cameras.listed_time(clip.tags, request.options.shutter.camera, *mode)
    if listed is not None and listed.plausible is None:
        return listed
    try:
        return find_ratio(request)
    except UnknownRatioError as error:
        return replace(listed or usual, instead_of=error.reason, declined=stabilised)


# ---- search in the frames ---------------------------------------------------------------------------------------


def find_ratio(request: ClipRequest) -> ReadoutTime:
    """Estimates the readout time of a clip's camera from the selected part; raises UnknownRatioError if it cannot."""
    ratios: list[ReadoutTime] = []
    unknown = UnknownRatioError.because(Reason.of(Code.NO_CLEAR_PART, frames=_FEWEST))
    starts, length_s = _parts(request)
    steps = Steps("readout time", 2 * _PART * len(starts), request.watch)  # tracking takes half of the time
    for number, start in enumerate(starts):
        run = _tracked(request, start, start + 1.001 * length_s, steps)
        if len(run.pairs) >= _FEWEST:
            focal = request.focal and request.focal * ROWS
            try:
                focal = focal or focal_from_motion(run.pairs[: _PART // 2], _GUESSED_RATIO)
                ratios.append(ratio_from_motion(run.pairs, focal, run.starts if run.is_uneven else None))
            except UnknownRatioError as error:
                unknown = error
        steps.advance_to(2 * _PART * (number + 1))
    if not ratios:
        raise unknown.of_clip()
    return agreed(ratios)


def agreed(parts: list[ReadoutTime]) -> ReadoutTime:
    """Returns the ratio on which the parts of a clip agree."""
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
    return ReadoutTime(value, error, "motion")


def _parts(request: ClipRequest) -> tuple[list[float], float]:
    """Returns the start times of parts, spread evenly over the selected span, and their length [s]."""
    length, (begin, end) = _PART * request.clip.interval_s, request.span
    starts = np.linspace(begin, max(end - 1.1 * length, begin), _MOST_PARTS)
    if end - begin < _MOST_PARTS * length:
        starts = begin + length * np.arange(max(1, int((end - begin) / length)))
    return [float(start) for start in starts], length


@dataclass(eq=False)
class _Run:
    """Consecutive frames of one shot."""

    pairs: list[Tracks] = field(default_factory=list)  # tracks of the background from each frame to the next
    # times of the frames [usual frame intervals], one more than pairs
    starts: list[float] = field(default_factory=lambda: [0.0])

    @property
    def is_uneven(self) -> bool:
        return any(after - before != 1.0 for before, after in pairwise(self.starts))


def _tracked(request: ClipRequest, start: float, end: float, steps: Steps) -> _Run:
    """Returns the longest run of connected frames between two times."""
    runs = [_Run()]
    for number, (_, since, _, pair) in enumerate(followed(request, start, end, TRACKED_SIDE)):
        if since is None or (pair is not None and not pair.joined):
            runs.append(_Run())
        elif pair is not None:
            runs[-1].pairs.append(pair.tracks)
            runs[-1].starts.append(runs[-1].starts[-1] + since)
        if number < _PART:
            steps.advance()
    return max(runs, key=lambda run: len(run.pairs))


# ---- bound on the visible motion -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Visibility:
    """The bound on the rolling-shutter distortion that a clip can show."""

    largest_px: float  # largest displacement within a frame at the longest plausible readout time [px]
    frames: int  # number of frames examined: all of the selected part


def too_little_to_see(request: ClipRequest, longest_ratio: float) -> Visibility | None:
    """Returns the bound on what undoing the motion would change, or None if it is half a pixel or more.

    Stops at the first frames that may show more.

    Args:
        longest_ratio: longest plausible readout time [frame intervals].
    """
    options, steps = request.options, request.steps("looking")
    reach = longest_ratio * options.undo.strength * (0.5 if options.undo.reference == "middle" else 1.0)
    largest, frames, lost = 0.0, 0, 0
    for _, since, tracks, straightened in followed(request, options.start, options.end):
        if tracks is not None and straightened is not None:
            lost += not straightened.joined
            if straightened.joined:
                moved = tracks if options.undo.model == "dense" else straightened.tracks
                moved_px = float(np.percentile(np.hypot(*(moved.end - moved.start).T), _FAST_SHARE))
                scale = min(request.frame_size) / min(tracks.height, tracks.width)
                largest = max(largest, reach * (moved_px * scale / (since or 1.0)))
            if largest >= LEAST_PX - _ROUNDING_PX:
                return None
        frames += 1
        steps.advance()
    return None if lost > _LOST_SHARE * frames or frames < 2 else Visibility(largest, frames)
