"""A photo of a sequence: its grey copies, and the flow to the next photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.neighbours import Link, copy_side, link
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, follow
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.photo.photo import PhotoLike, check_size, open_photo
from unshutter.storage.opened import Opened


class Frame:
    """A photo of a sequence, and the flow to the next one."""

    def __init__(
        self, source: PhotoLike, scan_direction: ScanDirection, inputs: Sequence[Opened] | None = None
    ) -> None:
        photo = open_photo(source)
        self.photo, self._scan_direction = photo if inputs is None else replace(photo, made_from=inputs), scan_direction
        self.to_next: Link | None = None
        check_size(*self._size, "{photo}", photo=self.name)

    @property
    def name(self) -> str:
        """Name of the frame in messages."""
        return name_of(self.photo)

    @property
    def pixels(self) -> np.ndarray:
        """Pixels [H, W, bands] in the readout frame."""
        return np.ascontiguousarray(self._scan_direction.to_scan_frame(self.photo.pixels))

    @cached_property
    def _tracked(self) -> np.ndarray:
        """The grey copy [h, w] in which corners are tracked."""
        return np.ascontiguousarray(self._scan_direction.to_scan_frame(self.photo.grey(TRACKED_SIDE)))

    def check_like(self, following: Frame) -> None:
        """Raises UnshutterError if the next frame has another size or number of bands."""
        if self._size != following._size:
            sizes = [f"{width}x{height} px" for height, width in (self._size, following._size)]
            raise UnshutterError(
                f"{{photo}} has {sizes[0]} but {{neighbour}} has {sizes[1]}: neighbours must have the same size",
                photo=self.name,
                neighbour=following.name,
            )
        if self.photo.bands != following.photo.bands:
            raise UnshutterError(
                f"{{photo}} has {self.photo.bands} bands but {{neighbour}} has {following.photo.bands}: "
                "neighbours must have the same number of bands",
                photo=self.name,
                neighbour=following.name,
            )

    def connect(self, following: Frame) -> None:
        """Computes the flow to the next frame, once; call :meth:`check_like` first."""
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
        return np.ascontiguousarray(self._scan_direction.to_scan_frame(self.photo.grey(copy_side(*self._size))))


def name_of(photo: Photo) -> str:
    """Returns the name of a photo in messages."""
    return str(photo.path or "the photo")


def pixels_like(neighbour: Frame, photo: Photo) -> np.ndarray:
    """Returns a neighbour's stored pixels after checking their type."""
    theirs, own = neighbour.photo.pixels, photo.pixels
    if theirs.dtype != own.dtype:
        bits = [f"{8 * pixels.dtype.itemsize} bits" for pixels in (own, theirs)]
        raise UnshutterError(
            f"{{photo}} has {bits[0]} but {{neighbour}} has {bits[1]}: they must have the same bit depth",
            photo=name_of(photo),
            neighbour=neighbour.name,
        )
    return theirs
