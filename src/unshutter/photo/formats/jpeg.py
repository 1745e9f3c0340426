"""JPEG: quality and subsampling are told by its tables; EXIF is a segment.

Source: ITU-T T.81 (segments, quantisation); CIPA DC-008 (EXIF in APP1).
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.photo import by_libvips
from unshutter.photo.containers import segments
from unshutter.photo.containers.insertion import insert
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import computed, field, libvips, refusing
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np
    import pyvips

# Warnings about JPEGs in which every pixel is there, and which all viewers show.
_HARMLESS = re.compile(r"Invalid SOS parameters|Unknown Adobe color transform|extraneous bytes before marker 0x[de]")
_LONGEST_EXIF = 65_533  # bytes, with the prefix
_TABLES, _FRAMES = 0xDB, (0xC0, 0xC1, 0xC2)  # markers
# Luminance quantisation of quality 50, in any order (ITU-T T.81, table K.1).
_LUMINANCE = (
    *(16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29),
    *(51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121),
    *(120, 101, 72, 92, 95, 98, 112, 100, 103, 99),
)


@final
class Jpeg(WrittenFormat):
    """JPEG: 8 bits, grey or RGB, no alpha; the one format that is decoded at a part of its size for less work."""

    name = written_as = "jpeg"
    suffixes = (".jpg", ".jpeg", ".jpe", ".jfif")
    shrinks = (8, 4, 2)
    longest_side, deep, grey, alpha = 65_500, False, True, False

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return head.startswith(b"\xff\xd8\xff")

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = by_libvips.opened(source, "jpegload")
        with source.stream() as stream:
            coding = read_coding(stream)
        return by_libvips.header(self, source, image, coding, Metadata.of_image(image))

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. To libjpeg damaged data are but a warning."""
        with refusing(f"{source} is damaged or incomplete"):
            try:
                return computed(source.load("jpegload", access="sequential", fail_on="warning", shrink=shrink))
            except libvips().Error as error:
                if not _HARMLESS.search(error.detail):
                    raise
                return computed(source.load("jpegload", access="sequential", fail_on="error", shrink=shrink))

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        chroma = "on" if coding.subsampled else "off"
        return by_libvips.encoded(image, "jpegsave", path, Q=quality or coding.quality or 95, subsample_mode=chroma)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> None:
        """See WrittenFormat. EXIF that is too long loses its maker's note; if that is not enough, all of it."""
        blob = field(image, "exif-data")
        if blob is None:
            return
        if len(blob) > _LONGEST_EXIF:
            blob = exif.without_makers_note(blob)
        content = exif.PREFIX + blob.removeprefix(exif.PREFIX)
        file.seek(2)
        at, head = 2, file.read(4)
        if head[:2] == bytes([0xFF, segments.APP0]):  # JFIF stays first
            at += 2 + struct.unpack(">H", head[2:])[0]
        if len(content) <= _LONGEST_EXIF:
            insert(file, at, segments.encoded(segments.APP1, content))


def read_coding(file: BinaryIO) -> Coding:
    """Reads the tables and the frame header; defaults for what is missing or damaged.

    The quality is the one of libjpeg's scale whose luminance table is nearest in sum to the file's: cameras and Adobe
    programs use tables of their own. Chroma at half the resolution in both directions (4:2:0), or less, counts as
    subsampled; libvips says so of 4:2:2, too.
    """
    total, factors = None, b""
    for marker, content in segments.before_the_scan(file, (_TABLES, *_FRAMES)):
        if marker == _TABLES:
            total = _luminance_sum(content) or total
        else:
            factors = content[7::3]  # of each component, horizontal << 4 | vertical
    quality = None
    if total is not None:
        quality = min(range(1, 101), key=lambda quality: abs(_scaled_sum(quality) - total))
    return Coding(quality, subsampled=len(factors) == 3 and factors[0] >> 4 >= 2 and factors[0] & 15 >= 2)


def _scaled_sum(quality: int) -> int:
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    return sum(min(max((value * scale + 50) // 100, 1), 255) for value in _LUMINANCE)


def _luminance_sum(tables: bytes) -> int | None:
    """Sum of quantisation table 0, if it is among these."""
    while tables:
        wide, name = tables[0] >> 4, tables[0] & 15
        values = tables[1 : 65 + 64 * wide]
        if name == 0 and wide < 2 and len(values) == 64 * (1 + wide):
            return sum(struct.unpack(">64H", values) if wide else values)
        tables = tables[65 + 64 * wide :]
    return None
