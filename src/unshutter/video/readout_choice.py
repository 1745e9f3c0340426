"""The readout time of a clip: stated by its file, by the table of cameras, by its frames, or the usual one.

No clip is refused because its readout time is unknown. The usual value comes with its range, and where frames cannot
show a difference at any time in that range, nothing has to be undone.
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

_PERCENTILES = (5, 50, 95)  # of the table: the range of a kind of camera, and its usual value
_SIMILAR_RATE = 1.3  # factor between frame rates at which cameras read out in similar times
_KINDS = {
    "phones": "apple samsung xiaomi redmi realme poco oneplus huawei honor zte ulefone oppo vivo nothing google",
    "action cameras and drones": (
        "gopro dji insta360 xtu runcam walksnail hawkeye caddx tomate sioeye foxeer akaso sjcam parrot autel skydio"
    ),
    "cameras": "sony canon nikon panasonic fujifilm blackmagic sigma red leica kinefinity olympus om hasselblad z",
}
_FAST_SHARE = 95  # per cent of the background's corners that move by no more than what counts
_LOST_SHARE = 0.05  # of pairs of frames that cannot be followed: with more, no bound is known
_ROUNDING_PX = 0.05


def readout_ratio_of_clip(
    clip: Clip, readout: Readout, shutter: Shutter, span: tuple[float, float], watch: Watch | None = None
) -> ReadoutRatio:
    """The readout ratio of a clip's camera; where nothing states or shows it, the usual one with its range.

    Args:
        clip: the clip; its tags name the camera where the user does not.
        readout: direction in which the stored pixels were read.
        shutter: the camera as far as the user knows it, but not its readout time.
        span: the part of the clip that is searched [s].
        watch: called for every part of it.

    Raises:
        UsageError: the user names a camera that the table does not have, or not in this mode.
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
    """The readout ratio that is usual for cameras of the clip's kind, by the table."""
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


# ---- how little there may be to see ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Visibility:
    """How much of a rolling shutter a clip can show.

    Attributes:
        largest_px: by how much rows of a frame differ at most, at the longest plausible readout time [px].
        frames: how many were looked at: all of the part that is kept.
    """

    largest_px: float
    frames: int


def too_little_to_see(
    clip: Clip, readout: Readout, options: RectifyClip, longest_ratio: float, watch: Watch | None = None
) -> Visibility | None:
    """The bound on what undoing the motion would change; None where that may be half a pixel or more.

    Ends at the first frames that may show more.

    Args:
        clip: the clip.
        readout: direction in which the stored pixels were read.
        options: the part that is kept, and how motion is undone.
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
    """How far nearly everything that is straightened moves from one frame to the next [px of the copy].

    NaN where the frames cannot be followed.
    """
    straightened = background(tracks)
    if not straightened.joined:
        return float("nan")
    moved = tracks if undo.model == "dense" else straightened.tracks
    return float(np.percentile(np.hypot(*(moved.end - moved.start).T), _FAST_SHARE))
