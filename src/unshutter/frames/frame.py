"""A photo as a frame of a sequence: its neighbours, the options for rectifying it, the result, and the dense model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.neighbours import Link, copy_side, link, render
from unshutter.frames.timing import Timing
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, follow
from unshutter.geometry.readout import Readout
from unshutter.motion import Motion
from unshutter.motion.verdict import Verdict
from unshutter.options import Clock, Edges, Find, FrameModel, Undo, model_for
from unshutter.photo import Photo
from unshutter.photo.argument import check_size, open_photo
from unshutter.result import Rectified, Result
from unshutter.warp.edges import EdgePolicy, valid_window

Model = Literal["camera", "dense", "alone"]


class Frame:
    """A photo of a sequence, and the flow to the next one.

    Attributes:
        source: what the caller passed: a path, encoded bytes, pixels or a Photo.
        photo: the source as a Photo.
        to_next: the flow to the next frame; None until computed.
    """

    def __init__(self, source: Any, readout: Readout) -> None:
        self.source, self.photo, self._readout = source, open_photo(source), readout
        self.to_next: Link | None = None
        check_size(*self._size, "{photo}", photo=self.name)

    @property
    def name(self) -> str:
        """Name of the frame in messages."""
        return str(self.photo.path or "the photo")

    @property
    def pixels(self) -> np.ndarray:
        """Pixels [H, W, bands] in the readout frame."""
        return np.ascontiguousarray(self._readout.turn(self.photo.pixels))

    @cached_property
    def _tracked(self) -> np.ndarray:
        """The grey copy [h, w] in which corners are tracked."""
        return np.ascontiguousarray(self._readout.turn(self.photo.grey(TRACKED_SIDE)))

    def check_like(self, following: Frame) -> None:
        """Raises UnshutterError if the next frame has another size or number of bands."""
        if self._size != following._size:
            sizes = [f"{width}x{height} px" for height, width in (self._size, following._size)]
            raise UnshutterError(
                f"{{photo}} has {sizes[0]} but {{neighbour}} has {sizes[1]}: neighbours must be of one size",
                photo=self.name,
                neighbour=following.name,
            )
        if self.photo.bands != following.photo.bands:
            raise UnshutterError(
                f"{{photo}} has {self.photo.bands} bands but {{neighbour}} has {following.photo.bands}: "
                "neighbours must be of one kind",
                photo=self.name,
                neighbour=following.name,
            )

    def connect(self, following: Frame) -> None:
        """Computes the flow to the next frame, once; call :meth:`check_like` first.

        Raises:
            UnshutterError: the next frame shows something else.
        """
        if self.to_next is None:
            self.to_next = link(self._copy, following._copy)

    def tracks_to(self, following: Frame) -> Tracks:
        """Tracks corners to the next frame."""
        return follow(self._tracked, following._tracked)

    @property
    def _size(self) -> tuple[int, int]:
        return self.photo.height, self.photo.width

    @cached_property
    def _copy(self) -> np.ndarray:
        """The small grey copy [h, w] in which motion is estimated."""
        return np.ascontiguousarray(self._readout.turn(self.photo.grey(copy_side(*self._size))))


@dataclass(frozen=True)
class SequenceOptions:
    """Options for rectifying the frames of a sequence.

    Attributes:
        clock: frame rate and readout time, as far as known.
        undo: reference row, strength and edges.
        readout: direction in which the stored pixels were read.
        at: time of the picture, in frame intervals from the frame's first row; None for that of the reference row.
        model: motion model; None for the one other options require, otherwise the one that fits the frames.
        focal_px: focal length of the camera [px of the photo]; None to use EXIF's, or estimate it.
        alone: how motion is estimated from the photo alone if its neighbours are inconclusive; None not to.

    Raises:
        UsageError: the options contradict each other, or the time is too far away.
    """

    clock: Clock
    undo: Undo
    readout: Readout
    at: float | None = None
    model: FrameModel | None = None
    focal_px: float | None = None
    alone: Find | None = None

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
        return Timing(self.clock.ratio, height)

    def moment(self, timing: Timing) -> float:
        """Returns the time of the picture, in frame intervals from the frame's first row."""
        return timing.moment(self.undo.reference or "first") if self.at is None else self.at


@dataclass(frozen=True)
class RectifiedFrame(Result):
    """A photo rectified with the help of its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original.
        valid: bool [H, W], where the original (with ``borrow``: or a neighbour) shows the content, before any crop or
            fill.
        original: the photo as it was read.
        verdict: whether its pixels were changed, and if not, why.
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``: the treatment of areas that the photo does not show.
        whole: share of the photo's area that a crop leaves; None if no crop was considered.
        model: motion model used: ``camera`` (one motion for the whole picture), ``dense`` (near and far objects move
            differently), or ``alone`` (the neighbours were inconclusive, so the photo alone was used).
        motion: the motion that was undone; None for dense motion, which is not that of the camera alone.
    """

    photo: Photo
    valid: np.ndarray
    original: Photo
    verdict: Verdict
    edges: Edges = "keep"
    whole: float | None = None
    model: Model = "dense"
    motion: Motion | None = None

    @classmethod
    def of(cls, result: Rectified, model: Model) -> RectifiedFrame:
        """Wraps the result of rectifying a photo by one motion for the whole picture."""
        return cls(
            result.photo,
            result.valid,
            result.original,
            result.verdict,
            result.edges,
            result.whole,
            model,
            result.motion,
        )


def rectify_densely(
    before: Frame | None, current: Frame, after: Frame | None, options: SequenceOptions
) -> RectifiedFrame:
    """Rectifies a frame by the flow between it and its neighbours; call :meth:`Frame.connect` first.

    Raises:
        UnshutterError: a neighbour has another bit depth, or a crop would leave next to nothing.
    """
    frames, links = {0: current.pixels}, {}
    for side, neighbour, connection in ((-1, before, before and before.to_next), (1, after, current.to_next)):
        if neighbour is not None and connection is not None:
            frames[side], links[side] = _alike(neighbour, current), connection
    timing, edges = options.timing(frames[0].shape[0]), options.undo.edges
    picture = render(
        frames,
        links,
        timing,
        options.moment(timing),
        borrow=edges == "borrow",
        fill=edges == "fill",
        masked=current.photo.masked,
    )
    back = -options.readout.quarter_turns
    pixels, valid = np.rot90(picture.pixels, back), np.rot90(picture.valid, back)
    if picture.reason:
        verdict = Verdict(0.0, None, picture.reason)
        return RectifiedFrame(current.photo, valid, current.photo, verdict)
    edges, window, whole = EdgePolicy(options.undo.edges).decide(valid.shape, lambda: valid_window(valid))
    pixels = pixels[window.top : window.bottom, window.left : window.right]
    photo = current.photo.with_pixels(np.ascontiguousarray(pixels))
    return RectifiedFrame(photo, valid, current.photo, Verdict(picture.largest_px), edges, whole)


def _alike(neighbour: Frame, frame: Frame) -> np.ndarray:
    """Returns a neighbour's pixels after checking their type.

    Raises:
        UnshutterError: the bit depths differ.
    """
    theirs, own = neighbour.pixels, frame.photo.pixels
    if theirs.dtype != own.dtype:
        bits = [f"{8 * pixels.dtype.itemsize} bits" for pixels in (own, theirs)]
        raise UnshutterError(
            f"{{photo}} has {bits[0]} but {{neighbour}} has {bits[1]}: they must be alike",
            photo=frame.name,
            neighbour=neighbour.name,
        )
    return theirs
