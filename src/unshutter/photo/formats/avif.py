"""AVIF: its boxes contain the picture's orientation and the position of its EXIF.

Source: ISO/IEC 23008-12 (HEIF), AV1 Image File Format.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, final

from unshutter.photo import by_libvips
from unshutter.photo.by_libvips import ExifBlock, without_exif_loops
from unshutter.photo.containers import boxes, items
from unshutter.photo.format import Coding, Header, Picture, WrittenFormat
from unshutter.photo.libvips import field, profile_of, threads
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np

_THREADS = 4  # of the encoder, on every machine: it splits the picture into tiles by their number
_SIGNATURE = re.compile(rb"....ftyp(avis|(....)*avif)", re.DOTALL)


@final
class Avif(WrittenFormat):
    """AVIF: 8, 10 or 12 bits, RGB; the decoder returns grey as three channels."""

    name = written_as = "avif"
    suffixes = (".avif",)
    longest_side, deep, grey, alpha = 16_384, True, False, True
    holds = frozenset({"exif", "icc", "xmp"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return _SIGNATURE.match(head) is not None

    def read_header(self, source: Source) -> Header:
        """See Format. The orientation is that of the boxes, which decoders apply; EXIF's is ignored."""
        boxes.refuse_animation(source)
        readable = without_exif_loops(source, _exif_blocks)
        image = by_libvips.open_image(readable, "heifload")
        with source.stream() as stream:
            own, left_behind = boxes.read_coding(stream), items.extras_in_words(stream)
        coding = Coding(subsampled=own.subsampled, bits=field(image, "bits-per-sample", 8))
        metadata = replace(by_libvips.metadata_of(image), left_behind=left_behind)
        if readable is not source:
            metadata = replace(metadata, exif=None, left_behind=("EXIF (damaged)", *left_behind))
        metadata = replace(metadata, exif=exif.with_header(metadata.exif))
        if metadata.icc is None:
            metadata = replace(metadata, icc=profile_of(*own.code_points, source))
        header = by_libvips.header(self, source, image, coding, metadata, pictures=1)
        height, width = own.orientation.size(header.height, header.width)
        bands = header.bands - 2 if own.grey else header.bands
        return replace(header, height=height, width=width, bands=bands, orientation=own.orientation)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        pixels = by_libvips.decode(without_exif_loops(source, _exif_blocks), "heifload")
        if header.bands <= 2 < pixels.shape[2]:
            pixels = pixels[..., [0] if pixels.shape[2] == 3 else [0, 3]]
        return header.orientation.stored(pixels)

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        coding = picture.coding
        deep = coding.bits if coding.bits in (10, 12) else 12
        options = {
            "compression": "av1",
            "Q": picture.quality or 80,
            "effort": 0,  # takes a quarter of the time of 2; docs/reference/formats.md describes what is lost
            "bitdepth": deep if picture.image.format == "ushort" else 8,
            "subsample_mode": "on" if coding.subsampled else "off",
        }
        with threads(_THREADS):
            return by_libvips.encode(picture, "heifsave", path, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. Appends EXIF, and makes the item of the zeroed placeholder point to it."""
        blob = picture.metadata.exif
        old = None if blob is None else _exif_extent(file)
        if blob is None or old is None:
            return [] if blob is None else ["EXIF"]
        end = file.seek(0, 2)
        content = struct.pack(">I", len(exif.PREFIX)) + exif.PREFIX + blob.removeprefix(exif.PREFIX)
        file.write(struct.pack(">I4s", 8 + len(content), b"mdat") + content)
        file.seek(old.base + old.offset)
        file.write(bytes(old.length))
        file.seek(old.numbers_at)
        file.write(struct.pack(">II", end + 8 - old.base, len(content)))
        return []


def _exif_blocks(file: BinaryIO) -> Iterator[ExifBlock]:
    extent = items.extent(file, b"Exif")
    if extent is not None:
        at, length = extent
        file.seek(at)
        content = file.read(length)  # four bytes with the position of the TIFF header, then EXIF
        start = 4 + int.from_bytes(content[:4], "big")
        yield ExifBlock(at + start, content[start:])


class _Extent(NamedTuple):
    """Position of an item of a box file.

    Attributes:
        numbers_at: position of two 32-bit numbers: offset, relative to ``base``, and length.
        base, offset, length: the values there.
    """

    numbers_at: int
    base: int
    offset: int
    length: int


def _exif_extent(file: BinaryIO) -> _Extent | None:
    """Finds the EXIF of an AVIF; returns None without EXIF, or if it is not stored in libheif's way."""
    try:
        meta = boxes.top_level(file, b"meta")
        iinf, iloc = (dict(boxes.inside(meta[4:]))[name] for name in (b"iinf", b"iloc"))
        entries = (content for name, content in boxes.inside(iinf[6:]) if name == b"infe")
        (item,) = [struct.unpack_from(">H", infe, 4)[0] for infe in entries if infe[8:12] == b"Exif"]
        if iinf[0] != 0 or iloc[0] != 0 or iloc[4:6] != b"\x44\x40":  # versions; offset, length and base of 32 bits
            return None
        (count,), at = struct.unpack_from(">H", iloc, 6), 8
        for _ in range(count):
            name, place, base, extents = struct.unpack_from(">HHIH", iloc, at)
            if name == item and (place, extents) == (0, 1):
                numbers_at = file.tell() - len(meta) + meta.index(iloc) + at + 10
                return _Extent(numbers_at, base, *struct.unpack_from(">II", iloc, at + 10))
            at += 10 + 8 * extents
    except (KeyError, IndexError, ValueError, struct.error):
        pass
    return None
