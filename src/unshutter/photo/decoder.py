"""Decodes encoded data to pixels and grey copies, each on first use or ahead of it."""

from __future__ import annotations

import os
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.photo.copies import grey_copy, grey_size
from unshutter.photo.format import Header
from unshutter.photo.libvips import as_image
from unshutter.photo.source import Source

if TYPE_CHECKING:
    import numpy as np  # not imported above: reading a file, which starts first, does not need it

_NEARLY = 1.1  # a grey copy may be this many times smaller than requested if that is cheaper


class Decoder:
    """Decodes the picture in encoded data.

    Args:
        source: the encoded data.
        header: the header of their picture.
    """

    def __init__(self, source: Source, header: Header):
        self.source, self._header = source, header
        self._process = os.getpid()
        self._height, self._width = header.height, header.width
        self._grey_ahead: tuple[int, Future[np.ndarray]] | None = None  # requested short side, and the copy
        self._pixels_ahead: Future[np.ndarray] | None = None
        self._grey_begun = self._pixels_begun = False

    def __reduce__(self) -> tuple:  # the other process decodes the data again
        return Decoder, (self.source, self._header)

    def start(self, executor: Executor, grey_px: int | None, whole: bool) -> None:
        """Starts decoding the grey copy, if one is needed, then the pixels, if all are needed (``whole``).

        Errors are raised when the results are requested.
        """
        shrink = 1 if grey_px is None else self._shrink(grey_px)
        if grey_px is not None and shrink > 1 and not self._grey_begun:
            self._grey_begun = True
            self._grey_ahead = grey_px, executor.submit(self._grey_of_smaller, grey_px, shrink)
        if (whole or (grey_px is not None and shrink == 1)) and not self._pixels_begun:
            self._pixels_begun = True
            self._pixels_ahead = executor.submit(self._decode)

    @cached_property
    def pixels(self) -> np.ndarray:
        """The pixels, see ``Photo.pixels``."""
        self._grey_begun = self._pixels_begun = True
        if self._pixels_ahead is not None and self._has_its_threads:
            with suppress(UnshutterError):  # decoded again for the error message: libvips mixes those of two threads
                return self._pixels_ahead.result()
        return self._decode()

    def grey(self, short_side: int | None) -> np.ndarray:
        """Returns a grey copy, see ``Photo.grey``."""
        shrink = self._shrink(short_side)
        if shrink > 1:
            ahead, self._grey_ahead = self._grey_ahead, None  # handed out only once, because the caller may write to it
            with suppress(UnshutterError):  # decoding the pixels reports errors in the data
                if ahead is not None and ahead[0] == short_side and self._has_its_threads:
                    return ahead[1].result()
                return self._grey_of_smaller(short_side, shrink)
        # otherwise libvips would treat the last channel of a masked picture as transparency
        pixels = self.pixels[..., :-1] if self._header.coding.masked else self.pixels
        return grey_copy(as_image(pixels), *grey_size(self._height, self._width, short_side))

    def reduced(self, longest: int) -> np.ndarray:
        """Returns the pixels [h, w, bands], decoded at a reduced size whose longer side is at least this long [px]."""
        side = max(self._height, self._width)
        shrink = next((n for n in self._header.format.shrinks if side >= n * longest), 1)
        return self._decode(shrink) if shrink > 1 else self.pixels

    @property
    def _has_its_threads(self) -> bool:
        """Whether this is the process in which decoding was started: a fork does not have its threads."""
        return self._process == os.getpid()

    def _grey_of_smaller(self, short_side: int | None, shrink: int) -> np.ndarray:
        """Computes a grey copy from pixels decoded at a reduced size."""
        small = as_image(self._decode(shrink))
        height, width = grey_size(self._height, self._width, short_side)
        if small.height < height:
            return grey_copy(small, round(self._height / shrink), round(self._width / shrink), 1.0, 1.0)
        return grey_copy(small, height, width, shrink * height / self._height, shrink * width / self._width)

    def _shrink(self, short_side: int | None) -> int:
        """Returns the factor by which the data may be reduced in decoding for such a grey copy."""
        height, width = grey_size(self._height, self._width, short_side)
        scale = max(height / self._height, width / self._width)
        return next((n for n in self._header.format.shrinks if n * scale <= _NEARLY), 1)

    def _decode(self, shrink: int = 1) -> np.ndarray:
        return self._header.format.decode(self.source, self._header, shrink)
