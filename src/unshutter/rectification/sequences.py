"""Rectifies photos with the help of their neighbours in time, by one motion of the camera or a motion of every pixel.

What the photo itself did not see is taken from its neighbours where they saw it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from itertools import chain, islice, pairwise
from typing import Literal

import numpy as np

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.frames.frame import Frame, pixels_like
from unshutter.frames.frame_motion import Timing
from unshutter.frames.model_choice import better_model
from unshutter.frames.neighbours import copy_side, render_moment
from unshutter.frames.sequence import SEARCHED, CameraMotion, FrameMotion, stated_ratio
from unshutter.frames.usual_ratio import FEW, usual_ratio
from unshutter.motion import Motion, RowMotion
from unshutter.motion.edges import EdgePolicy, valid_window
from unshutter.motion.finding import Finding
from unshutter.motion.grid import Tile
from unshutter.motion.verdict import Verdict, judge
from unshutter.options import Camera, Clock, Edges, Find, FrameModel, Neighbours, Reference, Undo, model_for
from unshutter.options.fields import for_python, from_keywords
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.photo.auxiliary_pictures import Auxiliaries
from unshutter.photo.photo import PhotoLike, files_behind, open_photo
from unshutter.photo.placement import Placement
from unshutter.readout_time import ReadoutRatio, ReadoutSource
from unshutter.reasons import Cause, MotionSource
from unshutter.rectification.auxiliaries import sampled_auxiliaries, undone_in_auxiliaries
from unshutter.rectification.borrowing import borrow
from unshutter.rectification.find import find
from unshutter.rectification.rectified import Rectified, Result, placement, render
from unshutter.storage.opened import Opened

Model = Literal["camera", "dense", "alone"]


@dataclass(frozen=True)
class SequenceOptions:
    """Options for rectifying the frames of a sequence.

    Raises:
        UsageError: the options contradict each other, or the time is too far away.
    """

    time: ReadoutRatio | None  # readout time in frame intervals; None if unknown
    undo: Undo  # reference row, strength and edges
    scan_direction: ScanDirection  # direction in which the stored pixels were read
    # time of the picture, in frame intervals from the frame's first row; None for that of the reference row
    at: float | None = None
    # motion model; None for the one other options require, otherwise the one that fits the frames
    model: FrameModel | None = None
    focal_px: float | None = None  # focal length of the camera [px of the photo]; None to use EXIF's, or estimate it
    # how motion is estimated from the photo alone if its neighbours are inconclusive; None not to
    alone: Find | None = None
    uncropped: bool = False  # whether pictures keep their size even where a crop is decided, as for the screen

    def __post_init__(self) -> None:
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"the moment must lie between -1 and 1 frame intervals, got {self.at:g}")
        _ = self.needed_model  # raises if no model supports all options

    @property
    def needed_model(self) -> FrameModel | None:
        """The motion model the options require; None if the frames decide."""
        return model_for(self.model, self.at, self.undo)

    def timing(self, height: int) -> Timing:
        """Returns the clock of frames with this number of rows."""
        if self.time is None:
            raise UsageError(
                "give the readout time: {--readout-ratio} (readout time / time from frame to frame), or "
                "{--readout-ms} with {--fps}"
            )
        return Timing(self.time.value, height)

    def moment(self, timing: Timing) -> float:
        """Returns the time of the picture, in frame intervals from the frame's first row."""
        return timing.moment(self.undo.reference or "first") if self.at is None else self.at


@dataclass(frozen=True, repr=False)
class RectifiedFrame(Result):
    """A photo rectified with the help of its neighbours.

    Attributes:
        valid: bool [H, W], where the original (or a neighbour, if pixels were borrowed) shows the content, before any
            crop or fill.
        model: motion model used: ``camera`` (one motion for the whole picture), ``dense`` (near and far objects move
            differently), or ``alone`` (the neighbours were inconclusive, so the photo alone was used).
        ratio: readout ratio that was found, or taken because so few frames do not show it; None if it was stated, is
            that of a whole sequence, or does not matter.
    """

    __slots__ = ("valid",)  # lets a field implement Result's abstract property

    _: KW_ONLY
    valid: np.ndarray
    model: Model = "dense"
    ratio: ReadoutRatio | None = None

    @property
    def motion(self) -> Motion | None:
        """The motion that was undone; None for dense motion, which is not that of the camera alone."""
        return None if self.model == "dense" else self.verdict.motion

    @classmethod
    def of(cls, result: Rectified, model: Model) -> RectifiedFrame:
        """Returns the result of rectifying a photo by one motion for the whole picture."""
        return cls(**vars(result), valid=result.valid, model=model)


def rectify_densely(
    before: Frame | None, current: Frame, after: Frame | None, options: SequenceOptions
) -> RectifiedFrame:
    """Rectifies a frame by the flow between it and its neighbours; call :meth:`Frame.connect` first."""
    frames, links = {0: current.pixels}, {}
    for side, neighbour, connection in ((-1, before, before and before.to_next), (1, after, current.to_next)):
        if neighbour is not None and connection is not None:
            theirs = pixels_like(neighbour, current.photo)
            frames[side], links[side] = np.ascontiguousarray(options.scan_direction.to_scan_frame(theirs)), connection
    timing = options.timing(frames[0].shape[0])
    edges = options.undo.edges
    picture = render_moment(
        frames,
        links,
        timing,
        options.moment(timing),
        borrow=edges in ("borrow", "auto"),
        fill=edges == "fill",
        masked=current.photo.masked,
    )
    back = -options.scan_direction.quarter_turns
    pixels, valid, own = (np.rot90(each, back) for each in (picture.pixels, picture.valid, picture.own))
    nothing = RowMotion.zero(*frames[0].shape[:2], scan_direction=options.scan_direction)
    no_single_motion = Finding(nothing, estimator="frames-dense", source=MotionSource.NEIGHBOURS)
    if picture.reason:
        return RectifiedFrame(current.photo, current.photo, Verdict(no_single_motion, 0.0, picture.reason), valid=valid)
    verdict = Verdict(no_single_motion, picture.largest_px)
    assert picture.grid is not None
    warp_auxiliaries = partial(sampled_auxiliaries, current.photo, picture.grid, options.scan_direction)
    return _framed(current.photo, verdict, pixels, valid, own, options, "dense", warp_auxiliaries)


def _framed(
    photo: Photo,
    verdict: Verdict,
    pixels: np.ndarray,
    valid: np.ndarray,
    own: np.ndarray,
    options: SequenceOptions,
    model: Model,
    warp_auxiliaries: Callable[[Edges, Tile], Auxiliaries | None],
) -> RectifiedFrame:
    """Returns the result with its edges handled.

    Args:
        valid: bool [H, W], what was seen by any frame that pixels were taken from.
        own: bool [H, W], what the photo itself saw.
        warp_auxiliaries: how edges were handled, and the part of the picture that is kept -> its auxiliary pictures.
    """
    asked = options.undo.edges
    edges, window, whole = EdgePolicy(asked).decide(valid.shape, lambda: valid_window(valid, any_shape=True))
    inside = slice(window.top, window.bottom), slice(window.left, window.right)
    if asked == "auto" and edges == "crop" and not own[inside].all():
        edges = "borrow"
    whole_frame = Tile(0, photo.height, 0, photo.width)
    if not options.uncropped:
        pixels = np.ascontiguousarray(pixels[inside])
        whole_frame = window
    size = photo.height, photo.width
    shown = Placement(size, pixels.shape[:2]) if model == "dense" else placement(photo, verdict, whole_frame)
    rectified = photo.with_pixels(pixels, shown, warp_auxiliaries(edges, whole_frame))
    return RectifiedFrame(rectified, photo, verdict, edges, whole, valid=valid, model=model)


# ---- a sequence, and one photo with its neighbours -----------------------------------------------------------------


@for_python(Clock, Camera, Undo, Neighbours)
def rectify_frames(
    frames: Iterable[PhotoLike],
    *,
    readout_ratio: float | None = None,
    readout_ms: float | None = None,
    fps: float | None = None,
    focal_px: float | None = None,
    readout: str = "auto",
    reference: Reference | None = None,
    at: float | None = None,
    edges: Edges = "auto",
    strength: float = 1.0,
    model: FrameModel | None = None,
    fallback: bool = False,
) -> Iterator[RectifiedFrame]:
    """Rectifies successive frames of one camera, each with the help of the previous and next ones.

    Three frames are held at a time; some 60 while the readout ratio is estimated.

    Args:
        frames: anything that :func:`rectify` accepts, in the order in which they were taken.
        focal_px: focal length [px of the frames]; by default EXIF's, otherwise it is estimated.
        at: time of the pictures, instead of a reference row, in frame intervals from each frame's first row, -1 to 1.
        fallback: whether a frame whose neighbours are inconclusive is rectified on its own.
        edges: as for :func:`rectify`, but ``auto`` is ``keep``: all frames keep their size and pixel coordinates.
            ``borrow`` takes what a frame did not see from its neighbours.

    Yields:
        The result for each frame.

    Raises:
        UnshutterError: a frame cannot be read, is too small, or has too little in common with its neighbour; or the
            readout ratio was not stated and more than three frames do not reveal it.
        UsageError: there are fewer than two frames, their sizes differ, or an option is invalid.

    Examples:
        >>> for frame in unshutter.rectify_frames(["a.jpg", "b.jpg", "c.jpg"], readout_ratio=0.7):
        ...     print(frame.changed)
        True
        True
        True
    """
    camera = from_keywords(Camera, {"readout": readout, "focal_px": focal_px, "readout_ms": readout_ms})
    undo = from_keywords(Undo, {"reference": reference, "edges": edges, "strength": strength}).keeping_coordinates()
    time = stated_ratio(from_keywords(Clock, {"readout_ratio": readout_ratio, "fps": fps}), camera)
    neighbours = from_keywords(Neighbours, {"sequence": True, "at": at, "model": model, "fallback": fallback})
    alone = Find() if neighbours.fallback else None
    options = SequenceOptions(
        time, undo, camera.scan_direction, neighbours.at, neighbours.model, camera.focal_px, alone
    )
    inputs = [opened for frame in frames for opened in files_behind(frame)] if isinstance(frames, Sequence) else []
    return _with_advice(_each(iter(frames), options, inputs))


def _with_advice(pictures: Iterator[RectifiedFrame]) -> Iterator[RectifiedFrame]:
    """Yields the pictures; adds to an UnknownRatioError the arguments that state the ratio."""
    try:
        yield from pictures
    except UnknownRatioError as error:
        raise error.with_advice("give readout_ratio, or readout_ms and fps") from None


def _each(frames: Iterator[PhotoLike], options: SequenceOptions, inputs: list[Opened]) -> Iterator[RectifiedFrame]:
    """Yields the result of each frame, which must not overwrite any input, including frames read from an iterator."""
    if options.time is None:
        head = list(islice(frames, SEARCHED))
        frames = chain(head, frames)
        options = with_ratio([open_photo(frame) for frame in head], options)
    before = current = None
    for source in frames:
        inputs += files_behind(source)
        following = Frame(source, options.scan_direction, inputs)
        if current is not None:
            yield _by_any_means(before, current, following, options)
        before, current = current, following
    if before is None or current is None:
        raise UsageError("needs at least two frames; for one photo, use unshutter.rectify")
    yield _by_any_means(before, current, None, options)


def with_ratio(frames: Sequence[Photo], options: SequenceOptions) -> SequenceOptions:
    """Returns the options with the readout ratio that the frames reveal or, of few frames, a usual one.

    They are returned unchanged if the ratio does not matter, because nothing moves, or if photos may be used alone.
    Raises UnknownRatioError if more than three frames do not reveal it.
    """
    finder = CameraMotion(None, options.focal_px, options.scan_direction)
    silent = [motion for motion in finder.frames(frames) if not motion.stood_still]
    if finder.ratio is not None:
        return replace(options, time=finder.ratio)
    if len(frames) <= FEW and options.alone is None:
        asked = any(motion.ratio_unknown for motion in silent) or options.needed_model == "dense"
        return replace(options, time=usual_ratio(frames)) if asked else options
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
        camera_motion: the camera's motion from a whole sequence; None to estimate it from these frames.
    """
    for each in (before, photo, after):
        if each is not None:
            each.start_decoding(grey_px=copy_side(each.height, each.width))
    earlier, later = (None if each is None else Frame(each, options.scan_direction) for each in (before, after))
    stated = options.time
    if stated is None and camera_motion is None:
        options = with_ratio([each for each in (before, photo, after) if each is not None], options)
    result = _by_any_means(earlier, Frame(photo, options.scan_direction), later, options, camera_motion)
    return result if stated is not None else replace(result, ratio=options.time)


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
    finding = find(current.photo, options.alone).choose(options.alone.candidate)
    return _rendered(current.photo, _judged(finding, current.photo, options), options, "alone")


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
    if camera_motion is None and (options.needed_model != "dense" or options.time is None):
        camera_motion = _camera_motion(frames, frames.index(current), options)
    if camera_motion is not None:
        if (camera_motion.stood_still and options.needed_model is None) or not camera_motion.ratio:
            options = replace(options, model="camera")
        else:
            options = replace(options, time=ReadoutRatio(camera_motion.ratio, source=ReadoutSource.FRAMES))
        if (options.needed_model or better_model(camera_motion, before, current, after)) == "camera":
            neighbours = {side: frame for side, frame in ((-1, before), (1, after)) if frame is not None}
            return rectify_by_camera(current.photo, camera_motion, options, neighbours)
    for first, second in pairwise(frames):
        first.connect(second)
    return rectify_densely(before, current, after, options)


def rectify_by_camera(
    photo: Photo, motion: FrameMotion, options: SequenceOptions, neighbours: Mapping[int, Frame] | None = None
) -> RectifiedFrame:
    """Rectifies a photo by the camera's motion that a sequence shows.

    Args:
        neighbours: -1 and 1 -> the frames before and after it, from which automatic edges are borrowed.
    """
    undo = options.undo
    verdict = _judged(motion.finding(undo.reference or "first"), photo, options)
    if neighbours and verdict.undoes and undo.edges == "auto" and undo.strength == 1:
        lenders = {side: pixels_like(frame, photo) for side, frame in neighbours.items()}
        borrowed = borrow(photo, verdict.motion, motion, lenders)
        if borrowed is not None:
            warp_auxiliaries = partial(undone_in_auxiliaries, photo, verdict)
            return _framed(photo, verdict, *borrowed, options, "camera", warp_auxiliaries)
    return _rendered(photo, verdict, options, "camera")


def _judged(finding: Finding, photo: Photo, options: SequenceOptions) -> Verdict:
    return judge(finding.fit(photo.height, photo.width), options.undo)


def _rendered(photo: Photo, verdict: Verdict, options: SequenceOptions, model: Model) -> RectifiedFrame:
    policy = EdgePolicy(options.undo.edges)
    edges = "keep" if options.uncropped and policy.may_crop else policy.edges
    return RectifiedFrame.of(render(photo, verdict, edges), model)


def _camera_motion(frames: list[Frame], number: int, options: SequenceOptions) -> FrameMotion:
    """Returns the camera's motion around one of a few frames."""
    finder = CameraMotion(options.time, options.focal_px, options.scan_direction)
    camera_motion = list(finder.frames(frame.photo for frame in frames))[number]
    if finder.ratio is None and camera_motion.ratio_unknown:
        raise _error_of(camera_motion)
    return camera_motion


def _error_of(motion: FrameMotion) -> UnknownRatioError:
    """Returns the error for a frame without motion because the readout ratio is unknown."""
    assert motion.reason is not None
    if motion.ratio_unknown:
        return UnknownRatioError(str(motion.reason), motion.reason)
    return UnknownRatioError.because(motion.reason)
