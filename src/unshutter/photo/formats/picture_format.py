"""The interface of a file format, and code shared by those that libvips reads and writes."""

from __future__ import annotations

import dataclasses
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, ClassVar, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.inventory import Fate
from unshutter.options.picture_formats import FormatRow
from unshutter.orientation import Orientation
from unshutter.photo import chunks, exif, regions
from unshutter.photo import resources as image_resources
from unshutter.photo.auxiliary_pictures import Auxiliaries
from unshutter.photo.code_points import CodePoints
from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.embedded_video import AppendedVideo
from unshutter.photo.libvips import Source, computed, field, libvips, refusing, set_blob
from unshutter.photo.parts import DAMAGED, EXTENDED_XMP, Found, without
from unshutter.photo.placement import Placement

if TYPE_CHECKING:
    import numpy as np
    import pyvips


class Resolution(NamedTuple):
    """The resolution at which a picture is to be printed."""

    across: float = 1.0
    down: float = 1.0
    unit: str | None = None  # unit in the TIFF or JPEG, as named by libvips: ``in`` or ``cm``

    @property
    def is_known(self) -> bool:
        """Whether the resolution was set deliberately: False for values that libraries write by default."""
        # px/mm: libvips's default, and the usual value written by careless programs
        return not all(any(abs(own - usual) < 0.01 for usual in (1.0, 72 / 25.4)) for own in (self.across, self.down))


@dataclass(frozen=True)
class Metadata:
    """A photo's metadata, as returned by a format's reader and accepted by its writer."""

    exif: bytes | None = None  # EXIF, with or without its prefix
    icc: bytes | None = None  # ICC profile
    code_points: CodePoints | None = None  # what states the colours instead, and takes precedence
    xmp: bytes | None = None  # XMP packet
    resources: bytes | None = None  # Photoshop's image resources, including IPTC
    resolution: Resolution = dataclasses.field(default_factory=Resolution)  # resolution of the picture
    description: str | None = None  # TIFF's ImageDescription
    # (name, data) of a PNG's texts, colours and other chunks, which are copied unchanged
    chunks: tuple[tuple[bytes, bytes], ...] = ()
    # unit (0: none, 1: inch, 2: cm), and pixels per unit across and down, from a JPEG's JFIF header
    density: tuple[int, int, int] | None = None
    comments: tuple[bytes, ...] = ()  # comments of a JPEG
    video: AppendedVideo | None = None  # of a motion photo, with all other data that follow the picture in its JPEG
    auxiliaries: Auxiliaries | None = None  # gain map, depth map, mattes
    found: tuple[Found, ...] = ()  # the parts of its file
    moved_in: frozenset[str] = frozenset()  # attributes in which places were moved or removed

    def moved(self, placement: Placement) -> Metadata:
        """Returns the metadata for a picture that shows everything at other places.

        Places in the picture are moved, or removed and named, like those that tie pixels of another size to the earth.
        """
        blob, packet, resources = self.exif, self.xmp, self.resources
        removed = []
        gone = []
        if placement.size != placement.new_size and (without := exif.without_geotiff(blob)) is not blob:
            blob = without
            gone.append(Found("GeoTIFF", reason="the picture is cropped"))
        if blob is not None:
            blob, names = exif.with_subject_moved(blob, placement)
            removed += names
        if packet is not None:
            packet, names = regions.moved(packet, placement)
            removed += names
        if resources is not None:
            resources, names = image_resources.moved(resources, placement)
            removed += names
        gone += map(Found, dict.fromkeys(removed))
        now = {"exif": blob, "xmp": packet, "resources": resources}
        moved_in = frozenset(name for name, value in now.items() if value != getattr(self, name))
        return replace(self, **now, found=(*self.found, *gone), moved_in=moved_in)

    def with_auxiliaries(self, auxiliaries: Auxiliaries | None) -> Metadata:
        """Returns the metadata for new pixels, given the auxiliary pictures that fit them."""
        if self.auxiliaries is None:
            return self
        left = set() if auxiliaries is None else {each.name for each in auxiliaries.pictures}
        gone = {each.name for each in self.auxiliaries.pictures} - left
        if auxiliaries is None or auxiliaries.extension is None:
            gone.add(EXTENDED_XMP)
        found = (
            part._replace(held="") if part.held == "auxiliaries" and part.name in gone else part for part in self.found
        )
        return replace(
            self, auxiliaries=auxiliaries, found=tuple(found), moved_in=self.moved_in | frozenset({"auxiliaries"})
        )

    def without_exif_loop(self) -> Metadata:
        """Returns the metadata; EXIF whose directories contain a loop is rewritten, or left out if it cannot be."""
        if self.exif is None or not exif.has_loop(self.exif):
            return self
        blob = exif.of_tiff(exif.read(self.exif))
        return replace(self, exif=blob, found=without(self.found, "exif", "EXIF", DAMAGED))

    @property
    def main_resolution(self) -> Resolution:
        """The resolution for a format with one place for it: EXIF's, otherwise the file's own."""
        own = exif.resolution(self.exif)
        return Resolution(*own) if own else self.resolution

    @property
    def jfif_density(self) -> tuple[int, int, int] | None:
        """Unit and density for a JFIF header; None if EXIF contains the resolution, or it is unknown."""
        if self.density is None and self.exif is None and self.resolution.is_known:
            per_cm = (min(max(round(10 * px), 1), 65_535) for px in self.resolution[:2])
            return 2, next(per_cm), next(per_cm)
        return self.density


@dataclass(frozen=True)
class Coding:
    """Encoding parameters of a picture, so that its successor can be encoded alike."""

    quality: int | None = None  # JPEG quality, 1 ... 100.
    subsampled: bool = False  # whether chroma has half resolution
    lossless: bool = False  # whether it is lossless (WebP only)
    bits: int = 8  # bits per sample
    compression: int | None = None  # TIFF's number of the compression
    # whether the last of 2 or 4 channels is a mask or similar, not declared as transparency in the file (TIFF only)
    masked: bool = False


@dataclass(frozen=True)
class Header:
    """Properties of a picture that has not been decoded yet."""

    format: Format  # format of the file
    coding: Coding  # how it is encoded
    height: int  # of the stored pixels, as the width [px]
    width: int
    bands: int  # number of channels, including alpha
    orientation: Orientation  # orientation of the stored pixels
    metadata: Metadata  # metadata to copy to results


@dataclass(frozen=True)
class Picture:
    """A picture to be written to a file."""

    image: pyvips.Image  # its pixels, without metadata
    metadata: Metadata  # metadata to write
    orientation: Orientation  # orientation of the pixels
    coding: Coding  # how the original was encoded
    quality: int | None = None  # 1-100; None: like the original

    @property
    def masked(self) -> bool:
        """Whether the last channel is a mask rather than transparency."""
        return self.image.bands in (2, 4) and self.coding.masked

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is transparency."""
        return self.image.bands in (2, 4) and not self.coding.masked


class Format(ABC):
    """Reads the files of one row of the table of picture formats."""

    # factors by which pictures can be reduced during decoding to save work, in descending order
    shrinks: ClassVar[tuple[int, ...]] = ()

    signature: ClassVar[re.Pattern[bytes]]  # of its files' first bytes, of which 64 are read

    def __init__(self, row: FormatRow) -> None:
        self.row = row

    def recognises(self, source: Source, head: bytes) -> bool:
        """Whether a file with these first bytes has this format, unless a format checked earlier claims it."""
        return self.signature.match(head) is not None

    @abstractmethod
    def read_header(self, source: Source) -> Header:
        """Reads the header of a file."""

    @abstractmethod
    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """Decodes all stored pixels: [H, W, bands] uint8 or uint16, read-only; large pictures are in a temporary file.

        Rows and columns may be reduced by one of the factors ``shrinks``, rounding up.
        """


class WrittenFormat(Format):
    """Reads and writes files through libvips."""

    loader: ClassVar[str]  # libvips's operation that reads it
    longest_side: ClassVar[int]  # maximum side [px]
    deep: ClassVar[bool]  # whether it supports more than 8 bits
    grey: ClassVar[bool]  # whether it supports pictures with one channel
    alpha: ClassVar[bool]  # whether it supports transparency
    masks: ClassVar[bool] = False  # whether it supports an extra channel that is not transparency
    holds: ClassVar[frozenset[str]]  # attributes of ``Metadata`` that its files can hold
    appends_pictures: ClassVar[bool] = False  # whether auxiliary pictures follow as JPEGs, which XMP lists

    def exif_blocks(self, file: BinaryIO) -> Iterable[tuple[int, bytes]]:
        """Returns the EXIF in a file that libvips would read: the position of its marker, and its bytes."""
        return ()

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return decode_pixels(self, source)

    def held_auxiliaries(self, auxiliaries: Auxiliaries) -> Auxiliaries | None:
        """Returns those that its files can hold; None if they can hold none. Pixels may not be decodable."""
        return auxiliaries if "auxiliaries" in self.holds else None

    def hidden_markers(self, file: BinaryIO) -> list[int]:
        """Returns the positions of markers to hide from libvips: those of EXIF whose directories contain loops."""
        return [marker_at for marker_at, blob in self.exif_blocks(file) if exif.has_loop(blob)]

    @abstractmethod
    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """Encodes a picture to a file, or to bytes without ``path``; raises ``pyvips.Error`` on failure.

        The format can hold its pixels; of its metadata, libvips writes those that it can preserve.
        """

    @abstractmethod
    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """Adds EXIF and other metadata that libvips does not write well to the file written by :meth:`encode`.

        libvips would take EXIF apart and rebuild it: tags unknown to it would be lost, and maker notes would move,
        which breaks those whose offsets are relative to the start of the blob.

        Returns:
            Names of metadata that the format ``holds`` but that did not fit, such as "maker's note".
        """


_KEEP_EXIF, _KEEP_XMP, _KEEP_IPTC, _KEEP_ICC, _KEEP_OTHER = 1, 2, 4, 8, 16  # flags of libvips
_KEEP = _KEEP_XMP | _KEEP_IPTC | _KEEP_ICC | _KEEP_OTHER
_PLACEHOLDER = EXIF_PREFIX + b"II*\0\x08\0\0\0" + bytes(6)  # libvips refuses to write long EXIF
_SAMPLES = {
    "float": "32-bit float",
    "double": "64-bit float",
    "uint": "32-bit",
    "int": "32-bit signed",
    "char": "8-bit signed",
    "short": "16-bit signed",
}


def readable(format: WrittenFormat, source: Source) -> Source:
    """Hides metadata from libvips that are not for it to read: EXIF with loops, texts that may be huge."""
    with suppress(OSError), source.stream() as stream:  # libvips reports errors in the file
        if places := format.hidden_markers(stream):
            stream.seek(0)
            copy = bytearray(stream.read())
            for at in places:
                copy[at : at + 4] = b"noNe"  # also a valid name of a chunk that nobody knows
            return Source(bytes(copy))
    return source


def resolution_part(metadata: Metadata, size: int = 0) -> Found:
    """Returns the part with the resolution, whose loss does not matter if it was never set deliberately."""
    otherwise = Fate.LEFT_OUT if metadata.resolution.is_known else Fate.REPLACED
    return Found("resolution", size, "resolution", otherwise)


def resources_part(resources: bytes | None, size: int = 0) -> Found:
    """Returns the part with Photoshop's resources."""
    return Found("IPTC" if chunks.has_iptc(resources or b"") else "Photoshop's data", size, "resources")


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


def open_image(format: WrittenFormat, source: Source) -> pyvips.Image:
    """Opens the picture without decoding its pixels."""
    with refusing("{photo} is damaged, incomplete or unusual", photo=source):
        image = readable(format, source).load(format.loader, access="sequential")
        image.get_fields()  # checked here because their names may be damaged, too
    return image


def header(
    format: Format, source: Source, image: pyvips.Image, coding: Coding, metadata: Metadata, pictures: int | None = None
) -> Header:
    """Creates the header of a picture opened by libvips, which also counts its ``pictures`` unless they are given."""
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


def decode_pixels(format: WrittenFormat, source: Source, fail_on: str = "error", **options: object) -> np.ndarray:
    """Decodes the pixels [H, W, bands]."""
    with refusing("{photo} is damaged or incomplete", photo=source):
        return computed(readable(format, source).load(format.loader, access="sequential", fail_on=fail_on, **options))


def encode(picture: Picture, operation: str, path: Path | None, **options: object) -> bytes | None:
    """Encodes a picture by one of libvips's savers, see WrittenFormat; a placeholder is written instead of EXIF."""
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
