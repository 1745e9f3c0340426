"""A first look at a long clip: whether a few parts of it, the liveliest among them, leave nothing to find.

A clip is left at once where these parts show that all rows were exposed at the same time, that nothing moves so far
that it could be seen, or that frames do not wobble. The sizes of packets tell where most moves: the more pictures
differ from those before them, the more bytes they take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from unshutter.motion.verdict import LEAST_PX
from unshutter.video.calibrate.gain import TALL, is_visible
from unshutter.video.calibrate.readout_regression import Regression
from unshutter.video.calibrate.readout_time import largest_displacement_px, usual_time
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.clip import ClipRequest

Parts: TypeAlias = Sequence[tuple[float | None, float | None]]  # begin and end of each [s]; None: no limit
SERIES, FRAMES = 3, 40  # parts of a first look, and frames of each
_WORTH = 2  # times as many frames as a first look has: shorter clips are looked at whole
_MOST_PX = 0.25  # px of 1080 rows, root mean square: frames that wobble by less do not
_ROUNDING_PX = 0.05


def spread(request: ClipRequest, frames: Sequence[int]) -> Parts:
    """Returns parts of so many frames, spread evenly over what the user selected; all of it if that is hardly more."""
    (begin, end), interval_s = request.span, request.clip.camera_step_s
    if end - begin < 1.1 * sum(frames) * interval_s:
        return [(request.options.start, request.options.end)]
    starts = np.linspace(begin, end - 1.1 * frames[-1] * interval_s, len(frames)).tolist() if frames else []
    return [(start, start + (many - 0.5) * interval_s) for start, many in zip(starts, frames, strict=True)]


def with_liveliest(request: ClipRequest, parts_s: Parts) -> tuple[Parts, bool]:
    """Replaces a part of those spread over a clip by the one in which most moves, and has the others begin with key
    frames that are near; also returns whether that part is known.
    """
    packets = request.clip.packets()
    if packets is None or len(parts_s) < 2:
        return parts_s, len(parts_s) < 2
    step_s = request.clip.camera_step_s
    starts, ends = np.array(parts_s, np.float64).T
    length_s = float((ends - starts).min())
    liveliest_s = packets.liveliest(request.span[0], float(starts[-1]), round(length_s / step_s))
    if liveliest_s is not None:
        starts[np.abs(starts - liveliest_s).argmin()] = liveliest_s
    keys = np.array([packets.key_before(start) for start in starts]) + step_s / 2
    at_keys = np.where((keys > request.span[0]) & (starts - keys < length_s / 2), keys, starts)
    starts = next((each for each in (at_keys, starts) if (np.diff(each) > length_s + step_s).all()), None)
    if starts is None:
        return parts_s, False
    return [(start, start + length_s) for start in starts.tolist()], liveliest_s is not None


def look_first(request: ClipRequest) -> SampledFrames:
    """Returns the tracked frames of a clip's liveliest part, and of others spread over it; none of a short clip."""
    if request.frames < _WORTH * SERIES * FRAMES:
        return SampledFrames()
    parts_s, is_known = with_liveliest(request, spread(request, (FRAMES + 1,) * SERIES))
    return replace(sample_frames(request, parts_s), has_liveliest=is_known)


def shows_nothing(request: ClipRequest, sampled: SampledFrames) -> bool:
    """Whether the frames of a first look suffice to leave the clip."""
    shown = sampled.regression
    if shown is not None and shown.is_none:
        return True
    if not sampled.has_liveliest:
        return False
    if shown is not None and (is_quiet(sampled, shown) or is_invisible(sampled, shown)):
        return True
    least_px = LEAST_PX - _ROUNDING_PX
    return largest_displacement_px(request, sampled, usual_time(request).longest_s, least_px) < least_px


def is_quiet(sampled: SampledFrames, shown: Regression) -> bool:
    """Whether frames would show a rolling shutter that made them wobble visibly, and do not."""
    px = sampled.px_of(TALL)
    return px is not None and shown.would_show and not shown.wobbles and px * shown.most_wobble_px < _MOST_PX


def is_invisible(sampled: SampledFrames, shown: Regression) -> bool:
    """Whether no ratio that the frames leave possible displaces anything visibly."""
    px = sampled.px_of(TALL)
    if px is None or not shown.would_show:
        return False
    planes = [frame.background for frame in sampled.frames if frame.background is not None]
    speeds = [np.percentile(np.hypot(*(each.tracks.end - each.tracks.start).T), 95) for each in planes if each.joined]
    return len(speeds) > len(planes) / 2 and not is_visible(px * shown.most_ratio / 2 * np.array(speeds))
