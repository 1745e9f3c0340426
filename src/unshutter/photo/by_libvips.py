"""Code shared by all formats that libvips reads and writes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Orientation
from unshutter.photo.format import Coding, Format, Header, Picture
from unshutter.photo.libvips import computed, field, libvips, refusing, set_blob
from unshutter.photo.metadata import Metadata, Resolution
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_KEEP_EXIF, _KEEP_XMP, _KEEP_IPTC, _KEEP_ICC, _KEEP_OTHER = 1, 2, 4, 8, 16  # flags of libvips
_KEEP = _KEEP_XMP | _KEEP_IPTC | _KEEP_ICC | _KEEP_OTHER
_PLACEHOLDER = exif.PREFIX + b"II*\0\x08\0\0\0" + bytes(6)  # libvips refuses to write long EXIF
_SAMPLES = {
    "float": "32-bit float",
    "double": "64-bit float",
    "uint": "32-bit",
    "int": "32-bit signed",
    "char": "8-bit signed",
    "short": "16-bit signed",
}


class ExifBlock(NamedTuple):
    """EXIF in a file: its bytes, and the position of the marker by which libvips recognises it."""

    marker_at: int
    blob: bytes


def without_exif_loops(source: Source, exif_blocks: Callable[[BinaryIO], Iterable[ExifBlock]]) -> Source:
    """Hides EXIF whose directories contain loops from libvips, which would take minutes to read them.

    Args:
        source: the encoded data.
        exif_blocks: finds the EXIF in a file of the format.
    """
    with suppress(OSError), source.stream() as stream:  # libvips reports errors in the file
        places = [block.marker_at for block in exif_blocks(stream) if exif.has_loop(block.blob)]
        if places:
            return source.patched(places, b"none")
    return source


def metadata_of(image: pyvips.Image) -> Metadata:
    """Collects the metadata that libvips found in a file."""
    return Metadata(
        exif=field(image, "exif-data"),
        icc=field(image, "icc-profile-data"),
        xmp=field(image, "xmp-data"),
        resources=field(image, "iptc-data"),
        resolution=Resolution(image.xres, image.yres, field(image, "resolution-unit")),
        description=field(image, "image-description"),
    )


def open_image(source: Source, operation: str) -> pyvips.Image:
    """Opens the picture without decoding its pixels.

    Raises:
        UnshutterError: libvips cannot read it.
    """
    with refusing("{photo} is damaged, incomplete or unusual", photo=source):
        image = source.load(operation, access="sequential")
        image.get_fields()  # checked here because their names may be damaged, too
    return image


def header(
    format: Format,
    source: Source,
    image: pyvips.Image,
    coding: Coding,
    metadata: Metadata,
    pictures: int | None = None,
) -> Header:
    """Creates the header of a picture opened by libvips.

    Args:
        format: format of the file.
        source: the file.
        image: its picture, not yet decoded.
        coding: how it is encoded.
        metadata: metadata of the picture.
        pictures: number of pictures in the file; None: as counted by libvips.

    Raises:
        UnshutterError: the file holds several pictures, or pixels of an unsupported kind.
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
    """Rejects CMYK or CIELAB colours, samples other than 8 or 16 bits unsigned, and more than four channels."""
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


def decode(source: Source, operation: str, fail_on: str = "error") -> np.ndarray:
    """Decodes the pixels [H, W, bands].

    Args:
        source: the file.
        operation: libvips's loader.
        fail_on: minimum severity of libvips's warnings and errors at which to fail.

    Raises:
        UnshutterError: the file is damaged or incomplete. (Most of libvips's warnings for PNG and TIFF are harmless.)
    """
    with refusing("{photo} is damaged or incomplete", photo=source):
        return computed(source.load(operation, access="sequential", fail_on=fail_on))


def encode(picture: Picture, operation: str, path: Path | None, **options: Any) -> bytes | None:
    """Encodes a picture to a file, or to bytes without ``path``; raises ``pyvips.Error`` on failure.

    Args:
        picture: pixels, and the metadata to be written by libvips. A placeholder is written instead of EXIF.
        operation: libvips's saver.
        path: the file.
        options: options of the operation.
    """
    image = _with_fields(picture.image, picture.metadata, picture.orientation)
    options["keep"] = _KEEP if picture.metadata.exif is None else _KEEP | _KEEP_EXIF
    if path is None:
        return getattr(image, operation + "_buffer")(**options)
    return getattr(image, operation)(os.fsencode(path), **options)


def _with_fields(image: pyvips.Image, metadata: Metadata, orientation: Orientation) -> pyvips.Image:
    """Adds the metadata to an image as fields that libvips writes to a file."""
    resolution = metadata.resolution
    image = image.copy(xres=resolution.across, yres=resolution.down)
    image.set_type(libvips().GValue.gint_type, "orientation", int(orientation))
    for name, text in (("resolution-unit", resolution.unit), ("image-description", metadata.description)):
        if text is not None:
            image.set_type(libvips().GValue.refstr_type, name, text)
    blobs = {"icc-profile-data": metadata.icc, "xmp-data": metadata.xmp}
    blobs["exif-data"] = None if metadata.exif is None else _PLACEHOLDER
    for name, data in blobs.items():
        if data is not None:
            set_blob(image, name, data)
    return image
