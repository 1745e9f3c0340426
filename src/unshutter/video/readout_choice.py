"""Determines the readout time of a clip: from its file, the table of cameras, its frames, or a usual value.

A clip is never rejected because its readout time is unknown. The usual value comes with a range, and if the frames
cannot show a difference for any time in that range, nothing is changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.self_calibration import RatioRange, ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.frames.tracks import Tracks, background, follow
from unshutter.geometry.readout import Readout
from unshutter.motion.verdict import LEAST_PX
from unshutter.progress import Steps, Watch
from unshutter.reasons import Reason
from unshutter.video import cameras
from unshutter.video.clip import Clip
from unshutter.video.moving_frames import look
from unshutter.video.options import ClipUndo, RectifyClip, Shutter
from unshutter.video.pipeline import ahead
from unshutter.video.readout_search import find_ratio
from unshutter.video.readout_tags import readout_tag

_PERCENTILES = (5, 50, 95)  # of the table: range of a kind of camera, and usual value
_SIMILAR_RATE = 1.3  # ratio of frame rates within which readout times are similar
_KINDS = {
    "phones": "apple samsung xiaomi redmi realme poco oneplus huawei honor zte ulefone oppo vivo nothing google",
    "action cameras and drones": (
        "gopro dji insta360 xtu runcam walksnail hawkeye caddx tomate sioeye foxeer akaso sjcam parrot autel skydio"
    ),
    "cameras": "sony canon nikon panasonic fujifilm blackmagic sigma red leica kinefinity olympus om hasselblad z",
}
_FAST_SHARE = 95  # percentile of the background corners' speed that is used
_LOST_SHARE = 0.05  # share of pairs of frames that cannot be tracked; with more, there is no bound
_ROUNDING_PX = 0.05


def readout_ratio_of_clip(
    clip: Clip, readout: Readout, shutter: Shutter, span: tuple[float, float], watch: Watch | None = None
) -> ReadoutRatio:
    """Returns the readout ratio of a clip's camera, or the usual one with its range if it is unknown.

    Args:
        clip: the clip; its tags name the camera if the user does not.
        readout: direction in which the stored pixels were read.
        shutter: what the user states about the camera, except the readout time.
        span: the part of the clip to search [s].
        watch: called for every part of it.

    Raises:
        UsageError: the table lacks the camera that the user names, or its mode.
        UnshutterError: the clip cannot be read.
    """
    tag = None if clip.of_pictures else readout_tag(clip.path)
    if tag is not None:
        return ReadoutRatio(_ratio(tag.ms, clip), 0.0, "the clip's file", tag.writer)
    mode = (clip.width, clip.height), 1 / clip.interval_s
    if shutter.camera is None:
        entry = cameras.find_tagged(clip.tags, *mode)
    else:
        entry = cameras.find_named(shutter.camera, *mode)
    if entry is not None and entry.is_certain:
        return ReadoutRatio(_ratio(entry.typical, clip), 0.0, "table of cameras", shutter.camera or entry.camera)
    try:
        return find_ratio(clip, readout, shutter.focal_px, span, watch)
    except UnknownRatioError as error:
        if entry is None:
            return _usual(clip, error.reason)
        plausible = RatioRange(_ratio(entry.low, clip), _ratio(entry.high, clip), f"{entry.camera}, {entry.match}")
        camera = shutter.camera or entry.camera
        return ReadoutRatio(_ratio(entry.typical, clip), 0.0, "table of cameras", camera, error.reason, plausible)


def _usual(clip: Clip, reason: Reason) -> ReadoutRatio:
    """Returns the usual readout ratio of cameras of the clip's kind, from the table."""
    make = cameras.camera_of(clip.tags)[0].lower().split()
    kind = next((kind for kind, brands in _KINDS.items() if make and make[0] in brands.split()), "")
    rate = 1 / clip.interval_s
    similar = [mode for mode in cameras.table() if 1 / _SIMILAR_RATE < mode.fps / rate < _SIMILAR_RATE]
    brands = _KINDS.get(kind, "").split()
    modes = [mode for mode in similar if not kind or mode.brand.lower().split()[0] in brands] or similar
    times = [mode.readout_ms for mode in modes] or [1000 * clip.interval_s * share for share in (0.2, 0.5, 1.0)]
    low, usual, high = (_ratio(float(ms), clip) for ms in np.percentile(times, _PERCENTILES))
    plausible = RatioRange(low, high, kind or "cameras and phones")
    return ReadoutRatio(usual, 0.0, "usual value", instead_of=reason, plausible=plausible)


def _ratio(ms: float, clip: Clip) -> float:
    return min(ms / 1000 / clip.interval_s, 1.0)


# ---- bound on the visible motion -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Visibility:
    """The bound on the rolling-shutter distortion that a clip can show.

    Attributes:
        largest_px: largest displacement within a frame at the longest plausible readout time [px].
        frames: number of frames examined: all of the selected part.
    """

    largest_px: float
    frames: int


def too_little_to_see(
    clip: Clip, readout: Readout, options: RectifyClip, longest_ratio: float, watch: Watch | None = None
) -> Visibility | None:
    """Returns the bound on what undoing the motion would change, or None if it is half a pixel or more.

    Stops at the first frames that may show more.

    Args:
        clip: the clip.
        readout: direction in which the stored pixels were read.
        options: the part to keep, and how motion is undone.
        longest_ratio: longest plausible readout time [frame intervals].
        watch: called for every frame.

    Raises:
        UnshutterError: the clip cannot be read.
    """
    camera, steps = (
        CameraMotion(readout=readout),
        Steps("looking", clip.expected_frames(options.start, options.end), watch),
    )
    reach = longest_ratio * options.undo.strength * (0.5 if options.undo.reference == "middle" else 1.0)
    largest, frames, lost = 0.0, 0, 0
    before = grey_before = None
    for frame in ahead(clip.iter_frames(options.start, options.end), 3):
        grey = look(clip, frame, camera, 1.0).grey
        interval = clip.since(before, frame) or 1.0
        if grey_before is not None:
            scale = min(clip.height, clip.width) / min(grey.shape)
            speed = _speed(follow(grey_before, grey), options.undo) * scale / interval
            lost += np.isnan(speed)
            largest = max(largest, reach * (0.0 if np.isnan(speed) else speed))
            if largest >= LEAST_PX - _ROUNDING_PX:
                return None
        before, grey_before, frames = frame, grey, frames + 1
        steps.advance()
    return None if lost > _LOST_SHARE * frames or frames < 2 else Visibility(largest, frames)


def _speed(tracks: Tracks, undo: ClipUndo) -> float:
    """Returns the 95th percentile of the tracks' displacement from one frame to the next [px of the copy].

    NaN if the frames cannot be tracked.
    """
    straightened = background(tracks)
    if not straightened.joined:
        return float("nan")
    moved = tracks if undo.model == "dense" else straightened.tracks
    return float(np.percentile(np.hypot(*(moved.end - moved.start).T), _FAST_SHARE))
