"""From encoded data to pixels and grey copies: each decoded when it is first asked for, or ahead of that."""

from __future__ import annotations

import math
import re
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.photo.codecs import Codec, Source
from unshutter.photo.header import Header
from unshutter.photo.libvips import libvips, refusing, standard
from unshutter.storage import large_arrays

if TYPE_CHECKING:
    import numpy as np  # not imported above: reading a file, which starts first, can do without
    import pyvips

USUAL_GREY = 768  # short side [px] of the grey copy that is made ahead, which the default estimator asks for
_NEARLY = 1.1  # a JPEG may give a grey copy so many times smaller than was asked for, when that is the cheaper one
# Warnings about JPEGs in which every pixel is there, and which all viewers show.
_HARMLESS = re.compile(r"Invalid SOS parameters|Unknown Adobe color transform|extraneous bytes before marker 0x[de]")


class Decoder:
    """What encoded data hold."""

    def __init__(self, source: Source, header: Header):
        self._source, self._header = source, header
        self._height, self._width = header.height, header.width
        self._begun: set[str] = set()
        self._grey_px: int | None = None
        self._grey_ahead: Future[np.ndarray] | None = None
        self._pixels_ahead: Future[np.ndarray] | None = None

    def start(self, executor: Executor, grey_px: int | None, whole: bool) -> None:
        """Begins with a grey copy, then the pixels."""
        self._grey_px = grey_px
        small_first = grey_px is not None and self._shrink(grey_px) > 1
        if small_first and "grey" not in self._begun:
            self._begun.add("grey")
            self._grey_ahead = executor.submit(self._grey, grey_px)
        if (whole or (grey_px and not small_first)) and "pixels" not in self._begun:
            self._begun.add("pixels")
            pixels = self._pixels_ahead = executor.submit(self._decode)
            if grey_px and not small_first:
                self._begun.add("grey")
                self._grey_ahead = executor.submit(lambda: self._grey_of(pixels.result(), grey_px))

    @cached_property
    def pixels(self) -> np.ndarray:
        """See ``Photo.pixels``."""
        self._begun |= {"grey", "pixels"}
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
                return ahead.result() if ahead else self._grey(short_side)
        return self._grey_of(self.pixels, short_side)

    def _grey_of(self, pixels: np.ndarray, short_side: int | None) -> np.ndarray:
        return grey_copy(as_image(pixels), *grey_size(self._height, self._width, short_side))

    def _grey(self, short_side: int | None) -> np.ndarray:
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
        return next((n for n in (8, 4, 2) if self._header.codec.name == "jpeg" and n * scale <= _NEARLY), 1)

    def _decode(self, shrink: int = 1) -> np.ndarray:
        return decode(self._source, self._header, shrink)


def decode(source: Source, header: Header, shrink: int = 1) -> np.ndarray:
    """All stored pixels, decoded now.

    Args:
        source: what to decode.
        header: what :func:`read_header` says of it.
        shrink: 1, or for JPEG 2, 4 or 8: every so many rows and columns become one, rounded up, which is faster.

    Returns:
        [H, W, bands] uint8 or uint16, not to be written to (very large pictures lie in a temporary file).

    Raises:
        UnshutterError: the data are damaged or end too early.
    """
    name, coding = header.codec.name, header.coding
    if name == "raw":
        from unshutter.photo import raw

        return raw.developed(source, header.height, header.width)
    if name == "heic":
        from unshutter.photo import heic

        pixels = _unturned(heic.turned_pixels(source), coding.orientation)
        if pixels.shape != (header.height, header.width, header.bands):
            raise UnshutterError(f"{source} is damaged: it holds another picture than it says")
        return pixels
    pixels = _by_libvips(source, header.codec, {"shrink": shrink} if shrink > 1 else {})
    if coding.grey and pixels.shape[2] > 2:
        pixels = pixels[..., [0] if pixels.shape[2] == 3 else [0, 3]]
    return _unturned(pixels, coding.orientation)


def _by_libvips(source: Source, codec: Codec, smaller: dict[str, int]) -> np.ndarray:
    with refusing(f"{source} is damaged or incomplete"):
        # To libjpeg damaged data are but a warning; PNG and TIFF warn of much that harms nothing.
        level = "warning" if codec.name == "jpeg" else "error"
        try:
            return computed(source.load(codec, access="sequential", fail_on=level, **smaller))
        except libvips().Error as error:
            if level == "error" or not _HARMLESS.search(error.detail):
                raise
            return computed(source.load(codec, access="sequential", fail_on="error", **smaller))


def computed(image: pyvips.Image) -> np.ndarray:
    """[H, W, bands] of an image, computed now; not to be written to. ``pyvips.Error`` where that fails."""
    shape = image.height, image.width, image.bands
    dtype, size = {"uchar": ("uint8", 1), "ushort": ("uint16", 2)}[str(image.format)]
    if math.prod(shape) * size <= large_arrays.SPILL_BYTES:
        data = image.write_to_memory()  # the long part; NumPy may be imported meanwhile
        import numpy as np

        pixels = np.frombuffer(data, dtype).reshape(shape)
        pixels.setflags(write=False)
        return pixels
    import tempfile

    import numpy as np

    with tempfile.NamedTemporaryFile(prefix="unshutter-") as file:
        image.rawsave(file.name)
        return np.memmap(file.name, dtype=dtype, mode="r", shape=shape)


def as_image(pixels: np.ndarray) -> pyvips.Image:
    """Pixels [H, W, bands] as libvips sees them, nothing copied, with the colour meaning of :func:`standard`."""
    import numpy as np

    height, width, bands = pixels.shape
    kind = {"uint8": "uchar", "uint16": "ushort"}[pixels.dtype.name]
    return standard(libvips().Image.new_from_memory(np.ascontiguousarray(pixels), width, height, bands, kind))


def _unturned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """The stored pixels of a picture that was turned by its orientation."""
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels.swapaxes(0, 1) if orientation >= 5 else pixels


# ---- grey copies ---------------------------------------------------------------------------------------


def grey_size(height: int, width: int, short_side: int | None) -> tuple[int, int]:
    """Height and width of the grey copy of a picture."""
    scale = 1.0 if short_side is None else min(short_side / min(height, width), 1.0)
    return max(round(height * scale), 1), max(round(width * scale), 1)


def grey_copy(
    image: pyvips.Image, height: int, width: int, vscale: float | None = None, hscale: float | None = None
) -> np.ndarray:
    """[height, width] uint8 luminance of an image scaled by the factors; by default those that give that size."""
    import numpy as np

    vscale, hscale = vscale or height / image.height, hscale or width / image.width
    with refusing("cannot compute the grey copy"):
        if image.hasalpha():
            image = image.flatten(background=[32896 if image.format == "ushort" else 128])
        if image.format == "ushort":
            image = standard(image.cast("uchar", shift=True))  # first: the rest takes a third of the time
        if (hscale, vscale) != (1.0, 1.0):
            image = image.embed(*(0, 0, _aligned(image.width, hscale), _aligned(image.height, vscale)), extend="copy")
            image = image.resize(hscale, vscale=vscale, kernel="mitchell")  # hardly rings: no ghosts beside edges
        pixels = image.numpy()[:height, :width]
    if pixels.ndim == 3:
        import cv2

        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    missing = (height - pixels.shape[0], width - pixels.shape[1])
    return np.ascontiguousarray(np.pad(pixels, ((0, missing[0]), (0, missing[1])), mode="edge"))


def _aligned(size: int, scale: float) -> int:
    """A size, a little larger, that scales to whole pixels: what is missing to them, libvips shifts to both sides."""
    return min(range(size, size + 16), key=lambda padded: abs(padded * scale - round(padded * scale)))
