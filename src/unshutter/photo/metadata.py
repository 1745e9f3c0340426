"""What goes from a photo to its successors beside the pixels, whatever the file's format."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from unshutter.photo.containers import chunks, segments
from unshutter.photo.containers.motion_photo import Film
from unshutter.photo.libvips import field, libvips, set_blob
from unshutter.photo.tags import exif, iptc

if TYPE_CHECKING:
    import pyvips

# Fields that libvips does not know.
_DENSITY, _SEGMENTS, _FILM, _CHUNKS = "jpeg-density", "jpeg-segments", "jpeg-film", "png-chunks"
_UNTOLD = (1.0, 72 / 25.4)  # px/mm: where a file says nothing, and what programs write that know nothing


@dataclass(frozen=True)
class Metadata:
    """A photo's metadata.

    Attributes:
        exif: EXIF, with or without its prefix.
        icc: ICC profile.
        xmp: XMP packet.
        resources: Photoshop's image resources, with IPTC among them.
        resolution: across and down [px/mm].
        resolution_unit: in which a TIFF or JPEG said it.
        description: TIFF's ImageDescription.
        chunks: (name, data) of a PNG's texts, colours and others that go along as they are.
        density: unit (0: none, 1: inch, 2: cm), and pixels in it across and down, as a JPEG's JFIF header has them.
        segments: (marker, content) of a JPEG's comments, and of others that go along as they are.
        film: of a motion photo, with all else that comes behind the picture of its JPEG.
        left_behind: what no result gets, in words: the format's reader saw it, but nothing here can carry it.
    """

    exif: bytes | None = None
    icc: bytes | None = None
    xmp: bytes | None = None
    resources: bytes | None = None
    resolution: tuple[float, float] = (1.0, 1.0)
    resolution_unit: str | None = None
    description: str | None = None
    chunks: tuple[tuple[bytes, bytes], ...] = ()
    density: tuple[int, int, int] | None = None
    segments: tuple[tuple[int, bytes], ...] = ()
    film: Film | None = None
    left_behind: tuple[str, ...] = ()

    @classmethod
    def of_image(cls, image: pyvips.Image) -> Metadata:
        """What libvips found in a file."""
        return cls(
            exif=field(image, "exif-data"),
            icc=field(image, "icc-profile-data"),
            xmp=field(image, "xmp-data"),
            resources=field(image, "iptc-data"),
            resolution=(image.xres, image.yres),
            resolution_unit=field(image, "resolution-unit"),
            description=field(image, "image-description"),
        )

    def resized(self) -> Metadata:
        """The metadata of a picture of another size: what ties its pixels to places on the earth is left behind."""
        blob = exif.without_geotiff(self.exif)
        if blob is self.exif:
            return self
        return replace(self, exif=blob, left_behind=(*self.left_behind, "GeoTIFF (the picture is cropped)"))

    @property
    def tells_resolution(self) -> bool:
        """Whether the resolution says more than that nobody set it."""
        return not all(any(abs(told - usual) < 0.01 for usual in _UNTOLD) for told in self.resolution)

    def without_place(self, holds: frozenset[str]) -> Iterator[str]:
        """What of it a format cannot hold, in words.

        Args:
            holds: names of the attributes that the format has a place for.
        """
        if self.exif is not None and "exif" not in holds:
            yield "EXIF"
        if self.icc is not None and "icc" not in holds:
            yield "colour profile"
        if self.xmp is not None and "xmp" not in holds:
            yield "XMP"
        if self.resources is not None and "resources" not in holds:
            yield "IPTC" if iptc.has_iptc(self.resources) else "Photoshop's data"
        if self.tells_resolution and "resolution" not in holds:
            yield "resolution"
        if self.description is not None and "description" not in holds:
            yield "description"
        if "chunks" not in holds:
            yield from chunks.in_words(self.chunks, self.icc is not None)
        if self.segments and "segments" not in holds:
            yield (
                "comment"
                if any(marker == segments.COMMENT for marker, _ in self.segments)
                else "data of other programs"
            )
        if self.film is not None and "film" not in holds:
            yield "film"

    def on(self, image: pyvips.Image) -> pyvips.Image:
        """The image with these metadata, where libvips looks for them when it writes a file."""
        image = image.copy(xres=self.resolution[0], yres=self.resolution[1])
        texts = (("resolution-unit", self.resolution_unit), ("image-description", self.description))
        for name, text in texts:
            if text is not None:
                image.set_type(libvips().GValue.refstr_type, name, text)
        blobs = {"icc-profile-data": self.icc, "xmp-data": self.xmp, "iptc-data": self.resources}
        blobs |= {"exif-data": self.exif, _FILM: self.film and self.film.data, _DENSITY: self._density()}
        blobs[_SEGMENTS] = b"".join(segments.encoded(*segment) for segment in self.segments) or None
        blobs[_CHUNKS] = b"".join(chunks.encoded(*chunk) for chunk in self.chunks) or None
        for name, data in blobs.items():
            if data is not None:
                set_blob(image, name, data)
        image.set_type(libvips().GValue.gint_type, "resolution-told", int(self.tells_resolution))
        return image

    def _density(self) -> bytes | None:
        """The bytes of a JFIF header that tell the resolution; None where EXIF does, or nobody."""
        if self.density is None and self.exif is None and self.tells_resolution:
            return struct.pack(">BHH", 2, *(min(max(round(10 * px), 1), 65_535) for px in self.resolution))
        return None if self.density is None else struct.pack(">BHH", *self.density)
