"""The file formats: how each is recognised and decoded through libvips.

A new format is one entry in ``CODECS``, its signature, and its options in encoding.py.
"""

from __future__ import annotations

import io
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import containers, metadata
from unshutter.photo.libvips import libvips

if TYPE_CHECKING:
    import pyvips


@dataclass(frozen=True)
class Codec:
    """A file format.

    Attributes:
        name: as in ``Photo.format``.
        suffixes: of its files, the usual one first.
        load, save: libvips operations.
        longest_side: [px] that it can hold.
        deep: whether it holds more than 8 bits.
        grey, alpha: whether it holds pictures of one channel, and transparency.
    """

    name: str
    suffixes: tuple[str, ...]
    load: str
    save: str
    longest_side: int
    deep: bool
    grey: bool
    alpha: bool


CODECS = {
    codec.name: codec
    for codec in (
        Codec("jpeg", (".jpg", ".jpeg"), "jpegload", "jpegsave", 65_500, deep=False, grey=True, alpha=False),
        Codec("png", (".png",), "pngload", "pngsave", 10_000_000, deep=True, grey=True, alpha=True),
        Codec("webp", (".webp",), "webpload", "webpsave", 16_383, deep=False, grey=False, alpha=True),
        Codec("tiff", (".tif", ".tiff"), "tiffload", "tiffsave", 10_000_000, deep=True, grey=True, alpha=True),
        Codec("avif", (".avif",), "heifload", "heifsave", 16_384, deep=True, grey=False, alpha=True),
    )
}
_RAW = "is a camera's raw file: develop it to a TIFF or JPEG first"
# The first that matches a file's beginning says its format, or why it is not read.
_SIGNATURES = tuple(
    (re.compile(pattern, re.DOTALL), name)
    for pattern, name in (
        (rb"\xff\xd8\xff", "jpeg"),
        (rb"\x89PNG\r\n\x1a\n", "png"),
        (rb"RIFF....WEBP", "webp"),
        (rb"II\*\0....CR|IIRO|IIRS|MMOR|IIU\0|FUJIFILM|FOVb|....ftypcrx ", _RAW),
        (rb"II[*+]\0|MM\0[*+]", "tiff"),
        (rb"....ftypavis", "is an animation: unshutter takes single photos"),
        (rb"....ftyp(....)*avif", "avif"),
        (rb"....ftyp(....)*(hei[cxms]|mif1)", "is a HEIC photo, which is not read yet: convert it to JPEG first"),
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
        orientation: EXIF orientation by which the decoder has already turned the picture (AVIF).
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
    """The format that a file name asks for.

    Raises:
        UsageError: the ending names none.
    """
    for codec in CODECS.values():
        if path.suffix.lower() in codec.suffixes:
            return codec
    endings = ", ".join(suffix for codec in CODECS.values() for suffix in codec.suffixes)
    raise UsageError(f"cannot tell the picture format from '{path.name}': end the name in one of {endings}")


def recognise(source: Source) -> Codec:
    """The format of encoded data, by their first bytes: endings may lie.

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
    for signature, name in _SIGNATURES:
        if signature.match(head):
            if name in CODECS:
                return CODECS[name]
            raise UnshutterError(f"{source} {name}")
    raise UnshutterError(f"{source} is not a JPEG, PNG, WebP, TIFF or AVIF picture")


def field(image: pyvips.Image, name: str, default: Any = None) -> Any:
    """A metadata field of libvips's, or the default."""
    return image.get(name) if image.get_typeof(name) else default


def read_coding(source: Source, codec: Codec, header: pyvips.Image) -> tuple[Coding, bytes | None]:
    """How the picture was encoded, and its EXIF blob.

    Raises:
        UnshutterError: it holds several pictures, or is a raw file in TIFF's clothes.
    """
    bits, exif = field(header, "bits-per-sample", 8), field(header, "exif-data")
    pages = field(header, "n-pages", 1) if codec.name != "avif" else 1
    coding = Coding(bits=bits)
    with source.stream() as stream:
        if codec.name == "jpeg":
            quality, subsampled = containers.jpeg_coding(stream)  # libvips calls 4:2:2 4:2:0
            coding = Coding(quality, subsampled)
        elif codec.name == "webp":
            lossless = containers.webp_is_lossless(stream)
            coding = Coding(subsampled=not lossless, lossless=lossless)
        elif codec.name == "avif":
            orientation, grey, subsampled = containers.avif_coding(stream)
            coding = Coding(subsampled=subsampled, bits=bits, orientation=orientation, grey=grey)
        elif codec.name == "tiff" and (tree := metadata.read_tree(stream)) is not None:
            kinds = [tree.number(metadata.SUBFILE_TYPE, page=page) or 0 for page in range(len(tree.pages))]
            if metadata.DNG_VERSION in tree.pages[0] or kinds[0] & 1:  # the first page is a preview
                raise UnshutterError(f"{source} {_RAW}")
            pages = sum(not kind & 5 for kind in kinds)  # smaller copies and masks do not count
            coding = Coding(bits=bits, compression=tree.number(metadata.COMPRESSION))
            exif = metadata.exif_of_tiff(tree)
    if pages > 1:
        raise UnshutterError(f"{source} holds {pages} pictures: unshutter takes single photos, save them one by one")
    return coding, exif


def check_pixels(source: Source, header: pyvips.Image, max_pixels: int) -> None:
    """Refuses pictures whose pixels the package does not work on.

    Raises:
        UnshutterError: too many pixels, CMYK or CIELAB colours, samples other than 8 or 16 bits unsigned.
    """
    if header.width * header.height > max_pixels:
        size = f"{header.width}x{header.height} px ({header.width * header.height / 1e6:.0f} megapixels)"
        raise UnshutterError(f"{source} has {size}, more than the limit of {max_pixels / 1e6:g} megapixels")
    if header.interpretation == "cmyk":
        raise UnshutterError(f"{source} is in CMYK colours: convert it to RGB first")
    if header.interpretation in ("lab", "labs", "labq", "lch", "xyz", "yxy", "hsv"):
        raise UnshutterError(f"{source} is in {str(header.interpretation).upper()} colours: convert it to RGB first")
    if header.format not in ("uchar", "ushort"):
        raise UnshutterError(
            f"{source} has {_sample_kind(str(header.format))} samples: convert it to 8 or 16 bits first"
        )
    if header.bands > 4:
        raise UnshutterError(f"{source} has {header.bands} channels: convert it to grey or RGB first")


def _sample_kind(vips_format: str) -> str:
    kinds = {"float": "32-bit float", "double": "64-bit float", "uint": "32-bit", "int": "32-bit signed"}
    return kinds.get(vips_format, {"char": "8-bit signed", "short": "16-bit signed"}.get(vips_format, vips_format))


def standard(image: pyvips.Image) -> pyvips.Image:
    """The image with the colour meaning that its bands and bits have here: libvips's operations go by it.

    Raises:
        UnshutterError: not 1 to 4 bands of 8 or 16 bits.
    """
    if image.format not in ("uchar", "ushort") or not 1 <= image.bands <= 4:
        raise UnshutterError(f"a photo has 1 to 4 bands of 8 or 16 bits, not {image.bands} of {image.format}")
    deep = image.format == "ushort"
    meaning = ("grey16" if deep else "b-w") if image.bands < 3 else ("rgb16" if deep else "srgb")
    return image if image.interpretation == meaning else image.copy(interpretation=meaning)


def to_8_bits(image: pyvips.Image) -> pyvips.Image:
    """65535 -> 255, rounded; images of 8 bits as they are."""
    return standard(image.linear([255 / 65535], [0.5], uchar=True)) if image.format == "ushort" else image
