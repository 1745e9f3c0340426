"""The dense way with photos: frames and what connects them, to the picture of a moment."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.neighbours import Link, copy_side, link, render
from unshutter.frames.rectified_frame import RectifiedFrame
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, follow
from unshutter.frames.wanted import Wanted
from unshutter.motion.verdict import Verdict
from unshutter.photo.argument import check_size, open_photo
from unshutter.warp.crop import valid_window
from unshutter.warp.edges import EdgePolicy


class Frame:
    """A frame of a sequence, and what connects it with the next one."""

    def __init__(self, given: Any, how: Wanted) -> None:
        self.given, self.photo, self._readout = given, open_photo(given), how.readout
        self.to_next: Link | None = None
        check_size(*self._size, "{photo}", photo=self.name)

    @property
    def name(self) -> str:
        """In messages."""
        return str(self.photo.path or "the photo")

    @property
    def pixels(self) -> np.ndarray:
        """[H, W, bands] in the readout frame."""
        return np.ascontiguousarray(self._readout.turn(self.photo.pixels))

    @cached_property
    def _tracked(self) -> np.ndarray:
        """The grey copy [h, w] that corners are followed in."""
        return np.ascontiguousarray(self._readout.turn(self.photo.grey(TRACKED_SIDE)))

    def check_like(self, following: Frame) -> None:
        """Raises UnshutterError where the next frame has another size or other bands."""
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
        """Finds the flow to the next frame, which is like it; once.

        Raises:
            UnshutterError: it shows something else.
        """
        if self.to_next is None:
            self.to_next = link(self._copy, following._copy)

    def tracks_to(self, following: Frame) -> Tracks:
        """Corners followed to the next frame."""
        return follow(self._tracked, following._tracked)

    @property
    def _size(self) -> tuple[int, int]:
        return self.photo.height, self.photo.width

    @cached_property
    def _copy(self) -> np.ndarray:
        """The small grey copy [h, w] that motion is looked for in."""
        return np.ascontiguousarray(self._readout.turn(self.photo.grey(copy_side(*self._size))))


def rectified_densely(before: Frame | None, current: Frame, after: Frame | None, how: Wanted) -> RectifiedFrame:
    """A frame by the flow between it and its neighbours, which are connected.

    Raises:
        UnshutterError: a neighbour of another kind, or a crop that would leave next to nothing.
    """
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
        verdict = Verdict(0.0, None, made.reason)
        return RectifiedFrame(current.photo, valid, current.photo, verdict)
    edges, window, whole = EdgePolicy(how.undo.edges).decide(valid.shape, lambda: valid_window(valid))
    pixels = pixels[window.top : window.bottom, window.left : window.right]
    photo = current.photo.with_pixels(np.ascontiguousarray(pixels))
    return RectifiedFrame(photo, valid, current.photo, Verdict(made.largest_px), edges, whole)


def _alike(neighbour: Frame, frame: Frame) -> np.ndarray:
    """A neighbour's pixels, which must be of the frame's kind.

    Raises:
        UnshutterError: they have other bits.
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
