"""Opens photos: recognises their format and reads their header, before any pixels are decoded."""

from __future__ import annotations

from unshutter.errors import MissingFileError, UnshutterError
from unshutter.photo.format import Format, Header
from unshutter.photo.formats import FORMATS
from unshutter.photo.source import Source
from unshutter.storage.plain_files import check_plain

SEVERAL_PICTURES = ".mpo"  # from stereo cameras; its first bytes are those of a JPEG
_HEAD_BYTES = 64
# A picture this large with fewer bits per pixel has a single colour: made to exhaust memory, not by a camera.
_MANY_PIXELS, _LEAST_BITS = 100_000_000, 0.03


def read_header(source: Source, max_pixels: int) -> Header:
    """Reads the header of encoded data.

    Raises:
        MissingFileError: the file does not exist.
        UnshutterError: the data are unreadable, damaged, of an unknown format or an unsupported kind, have more pixels
            than ``max_pixels`` or than their bytes can encode, or need an extra that is not installed.
    """
    format = recognise(source)
    try:
        header, length = format.read_header(source), source.length
    except OSError as error:
        raise UnshutterError(f"cannot read {{photo}}: {error.strerror}", photo=source) from None
    pixels = header.width * header.height
    size = f"{header.width}x{header.height} px ({pixels / 1e6:.0f} megapixels)"
    if pixels > max_pixels:
        raise UnshutterError(
            f"{{photo}} has {size}, more than the limit of {max_pixels / 1e6:g} megapixels", photo=source
        )
    if pixels >= _MANY_PIXELS and 8 * length < _LEAST_BITS * pixels:
        raise UnshutterError(f"{{photo}} is not a photo: {size} cannot come from {length} bytes", photo=source)
    return header


def recognise(source: Source) -> Format:
    """Recognises the format of encoded data by their first bytes, because extensions may be wrong.

    Raises:
        MissingFileError: the file does not exist; UnshutterError: it is unreadable, empty, or of an unknown format.
    """
    suffix = source.path.suffix.lower() if source.path else ""
    if source.path:
        check_plain(source.path)
    if suffix == SEVERAL_PICTURES:
        raise UnshutterError("{photo} holds several pictures (MPO): unshutter takes single photos", photo=source)
    try:
        with source.stream() as stream:
            head = stream.read(_HEAD_BYTES)
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
    if format is None:
        raise UnshutterError("{photo} is not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw picture", photo=source)
    return format
