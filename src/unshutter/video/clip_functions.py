"""Python API for clips: a whole file, or frames from your own decoder."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from unshutter.errors import UnknownRatioError, UsageError
from unshutter.frames.sequence import stated_ratio
from unshutter.options import Camera, Clock, Edges, FrameModel, Reference
from unshutter.options.clip_options import (
    GYRO_OFF,
    MAX_CLIP_PIXELS,
    ClipUndo,
    RectifyClip,
    Shutter,
    Steadiness,
)
from unshutter.options.fields import check_time, for_python, from_keywords, implemented_by
from unshutter.progress import ClipObserver
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.decision import Decision, Leave, calibrate_and_decide
from unshutter.video.file.array_clip import ArrayClip, FirstFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.pixels import ArrayFrame
from unshutter.video.outcome import ClipOutcome
from unshutter.video.render.frame_warper import Warper
from unshutter.video.render.rendering import Rendering, with_views

_FOR_READOUT, _FOR_LENS = 240, 80  # frames of an iterator that are examined for the readout time, or only for the lens


def _rectify_clip(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    progress: Callable[[str, int, int], None] | None,
    on_readout: Callable[[ReadoutTime, float], None] | None,
    options: RectifyClip,
) -> ClipOutcome:
    return rectify_clip_file(os.fspath(source), os.fspath(output), options, observer=_Caller(progress, on_readout))


@implemented_by(_rectify_clip, options=RectifyClip)
def rectify_clip(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    progress: Callable[[str, int, int], None] | None = None,
    on_readout: Callable[[ReadoutTime, float], None] | None = None,
    readout_ms: float | None = None,
    readout_ratio: float | None = None,
    camera: str | None = None,
    readout: str = "auto",
    focal_px: float | None = None,
    lens: str | None = None,
    gyro: str | None = None,
    reference: Reference = "middle",
    strength: float = 1.0,
    edges: Edges = "auto",
    model: FrameModel = "camera",
    stabilize: float | None = None,
    zoom_limit: float | None = None,
    level: bool = False,
    codec: str | None = None,
    crf: float | None = None,
    bitrate: Literal["same"] | None = None,
    preset: str | None = None,
    start: float | None = None,
    end: float | None = None,
    motion: str | Path | None = None,
    save_motion: str | Path | None = None,
    save_gyro: str | Path | None = None,
    preview: str | Path | None = None,
    plot: str | Path | None = None,
    progressive: bool = False,
    straight_lines: bool = False,
    only_changed: bool = False,
    overwrite: bool = False,
    json_log: str | Path | None = None,
    max_pixels: int = MAX_CLIP_PIXELS,
) -> ClipOutcome:
    """Writes a clip without its rolling-shutter distortion; prints nothing.

    Args:
        source: a video.
        output: the file to write.
        progress: called with the name of a step, the number of its parts that are done, and the expected total.
        on_readout: called with the readout time and the frame interval [s] once the time is found; not called if
            you state it.

    Returns:
        The number of rectified frames, why others were left unchanged, and the readout time with its source.

    Raises:
        UsageError: options contradict each other, or do not suit the clip.
        UnshutterError: the clip cannot be read, or the output cannot be written.

    Examples:
        >>> outcome = unshutter.rectify_clip("walk.mp4", "straight.mp4", readout_ratio=0.6)
        >>> outcome.frames
        16
    """
    ...


@dataclass
class _Caller(ClipObserver):
    """Tells the caller of a function how the work goes on."""

    progress: Callable[[str, int, int], None] | None
    on_readout: Callable[[ReadoutTime, float], None] | None

    def note_progress(self, what: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(what, done, total)

    def note_readout(self, time: ReadoutTime, interval_s: float) -> None:
        if self.on_readout is not None:
            self.on_readout(time, interval_s)


# ---- frames from your own decoder -----------------------------------------------------------------------------


@for_python(Clock, Camera, ClipUndo, Steadiness)
def rectify_clip_frames(
    frames: Iterable[np.ndarray],
    *,
    readout_ratio: float | None = None,
    readout_ms: float | None = None,
    fps: float | None = None,
    focal_px: float | None = None,
    readout: str = "auto",
    reference: Reference = "middle",
    strength: float = 1.0,
    edges: Edges = "auto",
    stabilize: float | None = None,
    zoom_limit: float | None = None,
) -> Iterator[np.ndarray]:
    """Rectifies the frames of a clip that you decode yourself, using one camera motion for each whole frame.

    Frames are examined as those of a file are (:func:`rectify_clip`): for the lens, and without a readout ratio also
    for the readout time and direction, and for whether undoing the motion makes them better; if not, they are yielded
    as they are. Of a list, a tuple or an array [N, H, W, ...], parts are examined first, or all frames. Of any other
    iterable, only the first 240 frames are, or 80 if the ratio is given: these are held in memory, and tell what is
    done to all, and how much all are enlarged. Frames are yielded in order: the first once those have been read, later
    ones some 30 frames after they are read.

    Args:
        frames: uint8 or uint16 arrays [H, W] or [H, W, bands] of one size, in the order in which they were taken, at
            even intervals. Each must have memory of its own, since several are held.
        readout_ratio: readout time of a frame, in frame intervals (above 0, at most 1). Without it, and without
            ``readout_ms`` and ``fps``, it is estimated from the frames, if they reveal it.
        readout: direction in which the sensor was read out; auto: estimated together with the ratio.
        focal_px: focal length [px of the frames]; by default it is estimated from the frames, and so is the lens.
        edges: areas outside the original frame: ``auto`` enlarges all frames alike, by at most 5 %, until none shows,
            as far as the examined frames tell, and repeats the border where 1 % of the width or less is missing, or
            more than that hides; ``keep`` leaves them black, ``fill`` mirrors the frame.
        fps: frames per second, for ``readout_ms`` and for ``stabilize``, which assumes 30 by default.
        stabilize: also smooth the camera's path: movements shorter than this many seconds are removed. This takes
            two passes, so ``frames`` must be a list, or an object that starts again each time it is iterated over;
            the first frame is yielded after the first pass.

    Yields:
        Each frame as a new array, or the frame itself if it does not change.

    Raises:
        UsageError: an option is invalid, the arrays are of another kind, or an iterator is to be stabilised.
        UnknownRatioError: the readout ratio was not stated, and the examined frames do not reveal it; also if the
            camera stands still in them, and more follow.
        UnshutterError: the frames are too small, or differ in size or type.

    Examples:
        >>> frames = (np.zeros((120, 160, 3), np.uint8) for _ in range(10))  # from any decoder
        >>> sum(1 for frame in unshutter.rectify_clip_frames(frames, readout_ratio=0.6))
        10
    """
    known = from_keywords(Camera, {"readout": readout, "focal_px": focal_px, "readout_ms": readout_ms})
    for_ratio = None if stabilize is not None and readout_ms is None else fps
    ratio = stated_ratio(from_keywords(Clock, {"readout_ratio": readout_ratio, "fps": for_ratio}), known)
    options = RectifyClip(
        Shutter(readout_ratio=ratio and ratio.value, readout=known.readout, focal_px=focal_px, gyro=GYRO_OFF),
        from_keywords(ClipUndo, {"reference": reference, "strength": strength, "edges": edges}),
        from_keywords(Steadiness, {"stabilize": stabilize, "zoom_limit": zoom_limit}),
    )
    if edges not in ("auto", "keep", "fill"):
        raise UsageError(f"for frames in arrays, edges must be auto, keep or fill, not {edges}")
    check_time("fps", fps, "frames per second")
    if not isinstance(frames, Iterable):
        raise UsageError("frames must be a list, or another iterable, of arrays")
    if stabilize is not None and isinstance(frames, Iterator):
        raise UsageError(
            "stabilize needs the frames twice: pass a list, or an object that begins again each time it is "
            "iterated over"
        )
    return _rectified(frames, options, 1 / (fps or 30.0))


def _rectified(frames: Iterable[np.ndarray], options: RectifyClip, interval_s: float) -> Iterator[np.ndarray]:
    examined = frames
    if not isinstance(examined, Sequence | np.ndarray):
        examined = FirstFrames(iter(frames), _FOR_READOUT if options.shutter.readout_ratio is None else _FOR_LENS)
    clip = ArrayClip.of(examined, interval_s)
    if clip is None:
        return
    request, camera, decision = calibrate_and_decide(ClipRequest.of(clip, options))
    reason = camera.readout_time.instead_of
    if reason is not None and not _shows_nothing(decision, examined):
        raise UnknownRatioError(str(reason), reason).with_advice("give readout_ratio, or readout_ms and fps")
    rendering = Rendering(request, camera, decision)
    if options.steadiness.stabilize is not None and isinstance(examined, FirstFrames):
        rendering = replace(rendering, request=replace(request, clip=replace(clip, arrays=examined.take_all())))
    rendering = with_views(rendering)
    decoded = clip.frames_between()
    if options.steadiness.stabilize is not None:
        assert rendering.path is not None
        decoded = _once_more(replace(clip, arrays=frames), len(rendering.path))
    elif isinstance(examined, FirstFrames):  # the motion of those that follow is not known
        clip = replace(clip, arrays=examined.take_all())
        rendering = replace(rendering, request=replace(request, clip=clip), path=None)
        decoded = clip.frames_between()
    warper = Warper(clip, options.undo)
    for moving in rendering.moving(decoded):
        (pixels,) = clip.pixels.arrays(warper.rectified(moving).picture)
        yield pixels


def _once_more(clip: ArrayClip, expected: int) -> Generator[ArrayFrame]:
    """Yields the frames again; raises UsageError if they are not as many as in the first pass."""
    number = 0
    for number, frame in enumerate(clip.frames_between(), 1):
        if number > expected:
            break
        yield frame
    if number != expected:
        more = "more" if number > expected else "fewer"
        raise UsageError(f"the second pass has {more} frames than the first: stabilize needs all of them twice")


def _shows_nothing(decision: Decision, frames: Iterable[np.ndarray]) -> bool:
    """Whether no readout time could make a difference, in any of the frames."""
    is_still = isinstance(decision, Leave) and decision.reason.code is Code.NOTHING_TO_SEE
    return is_still and not (isinstance(frames, FirstFrames) and frames.has_more)
