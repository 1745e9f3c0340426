"""JPEG: its tables give quality and subsampling; EXIF is a segment.

Source: ITU-T T.81 (segments, quantisation); CIPA DC-008 (EXIF in APP1).
"""

from __future__ import annotations

import io
import re
import struct
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.photo import by_libvips, jpeg_metadata
from unshutter.photo.containers import segments
from unshutter.photo.containers.insertion import insert
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import computed, field, libvips, refusing
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif, iptc

if TYPE_CHECKING:
    import numpy as np
    import pyvips

# Warnings about JPEGs in which every pixel is there, and which all viewers show.
_HARMLESS = re.compile(r"Invalid SOS parameters|Unknown Adobe color transform|extraneous bytes before marker 0x[de]")
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
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "segments", "film"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return head.startswith(b"\xff\xd8\xff")

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = by_libvips.opened(_without_tangles(source), "jpegload")
        with source.stream() as stream:
            coding = read_coding(stream)
            metadata = jpeg_metadata.with_segments(Metadata.of_image(image), stream)
        return by_libvips.header(self, source, image, coding, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. To libjpeg damaged data are but a warning."""
        with refusing("{photo} is damaged or incomplete", photo=source):
            data = _without_tangles(source)
            try:
                return computed(data.load("jpegload", access="sequential", fail_on="warning", shrink=shrink))
            except libvips().Error as error:
                if not _HARMLESS.search(error.detail):
                    raise
                return computed(data.load("jpegload", access="sequential", fail_on="error", shrink=shrink))

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat. What libvips loses or cuts of segments, :meth:`embed` writes."""
        chroma = "on" if coding.subsampled else "off"
        image = image.copy()
        for name in ("iptc-data", *(["xmp-data"] if _is_too_long(field(image, "xmp-data")) else [])):
            image.remove(name)
        return by_libvips.encoded(image, "jpegsave", path, Q=quality or coding.quality or 95, subsample_mode=chroma)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> list[str]:
        """See WrittenFormat. Of EXIF that is too long, the longest tags are left out."""
        left_out, added = [], b""
        blob = field(image, "exif-data")
        if blob is not None:
            blob, left_out = exif.shortened(exif.PREFIX + blob.removeprefix(exif.PREFIX), segments.LONGEST)
            added += b"" if blob is None else segments.encoded(segments.APP1, blob)
        if _is_too_long(field(image, "xmp-data")):
            left_out.append("XMP (too long for a JPEG)")
        resources = field(image, "iptc-data", b"")
        added += b"".join(segments.encoded(segments.APP13, part) for part in iptc.segments(resources, segments.LONGEST))
        added += field(image, "jpeg-segments", b"")
        file.seek(2)
        at, head = 2, file.read(4)
        if head[:2] == bytes([0xFF, segments.APP0]):  # JFIF stays first
            at += 2 + struct.unpack(">H", head[2:])[0]
        elif (density := field(image, "jpeg-density")) is not None:
            added = segments.encoded(segments.APP0, jpeg_metadata.JFIF + b"\1\1" + density + bytes(2)) + added
        if added:
            insert(file, at, added)
        film = field(image, "jpeg-film")
        if film is not None:
            file.seek(0, io.SEEK_END)
            file.write(film)
        return left_out


def _is_too_long(packet: bytes | None) -> bool:
    return packet is not None and len(packet) + len(jpeg_metadata.XMP) > segments.LONGEST


def _without_tangles(source: Source) -> Source:
    """The data, with EXIF that libvips would be caught in made unreadable for it."""
    with suppress(OSError), source.stream() as stream:  # libvips says what is wrong
        places = [
            stream.tell() - len(content)
            for _, content in segments.before_the_scan(stream, (segments.APP1,))
            if content.startswith(exif.PREFIX) and exif.is_tangled(content)
        ]
        if places:
            return source.patched(places, b"none")
    return source


# ---- how it is encoded ---------------------------------------------------------------------------------


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
