"""Recognises the format of encoded data, reads their header, decodes them, and makes reduced copies.

Copies are grey for finding motion and 8-bit sRGB for screens. All are made on first use, or ahead of it in a thread.
"""

from __future__ import annotations

import os
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

from unshutter.errors import MissingFileError, UnshutterError
from unshutter.options.picture_formats import SEVERAL_PICTURES, in_words
from unshutter.photo import code_points
from unshutter.photo.code_points import CodePoints
from unshutter.photo.formats import FORMATS
from unshutter.photo.formats.picture_format import Format, Header, Metadata
from unshutter.photo.libvips import Source, as_image, in_srgb, libvips, refusing, standard, to_8_bits
from unshutter.storage.files import check_plain

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_LARGE = 100_000_000  # px of a picture whose file must be large, too


def read_header(source: Source, max_pixels: int) -> Header:
    """Reads the header of encoded data."""
    format = recognise(source)
    try:
        with source.unchanged():
            header = format.read_header(source)
            length = source.length
    except OSError as error:
        raise UnshutterError(f"cannot read {{photo}}: {error.strerror}", photo=source) from None
    pixels = header.width * header.height
    size = f"{header.width}x{header.height} px ({pixels / 1e6:.0f} megapixels)"
    if pixels > max_pixels:
        raise UnshutterError(
            f"{{photo}} has {size}, more than the limit of {max_pixels / 1e6:g} megapixels", photo=source
        )
    # so large a picture with so few bits per pixel has a single colour: made to exhaust memory, not by a camera
    if pixels >= _LARGE and 8 * length < 0.03 * pixels:
        raise UnshutterError(f"{{photo}} is not a photo: {size} cannot come from {length} bytes", photo=source)
    return header


def recognise(source: Source) -> Format:
    """Recognises the format of encoded data by their first bytes, because extensions may be wrong."""
    if source.path:
        check_plain(source.path)
    if source.suffix == SEVERAL_PICTURES:
        raise UnshutterError("{photo} contains several pictures (MPO): unshutter takes single photos", photo=source)
    try:
        with source.stream() as stream:
            head = stream.read(64)
        format = next((one for one in FORMATS.values() if one.recognises(source, head)), None)
    except FileNotFoundError as error:
        raise MissingFileError(f"cannot read {{photo}}: {error.strerror}", photo=source) from None
    except OSError as error:
        reason = "it is a folder, not a photo" if isinstance(error, IsADirectoryError) else error.strerror
        raise UnshutterError(f"cannot read {{photo}}: {reason}", photo=source) from None
    except ValueError as error:  # a NUL character in the name
        raise UnshutterError(f"cannot read {{photo}}: {error}", photo=source) from None
    if not head:
        raise UnshutterError("{photo} is empty (0 bytes)", photo=source)
    if format is None and _is_video(head):
        raise UnshutterError(
            "{photo} is a video, not a photo: use unshutter video, or in Python unshutter.rectify_clip", photo=source
        )
    if format is None:
        raise UnshutterError(f"{{photo}} is not a {in_words(last='or')} picture", photo=source)
    return format


def _is_video(head: bytes) -> bool:
    """Whether a file of none of these formats begins like a video: MP4 or QuickTime, Matroska, AVI."""
    boxed = head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide")
    return boxed or head.startswith(b"\x1a\x45\xdf\xa3") or (head.startswith(b"RIFF") and head[8:12] == b"AVI ")


# ---- pixels ------------------------------------------------------------------------------------------


class Decoder:
    """Decodes the picture in encoded data."""

    def __init__(self, source: Source, header: Header):
        self.source = source
        self._header = header
        self._process = os.getpid()
        self._height = header.height
        self._width = header.width
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
            ahead = self._grey_ahead
            self._grey_ahead = None  # handed out only once, because the caller may write to it
            with suppress(UnshutterError):  # decoding the pixels reports errors in the data
                if ahead is not None and ahead[0] == short_side and self._has_its_threads:
                    return ahead[1].result()
                return self._grey_of_smaller(short_side, shrink)
        # otherwise libvips would treat the last channel of a masked picture as transparency
        pixels = self.pixels[..., :-1] if self._header.coding.masked else self.pixels
        size = grey_size(self._height, self._width, short_side)
        return grey_copy(as_image(pixels), *size, stated=self._header.metadata.code_points)

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
        # a grey copy may be this many times smaller than requested if that is cheaper
        return next((n for n in self._header.format.shrinks if n * scale <= 1.1), 1)

    def _decode(self, shrink: int = 1) -> np.ndarray:
        with self.source.unchanged():
            return self._header.format.decode(self.source, self._header, shrink)


# ---- reduced copies ----------------------------------------------------------------------------------

_BEHIND = 128  # grey level under transparent areas of small copies


def screen_pixels(
    image: pyvips.Image, height: int, width: int, metadata: Metadata, behind: int = _BEHIND
) -> np.ndarray:
    """Returns [height, width, 3] uint8 sRGB of the stored pixels of an image, scaled to that size, which is not larger.

    Transparent areas get the grey level ``behind`` (of 255); HDR is reduced to SDR (:func:`code_points.for_screen`);
    without a profile, or with one that does not fit, the colours count as sRGB.
    """
    with refusing("cannot compute the copy for the screen"):
        image = _flattened(image, behind)
        if (image.height, image.width) != (height, width):
            image = image.resize(width / image.width, vscale=height / image.height, kernel="mitchell")
        if metadata.code_points is not None:
            image = code_points.for_screen(image, metadata.code_points)
        elif metadata.icc is None:
            image = to_8_bits(image)
        else:
            try:
                image = in_srgb(standard(image), metadata.icc, bits=8).copy_memory()  # computed now: it may fail
            except libvips().Error:  # damaged, or for other colours: programs then assume sRGB
                libvips().vips_lib.vips_error_clear()
                image = to_8_bits(image)
        if image.bands == 1:
            image = image.bandjoin([image, image])
        return _of_size(image.numpy(), height, width)


def grey_size(height: int, width: int, short_side: int | None) -> tuple[int, int]:
    """Returns height and width of the grey copy of a picture."""
    least = min(height, width)
    scale = 1.0 if short_side is None or short_side >= least else short_side / least
    return max(round(height * scale), 1), max(round(width * scale), 1)


def grey_copy(
    image: pyvips.Image,
    height: int,
    width: int,
    vscale: float | None = None,
    hscale: float | None = None,
    stated: CodePoints | None = None,
) -> np.ndarray:
    """Returns the luminance [height, width] uint8 of an image, scaled by the factors or, by default, to that size."""
    vscale = vscale or height / image.height
    hscale = hscale or width / image.width
    with refusing("cannot compute the grey copy"):
        image = _flattened(image, _BEHIND)
        if stated is not None:
            image = standard(image.maplut(code_points.grey_table(stated, str(image.format))))
        elif image.format == "ushort":
            image = standard(image.cast("uchar", shift=True))  # first, because the rest then takes a third of the time
        if (hscale, vscale) != (1.0, 1.0):
            image = image.embed(*(0, 0, _aligned(image.width, hscale), _aligned(image.height, vscale)), extend="copy")
            image = image.resize(hscale, vscale=vscale, kernel="mitchell")  # little ringing: no ghosts next to edges
        pixels = image.numpy()[:height, :width]
    if pixels.ndim == 3:
        import cv2

        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    return _of_size(pixels, height, width)


def _flattened(image: pyvips.Image, level: int) -> pyvips.Image:
    """Puts a grey level (of 255) under transparent areas."""
    background: list[float] = [level * (257 if image.format == "ushort" else 1)]
    return image.flatten(background=background) if image.hasalpha() else image


def _aligned(size: int, scale: float) -> int:
    """Enlarges a size slightly so that it scales to whole pixels: libvips shifts any difference to both sides."""
    return min(range(size, size + 16), key=lambda padded: abs(padded * scale - round(padded * scale)))


def _of_size(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """Cuts or repeats the last row and column of scaled pixels, which rounding may have added or left out."""
    import numpy as np

    pixels = pixels[:height, :width]
    missing = [(0, height - pixels.shape[0]), (0, width - pixels.shape[1]), (0, 0)]
    return np.ascontiguousarray(np.pad(pixels, missing[: pixels.ndim], mode="edge"))
