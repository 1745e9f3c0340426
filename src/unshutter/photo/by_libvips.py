"""What all formats that libvips reads and writes have in common."""

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


class ExifBlock(NamedTuple):
    """EXIF in a file: its bytes, and the place of some of them that show libvips that this is EXIF."""

    marker_at: int
    blob: bytes


def without_exif_loops(source: Source, exif_blocks: Callable[[BinaryIO], Iterable[ExifBlock]]) -> Source:
    """The data, with EXIF whose directories lead back to themselves hidden from libvips, which would work for minutes.

    Args:
        source: the data.
        exif_blocks: finds the EXIF in a file of the format.
    """
    with suppress(OSError), source.stream() as stream:  # libvips reports what is wrong with a file
        places = [block.marker_at for block in exif_blocks(stream) if exif.has_loop(block.blob)]
        if places:
            return source.patched(places, b"none")
    return source


def metadata_of(image: pyvips.Image) -> Metadata:
    """The metadata that libvips found in a file."""
    return Metadata(
        exif=field(image, "exif-data"),
        icc=field(image, "icc-profile-data"),
        xmp=field(image, "xmp-data"),
        resources=field(image, "iptc-data"),
        resolution=Resolution(image.xres, image.yres, field(image, "resolution-unit")),
        description=field(image, "image-description"),
    )


def open_image(source: Source, operation: str) -> pyvips.Image:
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


def decode(source: Source, operation: str, fail_on: str = "error") -> np.ndarray:
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


def encode(picture: Picture, operation: str, path: Path | None, **options: Any) -> bytes | None:
    """A file of a picture, or its bytes without ``path``; ``pyvips.Error`` on failure.

    Args:
        picture: pixels, and the metadata that libvips is to write. Instead of EXIF it writes a placeholder.
        operation: libvips's.
        path: the file.
        options: of the operation.
    """
    image = _with_fields(picture.image, picture.metadata, picture.orientation)
    options["keep"] = _KEEP if picture.metadata.exif is None else _KEEP | _KEEP_EXIF
    if path is None:
        return getattr(image, operation + "_buffer")(**options)
    return getattr(image, operation)(os.fsencode(path), **options)


def _with_fields(image: pyvips.Image, metadata: Metadata, orientation: Orientation) -> pyvips.Image:
    """The image with the metadata where libvips looks for them when it writes a file."""
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
