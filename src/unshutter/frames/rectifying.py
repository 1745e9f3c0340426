"""Photos and their neighbours in time -> the photos that a global shutter would have taken."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.neighbours import STILL, Link, copy_side, link, render
from unshutter.frames.timing import Timing
from unshutter.geometry.readout import Readout
from unshutter.motion.verdict import Verdict
from unshutter.options import LEAST_AUTO_CROP, Clock, Edges, PictureFormat, Reference, Save, Subsampling, Undo
from unshutter.photo import Photo
from unshutter.photo.encoding import Encoded
from unshutter.result import encode_result, save_result
from unshutter.warp.crop import largest_valid_rectangle

SMALLEST_SIDE = 64  # px
_LEAST_CROP = 0.1  # of the photo's area


@dataclass(frozen=True)
class RectifiedFrame:
    """A photo rectified with the help of its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original.
        valid: bool [H, W], where the original (with ``borrow``: or a neighbour) shows what belongs there, before any
            crop or fill.
        original: the photo as it was read.
        verdict: whether its pixels were changed, and why not.
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``: what was done about places that the photo did not see.
        whole: share of the photo's area that a crop leaves; None where no crop was looked for.
        motion: None: what moves differently near and far is no motion of the camera alone.
    """

    photo: Photo
    valid: np.ndarray
    original: Photo
    verdict: Verdict
    edges: Edges = "keep"
    whole: float | None = None
    motion: None = None

    @property
    def changed(self) -> bool:
        """Whether anything was undone; if not, :attr:`reason` says why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """Why the photo was left as it is; empty where it was changed."""
        return self.verdict.reason

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16, not to be written to."""
        return self.photo.pixels

    def to_array(self) -> np.ndarray:
        """A copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
        return self.photo.to_array()

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        quality: int | None = None,
        subsampling: Subsampling | None = None,
        keep_times: bool = False,
    ) -> tuple[str, ...]:
        """Writes the picture; a photo that was left as it is is copied byte for byte. See :meth:`Photo.save`."""
        return save_result(
            self.photo, self.original, Path(path), overwrite, Save(None, quality, subsampling, keep_times)
        )

    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """The picture as an encoded file, and what of its metadata did not go in; see :meth:`Photo.to_bytes`."""
        return encode_result(self.photo, Save(format, quality, subsampling))


def rectify_frames(
    frames: Iterable[str | os.PathLike[str] | np.ndarray | Photo],
    *,
    readout_ratio: float | None = None,
    readout_ms: float | None = None,
    fps: float | None = None,
    readout: str = "auto",
    reference: Reference = "first",
    at: float | None = None,
    edges: Edges = "keep",
) -> Iterator[Any]:
    """Rectifies successive frames of one camera, each with the help of the one before and the one after.

    Near and far may move differently, and things of their own accord. Three frames are held at a time.

    Args:
        frames: paths, Photos or pixels [H, W] or [H, W, 1..4] (uint8 or uint16), in the order in which they were taken.
        readout_ratio: time in which one frame is read out / time from frame to frame, above 0 and at most 1.
        readout_ms, fps: the same by readout time [ms] and frames per second.
        readout: direction in which the stored pixels were read; ``auto`` is top-to-bottom.
        reference: row at whose moment the pictures are taken: first, middle or last.
        at: moment of the pictures instead, in frame intervals from each frame's first row, -1 to 1.
        edges: for what a frame did not see: ``keep`` (black), ``crop``, ``fill``, or ``borrow`` it from neighbours.

    Yields:
        For each frame a :class:`RectifiedFrame`; for pixels, pixels.

    Raises:
        UnshutterError: a frame cannot be read, is too small, or has too little in common with its neighbour.
        UsageError: fewer than two frames, frames of different sizes, or an option that is none of its choices.
    """
    how = Wanted(
        Clock(readout_ratio, fps=fps, readout_ms=readout_ms), Undo(reference, 1.0, edges), Readout.parse(readout), at
    )
    before = current = None
    for given in frames:
        following = _Frame(given, how)
        if current is not None:
            current.connect(following)
            yield _like(current, _rectified(before, current, following, how))
        before, current = current, following
    if before is None or current is None:
        raise UsageError("needs at least two frames: one photo alone is for unshutter.rectify")
    yield _like(current, _rectified(before, current, None, how))


@dataclass(frozen=True)
class Wanted:
    """What picture is wanted of a frame.

    Attributes:
        clock: how fast frames were taken and read out.
        undo: reference row and edges.
        readout: direction in which the stored pixels were read.
        at: moment of the picture, in frame intervals from the frame's first row; None: that of the reference row.

    Raises:
        UsageError: options that do not fit together, or a moment too far away.
    """

    clock: Clock
    undo: Undo
    readout: Readout
    at: float | None = None

    def __post_init__(self) -> None:
        if self.undo.strength != 1:
            raise UsageError("with neighbours, the whole motion is undone: leave out the strength")
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"the moment must lie between -1 and 1 frame intervals, got {self.at:g}")

    def timing(self, height: int) -> Timing:
        """The clock of frames with so many rows."""
        return Timing(self.clock.ratio, height)

    def moment(self, timing: Timing) -> float:
        """Of the picture, in frame intervals from the frame's first row."""
        return timing.moment(self.undo.reference or "first") if self.at is None else self.at


def rectify_between(photo: Photo, before: Photo | None, after: Photo | None, how: Wanted) -> RectifiedFrame:
    """One photo, rectified with the help of the frame before, the one after, or both.

    Raises:
        UnshutterError, UsageError: see :func:`rectify_frames`.
    """
    given = (before, photo, after)
    for each in given:
        if each is not None:
            each.start_decoding(grey_px=copy_side(each.height, each.width))
    current = _Frame(photo, how)
    earlier, later = (_Frame(each, how) if each is not None else None for each in (before, after))
    for first, second in pairwise(frame for frame in (earlier, current, later) if frame is not None):
        first.connect(second)
    return _rectified(earlier, current, later, how)


class _Frame:
    """A frame of a sequence, and what connects it with the next one."""

    def __init__(self, given: Any, how: Wanted) -> None:
        self.given, self.photo, self._readout = given, _opened(given), how.readout
        self.to_next: Link | None = None
        if min(self._size) < SMALLEST_SIDE:
            size = f"{self.photo.width}x{self.photo.height} px"
            raise UnshutterError(f"{self.name} is {size}; both sides must be at least {SMALLEST_SIDE} px")

    @property
    def name(self) -> str:
        """In messages."""
        return str(self.photo.path or "the photo")

    @property
    def pixels(self) -> np.ndarray:
        """[H, W, bands] in the readout frame."""
        return np.ascontiguousarray(self._readout.turn(self.photo.pixels))

    def connect(self, following: _Frame) -> None:
        """Finds the flow to the next frame.

        Raises:
            UnshutterError: it has another size or other bands, or shows something else.
        """
        if self._size != following._size:
            sizes = [f"{width}x{height} px" for height, width in (self._size, following._size)]
            raise UnshutterError(
                f"{self.name} has {sizes[0]} but {following.name} has {sizes[1]}: neighbours must be of one size"
            )
        if self.photo.bands != following.photo.bands:
            bands = f"{self.name} has {self.photo.bands} bands but {following.name} has {following.photo.bands}"
            raise UnshutterError(f"{bands}: neighbours must be of one kind")
        self.to_next = link(self._copy, following._copy)

    @property
    def _size(self) -> tuple[int, int]:
        return self.photo.height, self.photo.width

    @cached_property
    def _copy(self) -> np.ndarray:
        """The small grey copy [h, w] that motion is looked for in."""
        return np.ascontiguousarray(self._readout.turn(self.photo.grey(copy_side(*self._size))))


def _rectified(before: _Frame | None, current: _Frame, after: _Frame | None, how: Wanted) -> RectifiedFrame:
    frames, links = {0: current.pixels}, {}
    for side, neighbour, connection in ((-1, before, before and before.to_next), (1, after, current.to_next)):
        if neighbour is not None and connection is not None:
            frames[side], links[side] = _alike(neighbour, current), connection
    timing, edges = how.timing(frames[0].shape[0]), how.undo.edges
    made = render(
        frames,
        links,
        timing,
        how.moment(timing),
        borrow=edges == "borrow",
        fill=edges == "fill",
        masked=current.photo.masked,
    )
    back = -how.readout.quarter_turns
    pixels, valid = np.rot90(made.pixels, back), np.rot90(made.valid, back)
    if made.reason:
        cause = "no motion" if made.reason == STILL else "nothing to go by"
        return RectifiedFrame(current.photo, valid, current.photo, Verdict(0.0, None, cause, made.reason))
    whole = None
    if edges in ("crop", "auto"):
        left, top, width, height = largest_valid_rectangle(valid)
        whole = width * height / valid.size
        if edges == "crop" and whole < _LEAST_CROP:
            raise UnshutterError(
                f"cropping would leave {100 * whole:.0f} % of the photo: use other edges, keep or fill"
            )
        edges = "crop" if edges == "crop" or whole >= LEAST_AUTO_CROP else "keep"
        if edges == "crop":
            pixels = pixels[top : top + height, left : left + width]
    photo = current.photo.with_pixels(np.ascontiguousarray(pixels))
    return RectifiedFrame(photo, valid, current.photo, Verdict(made.largest_px), edges, whole)


def _alike(neighbour: _Frame, frame: _Frame) -> np.ndarray:
    """A neighbour's pixels, which must be of the frame's kind.

    Raises:
        UnshutterError: they have other bits.
    """
    theirs, own = neighbour.pixels, frame.photo.pixels
    if theirs.dtype != own.dtype:
        bits = [f"{8 * pixels.dtype.itemsize} bits" for pixels in (own, theirs)]
        raise UnshutterError(f"{frame.name} has {bits[0]} but {neighbour.name} has {bits[1]}: they must be alike")
    return theirs


def _opened(given: Any) -> Photo:
    if isinstance(given, Photo):
        return given
    return Photo.open(given) if isinstance(given, (str, os.PathLike)) else Photo.from_array(given)


def _like(frame: _Frame, result: RectifiedFrame) -> Any:
    """The result as what was given: pixels for pixels."""
    if not isinstance(frame.given, np.ndarray):
        return result
    return result.to_array().reshape(*result.pixels.shape[:2], *frame.given.shape[2:])
