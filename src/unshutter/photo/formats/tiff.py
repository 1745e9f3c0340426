"""TIFF: lossless, 8 or 16 bits; EXIF and IPTC are stored among its own tags.

Source: TIFF 6.0.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.photo import chunks, exif, maker_notes
from unshutter.photo.directories import CLASSIC, SUBFILE_TYPE, Tree, header_of, read_tree, slots
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Picture, Resolution, WrittenFormat
from unshutter.photo.libvips import Source, field

if TYPE_CHECKING:
    import numpy as np


_COMPRESSION, _PHOTOMETRIC, _SAMPLES, _EXTRA_SAMPLES = 0x0103, 0x0106, 0x0115, 0x0152
_OLD_JPEG, _JPEG = 6, 7  # compressions
_COLOURS = {0: 1, 1: 1, 2: 3, 3: 1, 6: 3}  # number of colour samples, by photometric interpretation
_UNSPECIFIED, _TRANSPARENCY = 0, (1, 2)  # meanings of an extra sample; for (1), libvips undoes the premultiplication
_PRIVATE, _LAYERS, _ICC = 0x8000, 0x935C, 0x8773
_CARRIED = {chunks.IPTC_TAG, chunks.RESOURCES_TAG, _ICC, 0xEA1C}  # and a tag for padding by Windows
_RESOLUTION, _RESOLUTION_UNIT = (0x011A, 0x011B), 0x0128
_FRACTION, _MOST_PARTS = 5, 1000  # TIFF type; maximum denominator: 9000/127 per centimetre are 180 per inch
_PER_MM = {2: 25.4, 3: 10.0}  # by unit
_MOST_TAGS = 4096  # per directory
_SMALLER_COPY, _MASK = 1, 4  # bits of a subfile's type
_CLASSIC_BYTES = 3_500_000_000  # larger files become BigTIFFs


@final
class Tiff(WrittenFormat):
    """TIFF: 8 or 16 bits, lossless."""

    name = written_as = "tiff"
    suffixes, signature = (".tif", ".tiff"), re.compile(rb"II[*+]\0|MM\0[*+]")  # +: BigTIFF
    longest_side, deep, grey, alpha, masks = 10_000_000, True, True, True, True
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "description"})

    def read_header(self, source: Source) -> Header:
        """See Format."""
        with source.stream() as stream:
            tree = read_tree(stream)
            numbers = _numbers(stream)
        _check_kind(source, numbers)
        image = picture_format.open_image(source, "tiffload")
        meaning = numbers.get(_EXTRA_SAMPLES, _UNSPECIFIED)
        coding = Coding(
            bits=field(image, "bits-per-sample", 8),
            compression=numbers.get(_COMPRESSION),
            masked=_extra_samples(numbers) == 1 and meaning not in _TRANSPARENCY,
        )
        metadata = replace(picture_format.metadata_of(image), resources=None)
        if tree is None:
            return picture_format.header(self, source, image, coding, metadata)
        if exif.has_no_resolution_unit(tree):  # libvips reads that as pixels per millimetre
            metadata = replace(metadata, resolution=Resolution())
        metadata = replace(
            metadata, exif=exif.of_tiff(tree), resources=chunks.resources_of_tiff(tree), description=None
        )
        metadata = replace(metadata, left_behind=tuple(_left_behind(tree)))
        return picture_format.header(self, source, image, coding, metadata, _pictures(tree))

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. Damaged JPEG data cause only a warning; most other warnings are harmless."""
        fail_on = "warning" if header.coding.compression == _JPEG else "error"
        return picture_format.decode(source, "tiffload", fail_on)

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        image, metadata = picture.image, picture.metadata
        written = replace(picture, metadata=replace(metadata, resolution=metadata.main_resolution))
        size = image.width * image.height * image.bands * (2 if image.format == "ushort" else 1)
        options = {"compression": {1: "none", 5: "lzw"}.get(picture.coding.compression or 0, "deflate")}
        if options["compression"] != "none":
            options["predictor"] = "horizontal"
        return picture_format.encode(written, "tiffsave", path, bigtiff=size > _CLASSIC_BYTES, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat."""
        metadata, image = picture.metadata, picture.image
        _put_resolution(file, metadata.main_resolution)
        more = chunks.resource_tags(metadata.resources)
        added = exif.add_to_tiff(file, metadata.exif, image.height, image.width, more)
        if picture.masked:
            _put_number(file, _EXTRA_SAMPLES, _UNSPECIFIED)  # libvips declares it as transparency
        tree = exif.read(metadata.exif)
        return [*(_unknown_tags(tree) if tree else ())] if added else ["EXIF and IPTC (the TIFF is too large)"]


def _check_kind(source: Source, numbers: dict[int, int]) -> None:
    """Rejects files that libvips would read wrongly."""
    if numbers.get(_COMPRESSION) == _OLD_JPEG:
        raise UnshutterError(
            "{photo} contains an old-style JPEG: save it again with another program first", photo=source
        )
    if _COLOURS.get(numbers.get(_PHOTOMETRIC, -1)) == 1 and _extra_samples(numbers) > 1:
        raise UnshutterError(
            f"{{photo}} has {_extra_samples(numbers)} channels in addition to grey: convert it to grey or RGB first",
            photo=source,
        )


def _extra_samples(numbers: dict[int, int]) -> int:
    """Returns the number of channels beyond grey or RGB."""
    return numbers.get(_SAMPLES, 1) - _COLOURS.get(numbers.get(_PHOTOMETRIC, -1), numbers.get(_SAMPLES, 1))


def _left_behind(tree: Tree) -> Iterator[str]:
    """Names the parts that no result contains: unknown tags, and parts of the maker note."""
    yield from _unknown_tags(tree)
    if maker_notes.is_incomplete(tree):
        yield "parts of the maker's note"


def _unknown_tags(tree: Tree) -> Iterator[str]:
    """Names private tags that no TIFF result contains; lower tags are copied, or belong to the old encoding."""
    for tag in tree.pages[0]:
        if tag == _LAYERS:
            yield "Photoshop's layers"
        elif tag >= _PRIVATE and tag not in _CARRIED and not exif.is_carried(tag):
            yield f"tag {tag}"


# ---- directories ---------------------------------------------------------------------------------------


def _places(file: BinaryIO) -> tuple[str, dict[int, tuple[int, int]]]:
    """Returns the byte order, and TIFF type and position of each tag's value in the first directory."""
    length, header = file.seek(0, io.SEEK_END), header_of(file)
    order, layout, at = header or ("<", CLASSIC, length)
    file.seek(min(at, length))
    counted = file.read(struct.calcsize("=" + layout.count))
    if len(counted) < struct.calcsize("=" + layout.count):
        return order, {}
    (count,) = struct.unpack(order + layout.count, counted)
    table, start = file.read(layout.entry_bytes * min(count, _MOST_TAGS)), at + len(counted)
    listed = slots(table, order, 0, len(table) // layout.entry_bytes, layout)
    return order, {slot.tag: (slot.kind, start + slot.value_at) for slot in listed}


def _numbers(file: BinaryIO) -> dict[int, int]:
    """Returns integer values by tag from the first directory; 0 for tags that are not integers."""
    order, places = _places(file)
    numbers = {}
    for tag, (kind, at) in places.items():
        file.seek(at)
        data, form = file.read(4), {1: "B", 3: "H", 4: "I"}.get(kind)
        numbers[tag] = struct.unpack_from(order + form, data)[0] if form and len(data) == 4 else 0
    return numbers


def _put_number(file: BinaryIO, tag: int, number: int) -> None:
    """Replaces the value of a tag with a single SHORT."""
    order, places = _places(file)
    if tag in places:
        file.seek(places[tag][1])
        file.write(struct.pack(order + "H", number))


def _put_resolution(file: BinaryIO, resolution: Resolution) -> None:
    """Writes the resolution as exact fractions, because libvips rounds it: 230 pixels per inch become 229.999."""
    header, (order, places) = header_of(file), _places(file)
    by_unit = _PER_MM.get(_numbers(file).get(_RESOLUTION_UNIT, 0))
    for tag, per_mm in zip(_RESOLUTION, resolution[:2], strict=True):
        kind, at = places.get(tag, (0, 0))
        if header is None or by_unit is None or kind != _FRACTION:
            continue
        exact = Fraction(per_mm * by_unit).limit_denominator(_MOST_PARTS)
        if header[1] is CLASSIC:  # eight bytes, which do not fit in the entry
            file.seek(at)
            (at,) = struct.unpack(order + "I", file.read(4))
        if 0 < exact.numerator < 1 << 32:
            file.seek(at)
            file.write(struct.pack(order + "II", exact.numerator, exact.denominator))


def _pictures(tree: Tree) -> int:
    """Counts the pages of a TIFF that are pictures; reduced copies and masks do not count."""
    kinds = [tree.number(SUBFILE_TYPE, page=page) or 0 for page in range(len(tree.pages))]
    return sum(not kind & (_SMALLER_COPY | _MASK) for kind in kinds)
