"""From encoded data to pixels and grey copies: each decoded when it is first asked for, or ahead of that."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.photo.format import Header
from unshutter.photo.grey import grey_copy, grey_size
from unshutter.photo.libvips import as_image
from unshutter.photo.source import Source

if TYPE_CHECKING:
    import numpy as np  # not imported above: reading a file, which starts first, can do without

_NEARLY = 1.1  # a grey copy may be so many times smaller than was asked for, where that is the cheaper one


class Decoder:
    """What encoded data hold."""

    def __init__(self, source: Source, header: Header):
        self._source, self._header = source, header
        self._height, self._width = header.height, header.width
        self._grey_px: int | None = None  # short side of the copy that is made ahead
        self._grey_ahead: Future[np.ndarray] | None = None
        self._pixels_ahead: Future[np.ndarray] | None = None
        self._grey_begun = self._pixels_begun = False

    def start(self, executor: Executor, grey_px: int | None, whole: bool) -> None:
        """Begins with the grey copy, if one is wanted, then the pixels, if they are wanted ``whole``.

        Where a grey copy is made of the pixels, these come first. Errors are raised where the results are asked for.
        """
        if grey_px is not None and self._shrink(grey_px) > 1:
            self._start_grey(executor, grey_px)
            grey_px = None
        if (whole or grey_px is not None) and not self._pixels_begun:
            self._pixels_begun = True
            self._pixels_ahead = executor.submit(self._decode)
            if grey_px is not None:
                self._start_grey(executor, grey_px, self._pixels_ahead)

    def _start_grey(self, executor: Executor, grey_px: int, pixels: Future[np.ndarray] | None = None) -> None:
        if self._grey_begun:
            return
        self._grey_begun, self._grey_px = True, grey_px
        if pixels is None:
            self._grey_ahead = executor.submit(self._small_grey, grey_px)
        else:
            self._grey_ahead = executor.submit(lambda: self._grey_of(pixels.result(), grey_px))

    @cached_property
    def pixels(self) -> np.ndarray:
        """See ``Photo.pixels``."""
        self._grey_begun = self._pixels_begun = True
        if self._pixels_ahead is not None:
            with suppress(UnshutterError):  # decoded again for its message: libvips mixes those of two threads
                return self._pixels_ahead.result()
        return self._decode()

    def grey(self, short_side: int | None) -> np.ndarray:
        """See ``Photo.grey``."""
        ahead = None
        if short_side is not None and short_side == self._grey_px:
            ahead, self._grey_ahead = self._grey_ahead, None  # given away once: it may be written to
        if ahead or self._shrink(short_side) > 1:
            with suppress(UnshutterError):  # what is wrong with the data, decoding the pixels says
                return ahead.result() if ahead else self._small_grey(short_side)
        return self._grey_of(self.pixels, short_side)

    def _grey_of(self, pixels: np.ndarray, short_side: int | None) -> np.ndarray:
        if self._header.coding.masked:  # libvips would take the last channel for transparency
            pixels = pixels[..., :-1]
        return grey_copy(as_image(pixels), *grey_size(self._height, self._width, short_side))

    def _small_grey(self, short_side: int | None) -> np.ndarray:
        """The grey copy of data that are decoded at a part of their size."""
        shrink = self._shrink(short_side)
        small = as_image(self._decode(shrink))
        height, width = grey_size(self._height, self._width, short_side)
        if small.height < height:
            return grey_copy(small, round(self._height / shrink), round(self._width / shrink), 1.0, 1.0)
        return grey_copy(small, height, width, shrink * height / self._height, shrink * width / self._width)

    def _shrink(self, short_side: int | None) -> int:
        """How many times smaller the data may be decoded for such a grey copy."""
        height, width = grey_size(self._height, self._width, short_side)
        scale = max(height / self._height, width / self._width)
        return next((n for n in self._header.format.shrinks if n * scale <= _NEARLY), 1)

    def _decode(self, shrink: int = 1) -> np.ndarray:
        return self._header.format.decode(self._source, self._header, shrink)
