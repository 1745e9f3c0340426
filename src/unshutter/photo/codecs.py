"""The file formats: what each can hold, how it is recognised.

A new format is one entry in ``CODECS``, its signature, and its options in encoding.py.
"""

from __future__ import annotations

import io
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, TypeAlias

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo.libvips import libvips

if TYPE_CHECKING:
    import pyvips

Subsampling: TypeAlias = Literal["4:4:4", "4:2:0"]


@dataclass(frozen=True)
class Codec:
    """A file format.

    Attributes:
        name: as in ``Photo.format``.
        suffixes: of its files, the usual one first.
        load, save: libvips operations; empty where libvips is not asked.
        longest_side: [px] that it can hold.
        deep: whether it holds more than 8 bits.
        grey, alpha: whether it holds pictures of one channel, and transparency.
        written_as: format of the results of a photo in a format that is only read.
    """

    name: str
    suffixes: tuple[str, ...]
    load: str
    save: str
    longest_side: int
    deep: bool
    grey: bool
    alpha: bool
    written_as: str = ""

    @property
    def written(self) -> bool:
        """Whether pictures can be written in it."""
        return not self.written_as


_CAMERAS = "dng 3fr arw cr2 cr3 crw erf fff iiq kdc mef mos mrw nef nrw orf pef raf rw2 rwl sr2 srf srw x3f"
_HEIC_SUFFIXES, _RAW_SUFFIXES = (".heic", ".heif", ".hif"), tuple(f".{ending}" for ending in _CAMERAS.split())
CODECS = {
    codec.name: codec
    for codec in (
        Codec("jpeg", (".jpg", ".jpeg"), "jpegload", "jpegsave", 65_500, deep=False, grey=True, alpha=False),
        Codec("png", (".png",), "pngload", "pngsave", 10_000_000, deep=True, grey=True, alpha=True),
        Codec("webp", (".webp",), "webpload", "webpsave", 16_383, deep=False, grey=False, alpha=True),
        Codec("tiff", (".tif", ".tiff"), "tiffload", "tiffsave", 10_000_000, deep=True, grey=True, alpha=True),
        Codec("avif", (".avif",), "heifload", "heifsave", 16_384, deep=True, grey=False, alpha=True),
        Codec("heic", _HEIC_SUFFIXES, "", "", 0, deep=True, grey=True, alpha=True, written_as="avif"),
        Codec("raw", _RAW_SUFFIXES, "", "", 0, deep=True, grey=False, alpha=False, written_as="tiff"),
    )
}
WRITTEN = {codec.name: codec for codec in CODECS.values() if codec.written}
# The first that matches a file's beginning says its format, or why it is not read.
_SIGNATURES = tuple(
    (re.compile(pattern, re.DOTALL), name)
    for pattern, name in (
        (rb"\xff\xd8\xff", "jpeg"),
        (rb"\x89PNG\r\n\x1a\n", "png"),
        (rb"RIFF....WEBP", "webp"),
        (rb"II\*\0....CR|IIRO|IIRS|MMOR|IIU\0|FUJIFILM|FOVb|\0MRM|......HEAPCCDR|....ftypcrx ", "raw"),
        (rb"II[*+]\0|MM\0[*+]", "tiff"),
        (rb"....ftyp(avis|hevc|hevx|msf1)", "is an animation: unshutter takes single photos"),
        (rb"....ftyp(....)*avif", "avif"),
        (rb"....ftyp(....)*(hei[cxms]|mif1)", "heic"),
    )
)


@dataclass(frozen=True)
class Coding:
    """How a picture was encoded, to encode its successor alike.

    Attributes:
        quality: JPEG quality, 1 ... 100.
        subsampled: chroma at half resolution.
        lossless: WebP only.
        bits: of a sample.
        compression: TIFF's number of it.
        orientation: EXIF orientation by which the decoder has already turned the picture (AVIF, HEIC).
        grey: one channel that the decoder shows as three (AVIF).
    """

    quality: int | None = None
    subsampled: bool = False
    lossless: bool = False
    bits: int = 8
    compression: int | None = None
    orientation: int = 1
    grey: bool = False


@dataclass(frozen=True)
class Source:
    """Where encoded data lie: a file, or bytes in memory."""

    place: Path | bytes

    def __str__(self) -> str:
        return str(self.place) if isinstance(self.place, Path) else "the picture in memory"

    def stream(self) -> BinaryIO:
        """A new stream at the beginning; OSError where the file cannot be read."""
        return self.place.open("rb") if isinstance(self.place, Path) else io.BytesIO(self.place)

    def load(self, codec: Codec, **options: Any) -> pyvips.Image:
        """The picture, lazily; ``pyvips.Error`` where libvips cannot make sense of it."""
        image = libvips().Image
        if isinstance(self.place, Path):  # as bytes: names need not be text
            return getattr(image, codec.load)(os.fsencode(self.place), **options)
        return getattr(image, codec.load + "_buffer")(self.place, **options)


def for_suffix(path: Path) -> Codec:
    """The format that a file name asks to be written.

    Raises:
        UsageError: the ending names none, or one that is only read.
    """
    codec = of_suffix(path.suffix)
    if codec is not None and codec.written:
        return codec
    endings = ", ".join(suffix for codec in WRITTEN.values() for suffix in codec.suffixes)
    if codec is not None:
        raise UsageError(f"cannot write '{path.name}': such files are only read; end the name in one of {endings}")
    raise UsageError(f"cannot tell the picture format from '{path.name}': end the name in one of {endings}")


def of_suffix(suffix: str) -> Codec | None:
    """The format of files with this ending, if there is one."""
    return next((codec for codec in CODECS.values() if suffix.lower() in codec.suffixes), None)


def recognise(source: Source) -> Codec:
    """The format of encoded data, by their first bytes: endings may lie.

    Raw files of many makers begin like a TIFF: their endings decide, and :mod:`unshutter.photo.header` looks closer.

    Raises:
        UnshutterError: missing, unreadable, empty, or of no format that is read.
    """
    try:
        with source.stream() as stream:
            head = stream.read(64)
    except OSError as error:
        reason = "it is a folder, not a photo" if isinstance(error, IsADirectoryError) else error.strerror
        raise UnshutterError(f"cannot read {source}: {reason}") from None
    except ValueError as error:  # a NUL in the name
        raise UnshutterError(f"cannot read {str(source)!r}: {error}") from None
    if not head:
        raise UnshutterError(f"{source} is empty (0 bytes)")
    name = next((name for signature, name in _SIGNATURES if signature.match(head)), None)
    if name in (None, "tiff") and isinstance(source.place, Path) and source.place.suffix.lower() in _RAW_SUFFIXES:
        name = "raw"
    if name is None:
        raise UnshutterError(f"{source} is not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw picture")
    if name not in CODECS:
        raise UnshutterError(f"{source} {name}")
    return CODECS[name]
