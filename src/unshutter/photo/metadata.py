"""A photo's metadata, copied from its file to the result along with the pixels, in any pair of formats."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from unshutter.photo.containers import chunks
from unshutter.photo.containers.motion_photo import AppendedFilm
from unshutter.photo.tags import exif, iptc

_MEANINGLESS = (1.0, 72 / 25.4)  # px/mm: libvips's default, and the usual value written by careless programs


class Resolution(NamedTuple):
    """The resolution at which a picture is to be printed.

    Attributes:
        across, down: resolution [px/mm].
        unit: unit in the TIFF or JPEG, as named by libvips: ``in`` or ``cm``.
    """

    across: float = 1.0
    down: float = 1.0
    unit: str | None = None

    @property
    def is_known(self) -> bool:
        """Whether the resolution was set deliberately: False for values that libraries write by default."""
        return not all(any(abs(own - usual) < 0.01 for usual in _MEANINGLESS) for own in (self.across, self.down))


@dataclass(frozen=True)
class Metadata:
    """A photo's metadata, as returned by a format's reader and accepted by its writer.

    Attributes:
        exif: EXIF, with or without its prefix.
        icc: ICC profile.
        xmp: XMP packet.
        resources: Photoshop's image resources, including IPTC.
        resolution: resolution of the picture.
        description: TIFF's ImageDescription.
        chunks: (name, data) of a PNG's texts, colours and other chunks, which are copied unchanged.
        density: unit (0: none, 1: inch, 2: cm), and pixels per unit across and down, from a JPEG's JFIF header.
        comments: comments of a JPEG.
        film: film of a motion photo, with all other data that follow the picture in its JPEG.
        left_behind: names of metadata that the reader saw in the file but no writer can copy.
    """

    exif: bytes | None = None
    icc: bytes | None = None
    xmp: bytes | None = None
    resources: bytes | None = None
    resolution: Resolution = field(default_factory=Resolution)
    description: str | None = None
    chunks: tuple[tuple[bytes, bytes], ...] = ()
    density: tuple[int, int, int] | None = None
    comments: tuple[bytes, ...] = ()
    film: AppendedFilm | None = None
    left_behind: tuple[str, ...] = ()

    def resized(self) -> Metadata:
        """Returns the metadata for a picture of another size, without data that tie pixels to geographic positions."""
        blob = exif.without_geotiff(self.exif)
        if blob is self.exif:
            return self
        return replace(self, exif=blob, left_behind=(*self.left_behind, "GeoTIFF (the picture is cropped)"))

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

    def without_place(self, holds: frozenset[str]) -> Iterator[str]:
        """Yields the names of metadata that a format cannot hold.

        Args:
            holds: attributes of this class that the format can hold.
        """
        if self.exif is not None and "exif" not in holds:
            yield "EXIF"
        if self.icc is not None and "icc" not in holds:
            yield "colour profile"
        if self.xmp is not None and "xmp" not in holds:
            yield "XMP"
        if self.resources is not None and "resources" not in holds:
            yield "IPTC" if iptc.has_iptc(self.resources) else "Photoshop's data"
        if self.resolution.is_known and "resolution" not in holds:
            yield "resolution"
        if self.description is not None and "description" not in holds:
            yield "description"
        if "chunks" not in holds:
            yield from chunks.in_words(self.chunks, self.icc is not None)
        if self.comments and "comments" not in holds:
            yield "comment"
        if self.film is not None and "film" not in holds:
            yield "film"
