"""The steps that are the same for all formats that libvips reads and writes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.geometry.orientation import Orientation
from unshutter.photo.format import Coding, Format, Header
from unshutter.photo.libvips import computed, field, refusing, set_blob
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_KEEP_EXIF, _KEEP_XMP, _KEEP_IPTC, _KEEP_ICC, _KEEP_OTHER = 1, 2, 4, 8, 16  # libvips's flags
_KEEP = _KEEP_XMP | _KEEP_IPTC | _KEEP_ICC | _KEEP_OTHER
_PLACEHOLDER = exif.PREFIX + b"II*\0\x08\0\0\0" + bytes(6)  # libvips refuses to write much EXIF
_SAMPLES = {
    "float": "32-bit float",
    "double": "64-bit float",
    "uint": "32-bit",
    "int": "32-bit signed",
    "char": "8-bit signed",
    "short": "16-bit signed",
}


def opened(source: Source, operation: str) -> pyvips.Image:
    """The picture, its pixels not decoded yet.

    Raises:
        UnshutterError: libvips cannot make sense of it.
    """
    with refusing("{photo} is damaged, incomplete or unusual", photo=source):
        image = source.load(operation, access="sequential")
        image.get_fields()  # their names may be damaged, too
    return image


def header(
    format: Format,
    source: Source,
    image: pyvips.Image,
    coding: Coding,
    metadata: Metadata,
    pictures: int | None = None,
) -> Header:
    """The header of a picture as libvips sees it.

    Args:
        format: of the file.
        source: the file.
        image: its picture, not decoded yet.
        coding: how it is encoded.
        metadata: of the picture.
        pictures: in the file; None: as libvips counts them.

    Raises:
        UnshutterError: several pictures, or pixels of a kind that unshutter does not take.
    """
    count = field(image, "n-pages", 1) if pictures is None else pictures
    if count > 1:
        raise UnshutterError(
            f"{{photo}} holds {count} pictures: unshutter takes single photos, save them one by one", photo=source
        )
    _check_pixels(source, image)
    orientation = Orientation(field(image, "orientation") or exif.orientation(metadata.exif) or 1)
    return Header(format, coding, image.height, image.width, image.bands, orientation, metadata)


def _check_pixels(source: Source, image: pyvips.Image) -> None:
    """Refuses CMYK or CIELAB colours, samples other than 8 or 16 bits unsigned, more than four channels."""
    if image.interpretation == "cmyk":
        raise UnshutterError("{photo} is in CMYK colours: convert it to RGB first", photo=source)
    if image.interpretation in ("lab", "labs", "labq", "lch", "xyz", "yxy", "hsv"):
        raise UnshutterError(
            f"{{photo}} is in {str(image.interpretation).upper()} colours: convert it to RGB first", photo=source
        )
    if image.format not in ("uchar", "ushort"):
        kind = _SAMPLES.get(str(image.format), str(image.format))
        raise UnshutterError(f"{{photo}} has {kind} samples: convert it to 8 or 16 bits first", photo=source)
    if image.bands > 4:
        raise UnshutterError(f"{{photo}} has {image.bands} channels: convert it to grey or RGB first", photo=source)


def decoded(source: Source, operation: str, fail_on: str = "error") -> np.ndarray:
    """The pixels [H, W, bands].

    Args:
        source: the file.
        operation: libvips's.
        fail_on: the least complaint of libvips's that is refused.

    Raises:
        UnshutterError: damaged or incomplete. (Of PNG and TIFF libvips warns much that harms nothing.)
    """
    with refusing("{photo} is damaged or incomplete", photo=source):
        return computed(source.load(operation, access="sequential", fail_on=fail_on))


def encoded(
    image: pyvips.Image, operation: str, path: Path | None, with_exif: bool = False, **options: Any
) -> bytes | None:
    """A file of the image and its metadata, or its bytes without ``path``; ``pyvips.Error`` on failure.

    Args:
        image: pixels and metadata.
        operation: libvips's.
        path: the file.
        with_exif: whether libvips is to make a place for EXIF, if the image has any: what stands there is not it.
        options: of the operation.
    """
    options["keep"] = _KEEP
    if with_exif and field(image, "exif-data") is not None:
        options["keep"] |= _KEEP_EXIF
        image = image.copy()
        set_blob(image, "exif-data", _PLACEHOLDER)
    if path is None:
        return getattr(image, operation + "_buffer")(**options)
    return getattr(image, operation)(os.fsencode(path), **options)
