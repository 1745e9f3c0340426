"""Segments, of which JPEG files are made.

Source: ITU-T T.81, annex B.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO

from unshutter.photo.tags import exif

SCAN, APP0, APP1 = 0xDA, 0xE0, 0xE1  # markers; what the applications' segments hold, they say in their first bytes


def before_the_scan(file: BinaryIO, wanted: tuple[int, ...]) -> Iterator[tuple[int, bytes]]:
    """(marker, content) of segments before the first scan."""
    file.seek(2)
    while len(head := file.read(4)) == 4:
        mark, marker, length = struct.unpack(">BBH", head)
        if mark != 0xFF or marker == SCAN or length < 2:
            return
        if marker in wanted:
            yield marker, file.read(length - 2)
        else:
            file.seek(length - 2, 1)


def encoded(marker: int, content: bytes) -> bytes:
    """The bytes of a segment."""
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def exif_of(file: BinaryIO) -> bytes | None:
    """The EXIF blob of a JPEG."""
    return next((content for _, content in before_the_scan(file, (APP1,)) if content.startswith(exif.PREFIX)), None)
