"""TIFF: lossless, 8 or 16 bits; EXIF and IPTC are stored among its own tags.

Source: TIFF 6.0.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.inventory import Fate
from unshutter.photo import chunks, exif, maker_notes, xmp
from unshutter.photo.directories import SUBFILE_TYPE, Entry, Tree, read_tree
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Metadata, Picture, Resolution, WrittenFormat
from unshutter.photo.libvips import Source, field
from unshutter.photo.parts import OTHER, Found, of_coding

if TYPE_CHECKING:
    import numpy as np


_SAMPLES = 0x0115
_EXTRA_SAMPLES = 0x0152
_OLD_JPEG, _JPEG = 6, 7  # compressions
# number of colour samples, by photometric interpretation
_COLOURS: dict[int | None, int] = {0: 1, 1: 1, 2: 3, 3: 1, 6: 3}
# meanings of an extra sample but 0, which is unspecified
_TRANSPARENCY = (1, 2)  # for 1, libvips undoes the premultiplication
_LAYERS = 0x935C
_OF_RESOURCES = {chunks.IPTC_TAG, chunks.RESOURCES_TAG}
_HELD = {0x8773: ("colour profile", "icc"), xmp.TIFF_TAG: ("XMP", "xmp")}  # name, attribute of ``Metadata``
# Tags that describe the encoding of the pixels, or smaller copies of them (TIFF 6.0; 330, 347); padding by Windows
_CODING_TAGS = frozenset(
    {0xEA1C, *range(0xFE, 0x10B), 0x111, 0x112, *range(0x115, 0x11A), 0x11C, *range(0x120, 0x126), 0x128, 0x12D, 0x13D}
    | {*range(0x140, 0x14B), *range(0x14C, 0x157), *range(0x158, 0x15C), *range(0x200, 0x20A), *range(0x211, 0x215)}
)
_SHORT, _FRACTION = 3, 5  # TIFF types
_MOST_PARTS = 1000  # maximum denominator: 9000/127 per centimetre are 180 per inch
_SMALLER_COPY, _MASK = 1, 4  # bits of a subfile's type
_CLASSIC_BYTES = 3_500_000_000  # larger files become BigTIFFs


@final
class Tiff(WrittenFormat):
    """TIFF: 8 or 16 bits, lossless."""

    loader = "tiffload"
    signature = re.compile(rb"II[*+]\0|MM\0[*+]")  # +: BigTIFF
    longest_side = 10_000_000
    deep = True
    grey = True
    alpha = True
    masks = True
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "description"})

    def read_header(self, source: Source) -> Header:
        """See Format."""
        with source.stream() as stream:
            tree = read_tree(stream) or Tree("<", [{}])
        _check_kind(source, tree)
        image = picture_format.open_image(self, source)
        coding = Coding(
            bits=field(image, "bits-per-sample", 8),
            compression=tree.number(exif.COMPRESSION),
            masked=_extra_samples(tree) == 1 and tree.number(_EXTRA_SAMPLES) not in _TRANSPARENCY,
        )
        metadata = picture_format.metadata_of(image)
        if exif.has_no_resolution_unit(tree):  # libvips reads that as pixels per millimetre
            metadata = replace(metadata, resolution=Resolution())
        resources = chunks.resources_of_tiff(tree)
        metadata = replace(metadata, exif=exif.of_tiff(tree), resources=resources, description=None)
        metadata = replace(metadata, found=tuple(_parts(tree, metadata)))
        kinds = [tree.number(SUBFILE_TYPE, page=page) or 0 for page in range(len(tree.pages))]
        pictures = sum(not kind & (_SMALLER_COPY | _MASK) for kind in kinds)
        return picture_format.header(self, source, image, coding, metadata, pictures)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. Damaged JPEG data cause only a warning; most other warnings are harmless."""
        fail_on = "warning" if header.coding.compression == _JPEG else "error"
        return picture_format.decode_pixels(self, source, fail_on)

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        image = picture.image
        metadata = picture.metadata
        written = replace(picture, metadata=replace(metadata, resolution=metadata.main_resolution))
        size = image.width * image.height * image.bands * (2 if image.format == "ushort" else 1)
        options = {"compression": {1: "none", 5: "lzw"}.get(picture.coding.compression or 0, "deflate")}
        if options["compression"] != "none":
            options["predictor"] = "horizontal"
        return picture_format.encode(written, "tiffsave", path, bigtiff=size > _CLASSIC_BYTES, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat."""
        metadata = picture.metadata
        image = picture.image
        more = chunks.resource_tags(metadata.resources) | _exact(metadata.main_resolution)
        if picture.masked:  # libvips declares it as transparency
            more[_EXTRA_SAMPLES] = Entry(_SHORT, 1, struct.pack("=H", 0))
        if exif.add_to_tiff(file, metadata.exif, image.height, image.width, more):
            unplaced = exif.read(metadata.exif).pages[0].keys() - _HELD.keys() - set(exif.RESOLUTION) - _OF_RESOURCES
            return [
                part.name
                for part in map(_own_part, sorted(unplaced))
                if part.otherwise is Fate.LEFT_OUT and not part.held
            ]
        return ["EXIF and IPTC (the TIFF is too large)"]


def _exact(resolution: Resolution) -> dict[int, Entry]:
    """Returns the resolution as exact fractions, because libvips rounds it: 230 pixels per inch become 229.999."""
    unit_mm = 25.4 if resolution.unit == "in" else 10.0
    tags = {}
    for tag, per_mm in zip(exif.RESOLUTION, resolution[:2], strict=True):
        exact = Fraction(per_mm * unit_mm).limit_denominator(_MOST_PARTS)
        if 0 < exact.numerator < 1 << 32:
            tags[tag] = Entry(_FRACTION, 1, struct.pack("=II", exact.numerator, exact.denominator))
    return tags


def _check_kind(source: Source, tree: Tree) -> None:
    """Rejects files that libvips would read wrongly."""
    if tree.number(exif.COMPRESSION) == _OLD_JPEG:
        raise UnshutterError(
            "{photo} contains an old-style JPEG: save it again with another program first", photo=source
        )
    if _COLOURS.get(tree.number(exif.PHOTOMETRIC)) == 1 and _extra_samples(tree) > 1:
        raise UnshutterError(
            f"{{photo}} has {_extra_samples(tree)} channels in addition to grey: convert it to grey or RGB first",
            photo=source,
        )


def _extra_samples(tree: Tree) -> int:
    """Returns the number of channels beyond grey or RGB."""
    samples = tree.number(_SAMPLES) or 1
    return samples - _COLOURS.get(tree.number(exif.PHOTOMETRIC), samples)


def _parts(tree: Tree, metadata: Metadata) -> Iterator[Found]:
    """Yields a part for each tag of the first page, and one for each further page."""
    for tag, entry in tree.pages[0].items():
        size = len(entry.data) if isinstance(entry, Entry) else 0
        if tag in exif.RESOLUTION:
            yield picture_format.resolution_part(metadata, size)
        elif tag in _OF_RESOURCES:
            yield picture_format.resources_part(metadata.resources, size)
        elif tag in _HELD:
            name, held = _HELD[tag]
            yield Found(name, size, held)
        else:
            yield _own_part(tag, size)
    if maker_notes.is_incomplete(tree):
        yield Found("parts of the maker's note")
    for page in range(1, len(tree.pages)):
        kind = tree.number(SUBFILE_TYPE, page=page) or 0
        yield Found("mask channel") if kind & _MASK else of_coding("thumbnail")


def _own_part(tag: int, size: int = 0) -> Found:
    """Returns the part for a tag without a place of its own in metadata."""
    if exif.is_carried(tag):
        return Found("EXIF", size, "exif")
    if tag in _CODING_TAGS:
        return of_coding("coding", size)
    return Found("Photoshop's layers" if tag == _LAYERS else OTHER, size)
