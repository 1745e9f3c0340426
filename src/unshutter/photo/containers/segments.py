"""Segments, the building blocks of JPEG files.

Source: ITU-T T.81, annex B.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from typing import BinaryIO

from unshutter.photo.tags import exif

# markers; application segments identify their content by their first bytes
END, SCAN, APP0, APP1, APP2, APP13, APP14, COMMENT = 0xD9, 0xDA, 0xE0, 0xE1, 0xE2, 0xED, 0xEE, 0xFE
LONGEST = 65_533  # bytes of content
_MOST_FILL = 1 << 16  # bytes before a marker
_IN_A_SCAN = re.compile(rb"\xff[\x02-\xcf\xd8-\xfe]")  # a marker that ends coded data, unlike restart markers
_PIECE = 1 << 20  # bytes
_FILL = b"\0\xff \r\n\t"


def before_the_scan(file: BinaryIO, markers: tuple[int, ...]) -> Iterator[tuple[int, bytes]]:
    """Yields (marker, content) of the segments before the first scan that have one of the markers."""
    file.seek(2)
    while (marker := _marker(file)) not in (None, SCAN):
        size = file.read(2)
        length = int.from_bytes(size, "big")
        if len(size) < 2 or length < 2:
            return
        if marker in markers:
            yield marker, file.read(length - 2)
        else:
            file.seek(length - 2, 1)


def _marker(file: BinaryIO) -> int | None:
    """Reads the next marker, which any number of bytes 0xFF may precede; returns None if there is none."""
    if file.read(1) != b"\xff":
        return None
    for _ in range(_MOST_FILL):
        if (byte := file.read(1)) != b"\xff":
            return byte[0] if byte else None
    return None


def bytes_behind(file: BinaryIO) -> int:
    """Counts the bytes after the end of the picture; 0 if they are only padding, or the picture has no end."""
    for _ in before_the_scan(file, ()):
        pass
    while (marker := _after_segment(file)) not in (None, END):
        pass
    at = file.tell()
    if marker is None or not any(piece.strip(_FILL) for piece in iter(lambda: file.read(_PIECE), b"")):
        return 0
    return file.seek(0, io.SEEK_END) - at


def _after_segment(file: BinaryIO) -> int | None:
    """Skips a segment whose marker was read, and coded data after it; reads and returns the next marker."""
    size = file.read(2)
    if len(size) < 2:
        return None
    at = file.tell() + int.from_bytes(size, "big") - 2
    file.seek(at)
    while len(piece := file.read(_PIECE)) > 1:
        match = _IN_A_SCAN.search(piece)
        if match is not None:
            file.seek(at + match.end())
            return piece[match.end() - 1]
        at += len(piece) - 1  # a marker may be split between two pieces
        file.seek(at)
    return None


def encoded(marker: int, content: bytes) -> bytes:
    """Encodes a segment."""
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def exif_of(file: BinaryIO) -> bytes | None:
    """Returns the EXIF blob of a JPEG; None if there is none."""
    return next((content for _, content in before_the_scan(file, (APP1,)) if content.startswith(exif.PREFIX)), None)
