"""Python API for clips: a whole file, or frames from your own decoder."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.frames.frame_motion import FrameMotion
from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.sequence import CameraMotion, stated_ratio
from unshutter.frames.tracks import TRACKED_SIDE
from unshutter.motion import Motion
from unshutter.options import Camera, Clock, FrameModel, Reference
from unshutter.options.clip_options import MAX_CLIP_PIXELS, ClipEdges, ClipUndo, RectifyClip, Steadiness
from unshutter.options.fields import check_time, for_python, from_keywords, implemented_by
from unshutter.photo.photo import check_size
from unshutter.progress import ClipObserver
from unshutter.readout_time import ReadoutTime
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.frame_map import FrameMap, Scratch, SteadyView, undone_part, warp_plane
from unshutter.video.frame_warper import COPY_SIDE, FEWEST, small_finding, window_for
from unshutter.video.lenses import lens_in_greys
from unshutter.video.outcome import ClipOutcome
from unshutter.video.pixels import small_grey
from unshutter.video.stabilisation import CameraPath, stabilised

_MOST_BANDS = 4


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
    edges: ClipEdges = "fill",
    model: FrameModel = "camera",
    stabilize: float | None = None,
    zoom_limit: float | None = None,
    level: bool = False,
    codec: str | None = None,
    crf: float | None = None,
    preset: str | None = None,
    start: float | None = None,
    end: float | None = None,
    motion: str | Path | None = None,
    save_motion: str | Path | None = None,
    preview: str | Path | None = None,
    plot: str | Path | None = None,
    straight_lines: bool = False,
    only_changed: bool = False,
    overwrite: bool = False,
    json_log: str | Path | None = None,
    max_pixels: int = MAX_CLIP_PIXELS,
) -> ClipOutcome:
    """Writes a clip without its rolling-shutter distortion; prints nothing.

    Args:
        source: a film.
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
    edges: ClipEdges = "fill",
    stabilize: float | None = None,
    zoom_limit: float | None = None,
) -> Iterator[np.ndarray]:
    """Rectifies the frames of a clip that you decode yourself, using one camera motion for each whole frame.

    Frames are yielded in order, some 30 frames after they are read, and as many are held in memory; up to 240 while
    the readout ratio is estimated, and up to 80 while the lens is.

    Args:
        frames: uint8 or uint16 arrays [H, W] or [H, W, bands] of one size, in the order in which they were taken, at
            even intervals.
        readout_ratio: readout time of a frame, in frame intervals (above 0, at most 1). Without it, and without
            ``readout_ms`` and ``fps``, it is estimated from the frames, if they reveal it.
        focal_px: focal length [px of the frames]; by default it is estimated from the frames, and so is the lens.
        edges: areas outside the original frame: ``fill`` mirrors the frame, ``keep`` leaves them black.
        fps: frames per second, for ``readout_ms`` and for ``stabilize``, which assumes 30 by default.
        stabilize: also smooth the camera's path: movements shorter than this many seconds are removed. This takes
            two passes, so ``frames`` must be a list, or an object that starts again each time it is iterated over;
            the first frame is yielded after the first pass.

    Yields:
        Each frame as a new array, or the frame itself if it does not change.

    Raises:
        UsageError: an option is invalid, the arrays are of another kind, or an iterator is to be stabilised.
        UnknownRatioError: the readout ratio was not stated, and the frames do not reveal it.

    Examples:
        >>> frames = (np.zeros((120, 160, 3), np.uint8) for _ in range(10))  # from any decoder
        >>> sum(1 for frame in unshutter.rectify_clip_frames(frames, readout_ratio=0.6))
        10
    """
    known = from_keywords(Camera, {"readout": readout, "focal_px": focal_px, "readout_ms": readout_ms})
    undo = from_keywords(ClipUndo, {"reference": reference, "strength": strength, "edges": edges})
    steadiness = from_keywords(Steadiness, {"stabilize": stabilize, "zoom_limit": zoom_limit})
    for_ratio = None if stabilize is not None and readout_ms is None else fps
    ratio = stated_ratio(from_keywords(Clock, {"readout_ratio": readout_ratio, "fps": for_ratio}), known)
    if undo.edges not in ("fill", "keep"):
        raise UsageError(f"for frames from an iterator, edges must be fill or keep, not {undo.edges}")
    camera = CameraMotion(ratio, focal_px, known.direction, fewest=FEWEST, whole_path=stabilize is not None)
    if stabilize is None:
        return _rectified(iter(frames), camera, undo)
    if iter(frames) is frames:
        raise UsageError(
            "stabilize needs the frames twice: pass a list, or an object that begins again each time it is "
            "iterated over"
        )
    check_time("fps", fps, "frames per second")
    return _steady(frames, camera, undo, steadiness, fps or 30.0)


def _rectified(frames: Iterator[np.ndarray], camera: CameraMotion, undo: ClipUndo) -> Iterator[np.ndarray]:
    scratch = Scratch()
    for frame, motion in _with_motion(frames, camera):
        yield _undone(frame, small_finding(motion).motion, undo, scratch)


def _steady(
    frames: Iterable[np.ndarray], camera: CameraMotion, undo: ClipUndo, steadiness: Steadiness, fps: float
) -> Iterator[np.ndarray]:
    path = None
    last = None
    for frame, motion in _with_motion(iter(frames), camera):
        height, width = camera.readout.frame_size(*frame.shape[:2])
        path = path or CameraPath(undo, camera.readout, width / height, camera.lens)
        small = small_finding(motion)
        cut = last is not None and motion.scene != last.scene
        path.add(small, motion.step_from(last), cut, len(path) / fps)
        last = motion
    if path is None:
        return
    steady = stabilised(path, steadiness, 1 / fps)
    scratch = Scratch()
    for k, frame in enumerate(frames):
        if k == len(path):
            raise UsageError("the second pass has more frames than the first")
        yield _undone(frame, path.finding(k).motion, undo, scratch, steady.view(k))


def _with_motion(frames: Iterator[np.ndarray], camera: CameraMotion) -> Iterator[tuple[np.ndarray, FrameMotion]]:
    """Yields frames with their motion, some frames after reading them."""
    first = next(frames, None)
    if first is None:
        return
    camera.window = window_for(first.nbytes)
    searched = camera.ratio is None
    looked_at: list[np.ndarray] = []
    waiting: deque[np.ndarray] = deque()

    def greys(
        frames: Iterable[np.ndarray], side: int, into: list[np.ndarray] | deque[np.ndarray]
    ) -> Iterator[np.ndarray]:
        for frame in frames:
            _check(frame, first)
            into.append(frame)
            yield np.ascontiguousarray(camera.readout.turn(small_grey(frame, side, 8 * frame.itemsize)))

    frames = chain([first], frames)
    if camera.focal_px is None:
        camera.lens = lens_in_greys(greys(frames, TRACKED_SIDE, looked_at))
    size = camera.readout.frame_size(*first.shape[:2])
    copies = greys(chain(looked_at, frames), COPY_SIDE, waiting)
    for motion in camera.motions(GreyFrame(*size, grey) for grey in copies):
        if motion.ratio_unknown and motion.reason is not None and searched:
            error = UnknownRatioError(str(motion.reason), motion.reason)
            raise error.with_advice("give readout_ratio, or readout_ms and fps")
        yield waiting.popleft(), motion


def _check(frame: np.ndarray, first: np.ndarray) -> None:
    """Raises UsageError if this is not a frame; UnshutterError if it differs in size or type from the first one."""
    if not isinstance(frame, np.ndarray) or frame.dtype not in (np.uint8, np.uint16) or frame.ndim not in (2, 3):
        raise UsageError("frames must be uint8 or uint16 arrays [H, W] or [H, W, bands]")
    if frame.ndim == 3 and not 1 <= frame.shape[2] <= _MOST_BANDS:
        raise UsageError(f"frames must have 1 to {_MOST_BANDS} bands, got {frame.shape[2]}")
    if (frame.shape, frame.dtype) != (first.shape, first.dtype):
        shapes = [f"{each.dtype} {'x'.join(map(str, each.shape))}" for each in (first, frame)]
        raise UnshutterError(f"frames must have the same size and type: the first is {shapes[0]}, another {shapes[1]}")
    check_size(frame.shape[0], frame.shape[1], "a frame")


def _undone(
    frame: np.ndarray, motion: Motion, undo: ClipUndo, scratch: Scratch, view: SteadyView | None = None
) -> np.ndarray:
    motion = undone_part(motion, undo)
    if motion.is_zero and view is None:
        return frame
    pixels = np.ascontiguousarray(frame)
    out = np.empty(frame.shape, frame.dtype)
    limit = int(np.iinfo(frame.dtype).max)
    for rows, positions in FrameMap.of(motion, frame.shape[0], frame.shape[1], view).positions(1, 1, scratch):
        warp_plane(pixels, positions, out[rows], [0] * 4 if undo.edges == "keep" else None, limit)
    return out
