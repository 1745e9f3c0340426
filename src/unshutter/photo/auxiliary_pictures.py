"""Auxiliary pictures: gain maps, depth maps and mattes, which show what the photo shows at a scale of their own.

Their pixels are decoded only when a result is rendered, and their metadata are kept byte for byte: they say what the
numbers mean. In a JPEG they are complete JPEGs behind the picture, which several lists name: CIPA's (MPF), Google's in
XMP, or both; Google's older depth maps are in XMP. A gain map (Adobe's and Google's, ISO's, Apple's) turns the SDR
picture into an HDR one.

Source: CIPA DC-007 (MPF); Google, Ultra HDR image format 1.1; ISO 21496-1; Apple, Applying Apple HDR effect to your
photos.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

from unshutter.errors import UnshutterError
from unshutter.photo import exif, extended_xmp, gain_map_metadata
from unshutter.photo.chunks import APP0, APP1, APP2, APP14, COMMENT, before_the_scan, encoded_segment
from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.gain_map_metadata import Meaning
from unshutter.photo.libvips import Source, as_image, computed, refusing
from unshutter.photo.parts import CONFIDENCE_MAP, DEPTH_MAP, GAIN_MAP

if TYPE_CHECKING:
    import numpy as np

LIST_PREFIX = b"MPF\0"
_LARGEST = 2  # times the photo's sides: a larger one is malicious
_PNG = b"\x89PNG"
QUALITY = 90  # of results: adds a thousandth of a stop to the mean error
# markers of its metadata; APP14 describes its coding
_KEPT = (*(marker for marker in range(APP0, APP0 + 16) if marker != APP14), COMMENT)
_FIRST, _UNDEFINED = 0x030000, 0  # kinds of pictures in CIPA's list
_LIST_VERSION, _COUNT, _ENTRIES = 0xB000, 0xB001, 0xB002  # its tags


class Stored(Protocol):
    """An auxiliary picture in the file of its photo."""

    def segments(self) -> list[tuple[int, bytes]]:
        """Returns its metadata as segments of a JPEG: marker and content."""
        ...

    def pixels(self) -> np.ndarray:
        """Decodes it: [h, w, bands] uint8; raises UnshutterError."""
        ...

    def file(self) -> bytes | None:
        """Returns its own JPEG or PNG as it is stored; None if it is stored in another format."""
        ...


@dataclass(frozen=True, eq=False)
class AuxiliaryPicture:
    """A picture in the photo's own coordinates, stretched over it."""

    name: str  # for people, and for its kind: gain map, depth map, mattes
    stored: Stored
    new_pixels: np.ndarray | None = None  # [h, w, bands] uint8 of a result; None: as it is stored
    in_xmp: str = ""  # property of extended XMP that holds it; empty: it follows the picture

    @property
    def is_nearest(self) -> bool:
        """Whether its values must not be mixed: there is nothing between near and far."""
        return self.name in (DEPTH_MAP, CONFIDENCE_MAP)

    @cached_property
    def pixels(self) -> np.ndarray:
        """Its pixels [h, w, bands] uint8; raises UnshutterError."""
        return self.stored.pixels() if self.new_pixels is None else self.new_pixels

    @cached_property
    def file(self) -> bytes:
        """The picture as a JPEG with its metadata, or as a PNG if it was one."""
        stored = self.stored.file()
        if self.new_pixels is None and stored is not None:
            return stored
        height, width = self.pixels.shape[:2]
        with refusing("cannot encode the " + self.name):
            if stored is not None and stored.startswith(_PNG):
                return as_image(self.pixels).pngsave_buffer(keep=0)
            coded = as_image(self.pixels).jpegsave_buffer(Q=QUALITY, subsample_mode="off", keep=0)
        metadata = b"".join(
            encoded_segment(marker, exif.with_size(content, height, width) if _is_exif(marker, content) else content)
            for marker, content in self.stored.segments()
        )
        return coded[:2] + metadata + coded[2:]


def _is_exif(marker: int, content: bytes) -> bool:
    return marker == APP1 and content.startswith(EXIF_PREFIX)


@dataclass(frozen=True)
class Auxiliaries:
    """The auxiliary pictures of a photo, and how its file lists them."""

    pictures: tuple[AuxiliaryPicture, ...]
    segments: tuple[bytes, ...] = ()  # contents of APP2 of the photo that say that there is a gain map (ISO)
    list_order: str = ""  # byte order of CIPA's list, as for struct; empty if there is none
    exif: bytes | None = None  # of the photo
    extension: bytes | None = None  # extended XMP about a depth map, of the photo
    # properties (name, content) of the picture that the gain map makes, as boxes state them
    alternate: tuple[tuple[bytes, bytes], ...] = ()
    alternate_has_other_colours: bool = False  # whether that picture is computed in other primaries than the photo's

    @property
    def gain_map(self) -> AuxiliaryPicture | None:
        """The gain map, which makes the photo HDR, if they include one."""
        return next((each for each in self.pictures if each.name == GAIN_MAP), None)

    @property
    def behind(self) -> list[AuxiliaryPicture]:
        """Those that follow the picture in a JPEG."""
        return [each for each in self.pictures if not each.in_xmp]

    @cached_property
    def extended_xmp(self) -> bytes | None:
        """Extended XMP with the pictures that it holds."""
        files = {each.in_xmp: each.file for each in self.pictures if each.in_xmp}
        return None if self.extension is None else extended_xmp.completed(self.extension, files)

    @cached_property
    def meaning(self) -> Meaning | None:
        """What the numbers of the gain map mean, in the form of ISO 21496-1; None if that is unknown."""
        try:
            return self.gain_map and gain_map_metadata.of_segments(self.gain_map.stored.segments(), self.exif)
        except UnshutterError:
            return None

    @property
    def iso_gain_map(self) -> np.ndarray | None:
        """The pixels of the gain map [h, w, bands] uint8, as :attr:`meaning` states; None if that is unknown."""
        if self.gain_map is None or self.meaning is None:
            return None
        pixels = self.gain_map.pixels
        return pixels if self.meaning.stops is None else gain_map_metadata.in_logarithms(pixels, self.meaning.stops)

    def rendered(self, new_pixels: Sequence[np.ndarray | None]) -> Auxiliaries | None:
        """Returns those of a result, given their pixels or None; None if none is left."""
        pairs = zip(self.pictures, new_pixels, strict=True)
        pictures = tuple(replace(each, new_pixels=new) for each, new in pairs if new is not None)
        return replace(self, pictures=pictures) if pictures else None

    def readable(self, as_jpeg: bool) -> Auxiliaries | None:
        """Returns those that can be written, as JPEGs or encoded again; None if none can."""
        pictures = []
        for each in self.pictures:
            with suppress(UnshutterError):  # the photo is good without it
                _ = each.file if as_jpeg else each.pixels
                pictures.append(each)
        if len(pictures) == len(self.pictures):
            return self
        return replace(self, pictures=tuple(pictures)) if pictures else None

    def in_front(self, at: int, length: int) -> bytes:
        """Returns segments for a position in the photo, which has a length without them [bytes]."""
        parts = [] if self.extended_xmp is None else extended_xmp.segments(self.extended_xmp)
        stated = b"".join(encoded_segment(APP1, each) for each in parts)
        stated += b"".join(encoded_segment(APP2, each) for each in self.segments)
        return stated + self._listed(at + len(stated), length + len(stated))

    def _listed(self, at: int, length: int) -> bytes:
        """Returns CIPA's list as a segment."""
        if not self.list_order:
            return b""
        order = self.list_order
        files = [each.file for each in self.behind]
        entries_at = 8 + 2 + 3 * 12 + 4
        size = 4 + len(LIST_PREFIX) + entries_at + 16 * (1 + len(files))
        entries = [(_FIRST, length + size, 0)]
        start = length + size - (at + 4 + len(LIST_PREFIX))  # counted from the list's own byte order
        for file in files:
            entries.append((_UNDEFINED, len(file), start))
            start += len(file)
        table = b"".join(struct.pack(order + "IIIHH", *entry, 0, 0) for entry in entries)
        head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "IH", 8, 3)
        head += struct.pack(order + "HHI4s", _LIST_VERSION, 7, 4, b"0100")
        head += struct.pack(order + "HHII", _COUNT, 4, 1, len(entries))
        head += struct.pack(order + "HHIII", _ENTRIES, 7, len(table), entries_at, 0)
        return encoded_segment(APP2, LIST_PREFIX + head + table)


class StoredJpeg(NamedTuple):
    """An auxiliary picture that is a JPEG in the file of its photo."""

    source: Source
    at: int
    length: int
    photo_size: tuple[int, int]  # height and width [px]

    def file(self) -> bytes:
        """See Stored."""
        try:
            with self.source.unchanged(), self.source.stream() as stream:
                stream.seek(self.at)
                return stream.read(self.length)
        except OSError as error:
            raise UnshutterError(f"cannot read {{photo}}: {error.strerror}", photo=self.source) from None

    def segments(self) -> list[tuple[int, bytes]]:
        """See Stored."""
        return list(before_the_scan(io.BytesIO(self.file()), _KEPT))

    def pixels(self) -> np.ndarray:
        """See Stored."""
        return _decoded(self.file(), self.photo_size)


class StoredInXmp(NamedTuple):
    """An auxiliary picture in extended XMP."""

    data: bytes  # JPEG or PNG
    photo_size: tuple[int, int]  # height and width [px]

    def file(self) -> bytes:
        """See Stored."""
        return self.data

    def segments(self) -> list[tuple[int, bytes]]:
        """See Stored."""
        return [] if self.data.startswith(_PNG) else list(before_the_scan(io.BytesIO(self.data), _KEPT))

    def pixels(self) -> np.ndarray:
        """See Stored."""
        return _decoded(self.data, self.photo_size)


def _decoded(file: bytes, photo_size: tuple[int, int]) -> np.ndarray:
    loader = "pngload" if file.startswith(_PNG) else "jpegload"
    with refusing("the auxiliary picture is damaged"):
        image = Source(file).load(loader, access="sequential", fail_on="warning")
        bands = image.bands if loader == "jpegload" else min(image.bands, 3)  # also with transparency
        check_auxiliary(image.height, image.width, bands, photo_size, str(image.format))
        return computed(image)


def check_auxiliary(height: int, width: int, bands: int, photo_size: tuple[int, int], samples: str = "uchar") -> None:
    """Raises UnshutterError for a size, a number of channels or samples that no auxiliary picture has."""
    is_large = height > _LARGEST * photo_size[0] or width > _LARGEST * photo_size[1]
    if is_large or bands not in (1, 3) or samples != "uchar":
        raise UnshutterError("the auxiliary picture is unusual")
