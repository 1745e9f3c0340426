"""JPEG: its tables contain quality and subsampling; its metadata are segments, some of which libvips loses or cuts.

Source: ITU-T T.81 (segments, quantisation); ITU-T T.871 (JFIF); CIPA DC-008 (EXIF in APP1), DC-007 (several pictures in
APP2); Adobe, XMP specification part 3 (XMP in APP1, Photoshop's resources in APP13).
"""

from __future__ import annotations

import io
import re
import struct
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.photo import chunks, exif, xmp
from unshutter.photo.chunks import (
    APP0,
    APP1,
    APP2,
    APP13,
    APP14,
    COMMENT,
    XMP_PREFIX,
    before_the_scan,
    bytes_behind,
    insert,
)
from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.embedded_video import appended_video
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Metadata, Picture, WrittenFormat
from unshutter.photo.libvips import Source

if TYPE_CHECKING:
    import numpy as np


# Warnings about JPEGs in which no pixels are missing and which all viewers display.
_HARMLESS = re.compile(r"Invalid SOS parameters|Unknown Adobe color transform|extraneous bytes before marker 0x[de]")
_TABLES, _FRAMES = 0xDB, (0xC0, 0xC1, 0xC2)  # markers
# Luminance quantisation of quality 50, in any order (ITU-T T.81, table K.1).
_LUMINANCE = (
    *(16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29),
    *(51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121),
    *(120, 101, 72, 92, 95, 98, 112, 100, 103, 99),
)

_JFIF = b"JFIF\0"
_MORE_XMP = b"http://ns.adobe.com/xmp/extension/\0"
_PICTURES = b"MPF\0"
_METADATA = (*range(APP0, APP0 + 16), COMMENT)
# Segments that libvips reads, or that only describe the encoding of this file.
_READ: dict[int, tuple[bytes, ...]] = {
    APP0: (_JFIF, b"JFXX\0", b"AVI1"),
    APP1: (EXIF_PREFIX, XMP_PREFIX),
    APP2: (b"ICC_PROFILE\0",),
    APP13: (chunks.RESOURCES_PREFIX,),
    APP14: (b"Adobe",),
}


@final
class Jpeg(WrittenFormat):
    """JPEG: 8 bits, grey or RGB, no alpha; the only format that can be decoded at a reduced size for less work."""

    loader = "jpegload"
    signature = re.compile(rb"\xff\xd8\xff")
    shrinks = (8, 4, 2)
    longest_side = 65_500
    deep = False
    grey = True
    alpha = False
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "comments", "video"})

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = picture_format.open_image(self, source)
        with source.stream() as stream:
            coding = read_coding(stream)
            metadata = _with_segments(picture_format.metadata_of(image), stream).without_exif_loop()
        return picture_format.header(self, source, image, coding, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. libjpeg only warns of damaged data."""
        try:
            return picture_format.decode_pixels(self, source, "warning", shrink=shrink)
        except UnshutterError as error:
            if not _HARMLESS.search(getattr(error.__cause__, "detail", "")):
                raise
            return picture_format.decode_pixels(self, source, shrink=shrink)

    def exif_blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """See Format."""
        for _, content in before_the_scan(file, (APP1,)):
            if content.startswith(EXIF_PREFIX):
                yield file.tell() - len(content), content

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        metadata = picture.metadata
        coding = picture.coding
        packet = None if _is_too_long(metadata.xmp) else metadata.xmp
        written = replace(picture, metadata=replace(metadata, exif=None, xmp=packet))
        options = {
            "Q": picture.quality or coding.quality or self.row.usual_quality,
            "subsample_mode": "on" if coding.subsampled else "off",
        }
        return picture_format.encode(written, "jpegsave", path, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. If EXIF is too long, its longest tags are left out."""
        metadata = picture.metadata
        left_out = []
        added = b""
        if metadata.exif is not None:
            blob, left_out = exif.shortened(EXIF_PREFIX + metadata.exif.removeprefix(EXIF_PREFIX), chunks.LONGEST)
            added += b"" if blob is None else chunks.encoded_segment(APP1, blob)
        if _is_too_long(metadata.xmp):
            left_out.append("XMP (too long for a JPEG)")
        added += b"".join(chunks.encoded_segment(APP13, part) for part in chunks.split_resources(metadata.resources))
        added += b"".join(chunks.encoded_segment(COMMENT, comment) for comment in metadata.comments)
        file.seek(2)
        at = 2
        head = file.read(4)
        if head[:2] == bytes([0xFF, APP0]):  # JFIF must remain first
            at += 2 + struct.unpack(">H", head[2:])[0]
        elif metadata.jfif_density is not None:
            density = struct.pack(">BHH", *metadata.jfif_density)
            added = chunks.encoded_segment(APP0, _JFIF + b"\1\1" + density + bytes(2)) + added
        if added:
            insert(file, at, added)
        if metadata.video is not None:
            file.seek(0, io.SEEK_END)
            file.write(metadata.video.data)
        return left_out


# ---- metadata ------------------------------------------------------------------------------------------


def _is_too_long(packet: bytes | None) -> bool:
    return packet is not None and len(packet) + len(XMP_PREFIX) > chunks.LONGEST


def _with_segments(metadata: Metadata, file: BinaryIO) -> Metadata:
    """Completes the metadata that libvips found in a JPEG with those that it loses or truncates.

    These are EXIF (which libvips takes apart), density, comments, Photoshop's resources in several segments, and the
    video of a motion photo, along with the names of metadata that no result contains.
    """
    listed = list(before_the_scan(file, _METADATA))
    jfif = next((content for content in _beginning(listed, APP0, _JFIF) if len(content) >= 12), None)
    prefix = chunks.RESOURCES_PREFIX  # of each segment; a block may be split between two
    resources = [part.removeprefix(prefix) for part in _beginning(listed, APP13, prefix)]
    left_behind = [name for marker, content in listed if (name := _lost(marker, content, metadata.xmp))]
    video = appended_video(file, xmp.video_bytes(metadata.xmp))
    if video is not None:
        left_behind += video.left_behind
    left_behind += [chunks.OTHER for start in (EXIF_PREFIX, XMP_PREFIX) if len(_beginning(listed, APP1, start)) > 1]
    has_pictures = _beginning(listed, APP2, _PICTURES) or xmp.has_gain_map(metadata.xmp)  # which are named elsewhere
    if not has_pictures and bytes_behind(file) > (video.taken_from if video else 0):
        left_behind.append(chunks.OTHER)
    return replace(
        metadata,
        exif=next(iter(_beginning(listed, APP1, EXIF_PREFIX)), None),
        density=None if jfif is None else struct.unpack_from(">BHH", jfif, 7),
        resources=prefix + b"".join(resources) if resources else None,
        comments=tuple(content for marker, content in listed if marker == COMMENT),
        video=video,
        left_behind=tuple(dict.fromkeys(left_behind)),
    )


def _beginning(listed: list[tuple[int, bytes]], marker: int, prefix: bytes) -> list[bytes]:
    """Returns the contents of segments with a marker that begin with a prefix."""
    return [content for own, content in listed if own == marker and content.startswith(prefix)]


def _lost(marker: int, content: bytes, packet: bytes | None) -> str:
    """Names a segment that no result contains; empty for those that are copied or only describe this file."""
    if marker == COMMENT or content.startswith(_READ.get(marker, b"\0nothing")):
        return ""
    if marker == APP1 and content.startswith(_MORE_XMP):
        return "XMP (beyond the first 64 kB)"
    if marker == APP2 and content.startswith(_PICTURES):
        return "" if xmp.has_gain_map(packet) else "further pictures"  # gain maps are named as such
    return chunks.OTHER


# ---- encoding ------------------------------------------------------------------------------------------


def read_coding(file: BinaryIO) -> Coding:
    """Reads the quantisation tables and the frame header; uses defaults for missing or damaged ones.

    The quality is that on libjpeg's scale whose luminance table has the sum closest to the file's, because cameras and
    Adobe programs use their own tables. Chroma with half the resolution in both directions (4:2:0), or less, counts as
    subsampled; libvips also reports that for 4:2:2.
    """
    total = None
    factors = b""
    for marker, content in before_the_scan(file, (_TABLES, *_FRAMES)):
        if marker == _TABLES:
            total = _luminance_sum(content) or total
        else:
            factors = content[7::3]  # per component, horizontal << 4 | vertical
    quality = None if total is None else _nearest_quality(total)
    return Coding(quality, subsampled=len(factors) == 3 and factors[0] >> 4 >= 2 and factors[0] & 15 >= 2)


def _nearest_quality(total: int) -> int:
    qualities = range(1, 101)  # the higher the quality, the smaller the sum
    first_below = bisect_left(qualities, -total, key=lambda quality: -_scaled_sum(quality))
    return min(qualities[max(first_below - 1, 0) : first_below + 1], key=lambda q: abs(_scaled_sum(q) - total))


def _scaled_sum(quality: int) -> int:
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    return sum(min(max((value * scale + 50) // 100, 1), 255) for value in _LUMINANCE)


def _luminance_sum(tables: bytes) -> int | None:
    """Returns the sum of quantisation table 0, if it is among these."""
    while tables:
        wide = tables[0] >> 4
        name = tables[0] & 15
        values = tables[1 : 65 + 64 * wide]
        if name == 0 and wide < 2 and len(values) == 64 * (1 + wide):
            return sum(struct.unpack(">64H", values) if wide else values)
        tables = tables[65 + 64 * wide :]
    return None
