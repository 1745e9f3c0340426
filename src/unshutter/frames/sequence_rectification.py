"""Rectifies photos with the help of their neighbours in time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice, pairwise
from typing import Any, Unpack

import numpy as np

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.estimators.base import View
from unshutter.estimators.find import find_motion
from unshutter.estimators.register import load
from unshutter.frames.frame import Frame, RectifiedFrame, SequenceOptions, rectify_densely
from unshutter.frames.model_choice import better_model
from unshutter.frames.neighbours import copy_side
from unshutter.frames.sequence import SEARCHED, CameraMotion, FrameMotion, FramesOptions, known_ratio
from unshutter.options import Camera, Clock, Edges, Find, FrameModel, Neighbours, Undo
from unshutter.options.description import from_keywords, takes_options
from unshutter.photo import Photo
from unshutter.photo.argument import in_kind, is_bytes, is_file
from unshutter.reasons import Cause
from unshutter.result import undo


class RectifyFramesOptions(FramesOptions, total=False):
    """Keywords of :func:`rectify_frames`."""

    at: float | None
    edges: Edges
    strength: float
    model: FrameModel | None
    fallback: bool


@takes_options(RectifyFramesOptions, Clock, Camera, Undo, Neighbours)
def rectify_frames(
    frames: Iterable[str | os.PathLike[str] | np.ndarray | Photo], **options: Unpack[RectifyFramesOptions]
) -> Iterator[Any]:
    """Rectifies successive frames of one camera, each with the help of the previous and next ones.

    Three frames are held at a time; some 60 while the readout ratio is estimated.

    Args:
        frames: anything that :func:`rectify` accepts, in the order in which they were taken.
        focal_px: focal length [px of the frames]; by default EXIF's, otherwise it is estimated.
        at: time of the pictures, instead of a reference row, in frame intervals from each frame's first row, -1 to 1.
        fallback: whether a frame whose neighbours are inconclusive is rectified on its own.
        **options: frame rate, readout time, and how motion is undone.

    Yields:
        For each frame a :class:`RectifiedFrame`; for pixels (arrays and Pillow images), pixels.

    Raises:
        UnshutterError: a frame cannot be read, is too small, or has too little in common with its neighbour; or the
            readout ratio was not stated and the frames do not reveal it.
        UsageError: there are fewer than two frames, their sizes differ, or an option is invalid.

    Examples:
        >>> for frame in unshutter.rectify_frames(["a.jpg", "b.jpg", "c.jpg"], readout_ratio=0.7):
        ...     print(frame.changed)
        True
        True
        True
    """
    ratio, milliseconds, fps = options.get("readout_ratio"), options.get("readout_ms"), options.get("fps")
    clock, undoing = Clock(ratio, fps, milliseconds), from_keywords(Undo, options).keeping_coordinates()
    known_ratio(ratio, milliseconds, fps)  # raises if only part of it is stated
    camera, alone = from_keywords(Camera, options), Find() if options.get("fallback") else None
    model = options.get("model")
    of_frames = SequenceOptions(clock, undoing, camera.direction, options.get("at"), model, camera.focal_px, alone)
    return _with_advice(_each(iter(frames), of_frames))


def _with_advice(pictures: Iterator[Any]) -> Iterator[Any]:
    """Yields the pictures; adds to an UnknownRatioError the arguments that state the ratio."""
    try:
        yield from pictures
    except UnknownRatioError as error:
        raise error.with_advice("give readout_ratio, or readout_ms and fps") from None


def _each(frames: Iterator[Any], options: SequenceOptions) -> Iterator[Any]:
    if not options.clock.is_known:
        head = list(islice(frames, SEARCHED))
        frames = chain(head, frames)
        options = _with_ratio(head, options)
    before = current = None
    for source in frames:
        following = Frame(source, options.readout)
        if current is not None:
            yield _in_kind(current, _by_any_means(before, current, following, options))
        before, current = current, following
    if before is None or current is None:
        raise UsageError("needs at least two frames: one photo alone is for unshutter.rectify")
    yield _in_kind(current, _by_any_means(before, current, None, options))


def _with_ratio(frames: list[Any], options: SequenceOptions) -> SequenceOptions:
    """Returns the options with the readout ratio that the frames reveal; unchanged if nothing moves in them."""
    finder = CameraMotion(None, options.focal_px, options.readout)
    silent = [motion for motion in finder.frames(frames) if not motion.stood_still]
    if finder.ratio is not None:
        return replace(options, clock=Clock(finder.ratio.value))
    if silent and options.alone is None and len(frames) > 1:
        raise _error_of(next((motion for motion in silent if motion.ratio_unknown), silent[0]))
    return options


def rectify_between(
    photo: Photo,
    before: Photo | None,
    after: Photo | None,
    options: SequenceOptions,
    camera_motion: FrameMotion | None = None,
) -> RectifiedFrame:
    """Rectifies one photo with the help of the previous frame, the next one, or both.

    Args:
        photo, before, after: in the order before, photo, after.
        options: how the photo is rectified.
        camera_motion: the camera's motion from a whole sequence; None to estimate it from these frames.

    Raises:
        UnshutterError, UsageError: see :func:`rectify_frames`.
    """
    for each in (before, photo, after):
        if each is not None:
            each.start_decoding(grey_px=copy_side(each.height, each.width))
    earlier, later = (None if each is None else Frame(each, options.readout) for each in (before, after))
    return _by_any_means(earlier, Frame(photo, options.readout), later, options, camera_motion)


def _by_any_means(
    before: Frame | None,
    current: Frame,
    after: Frame | None,
    options: SequenceOptions,
    camera_motion: FrameMotion | None = None,
) -> RectifiedFrame:
    """Rectifies a frame by its neighbours or, if they are inconclusive and the options allow it, on its own."""
    try:
        result = _by_neighbours(before, current, after, options, camera_motion)
    except UsageError:
        raise
    except UnshutterError:
        if options.alone is None:
            raise
    else:
        if options.alone is None or result.verdict.cause is not Cause.NO_EVIDENCE:
            return result
    motion = find_motion(load(options.alone.estimator), View(current.photo, options.alone.camera))
    return RectifiedFrame.of(undo(current.photo, motion, options.undo), "alone")


def _by_neighbours(
    before: Frame | None,
    current: Frame,
    after: Frame | None,
    options: SequenceOptions,
    camera_motion: FrameMotion | None,
) -> RectifiedFrame:
    frames = [frame for frame in (before, current, after) if frame is not None]
    for first, second in pairwise(frames):
        first.check_like(second)
    if camera_motion is None and (options.needed_model != "dense" or not options.clock.is_known):
        camera_motion = _camera_motion(frames, frames.index(current), options)
    if camera_motion is not None:
        if (camera_motion.stood_still and options.needed_model is None) or not camera_motion.ratio:
            options = replace(options, model="camera")
        else:
            options = replace(options, clock=Clock(camera_motion.ratio))
        if (options.needed_model or better_model(camera_motion, before, current, after)) == "camera":
            motion = camera_motion.motion(options.undo.reference or "first")
            return RectifiedFrame.of(undo(current.photo, motion, options.undo), "camera")
    for first, second in pairwise(frames):
        first.connect(second)
    return rectify_densely(before, current, after, options)


def _camera_motion(frames: list[Frame], number: int, options: SequenceOptions) -> FrameMotion:
    """Returns the camera's motion around one of a few frames.

    Raises:
        UnknownRatioError: the readout ratio was not stated and the frames do not reveal it.
    """
    ratio = known_ratio(options.clock.ratio) if options.clock.is_known else None
    finder = CameraMotion(ratio, options.focal_px, options.readout, every_angle=1)
    camera_motion = list(finder.frames(frame.photo for frame in frames))[number]
    if finder.ratio is None and not camera_motion.stood_still:
        raise _error_of(camera_motion)
    return camera_motion


def _error_of(motion: FrameMotion) -> UnknownRatioError:
    """Returns the error for a frame without motion because the readout ratio is unknown."""
    assert motion.reason is not None
    if motion.ratio_unknown:
        return UnknownRatioError(str(motion.reason), motion.reason)
    return UnknownRatioError.because(motion.reason)


def _in_kind(frame: Frame, result: RectifiedFrame) -> Any:
    """Returns the result itself for an encoded frame, and pixels for pixels."""
    if is_file(frame.source) or is_bytes(frame.source):
        return result
    return in_kind(frame.source, result.to_array() if result.changed else None)
