"""EXIF put into finished files byte by byte.

libvips would take each blob apart and write it anew: tags that it does not know are lost, and makers' notes move, which
breaks those that point to places counted from the blob's beginning. TIFF has no blob: see metadata.py.

Source: CIPA DC-008 (JPEG), PNG third edition (eXIf), the WebP container specification, ISO/IEC 23008-12 (HEIF).
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from typing import BinaryIO

from unshutter.photo import containers
from unshutter.photo.metadata import LONGEST_IN_JPEG

_PREFIX = b"Exif\0\0"
_PIECE = 1 << 24  # bytes


def embed_exif(file: BinaryIO, format: str, exif: bytes) -> None:
    """Puts an EXIF blob into a file that has none, or, for WebP and AVIF, instead of the one that it has.

    Args:
        file: seekable, open for reading and writing.
        format: ``jpeg``, ``png``, ``webp`` or ``avif``.
        exif: with or without its prefix. Does nothing in a JPEG where it is too long.
    """
    _INTO[format](file, exif.removeprefix(_PREFIX))


def _into_jpeg(file: BinaryIO, tiff: bytes) -> None:
    file.seek(2)
    at, head = 2, file.read(4)
    if head[:2] == b"\xff\xe0":  # JFIF stays first
        at += 2 + struct.unpack(">H", head[2:])[0]
    if len(_PREFIX + tiff) <= LONGEST_IN_JPEG:
        _insert(file, at, b"\xff\xe1" + struct.pack(">H", len(_PREFIX + tiff) + 2) + _PREFIX + tiff)


def _into_png(file: BinaryIO, tiff: bytes) -> None:
    chunk = b"eXIf" + tiff
    after_header = 33
    _insert(file, after_header, struct.pack(">I", len(tiff)) + chunk + struct.pack(">I", zlib.crc32(chunk)))


def _insert(file: BinaryIO, at: int, data: bytes) -> None:
    """Moves what is behind a place, in pieces from the end: pictures may be larger than memory."""
    end = file.seek(0, io.SEEK_END)
    while end > at:
        start = max(at, end - _PIECE)
        file.seek(start)
        piece = file.read(end - start)
        file.seek(start + len(data))
        file.write(piece)
        end = start
    file.seek(at)
    file.write(data)


def _into_webp(file: BinaryIO, tiff: bytes) -> None:
    file.seek(12)
    chunks = b""
    while len(head := file.read(8)) == 8:
        (size,) = struct.unpack("<I", head[4:])
        content = file.read(size + size % 2)
        if head[:4] == b"EXIF":
            head, content = b"EXIF" + struct.pack("<I", len(tiff)), tiff + bytes(len(tiff) % 2)
        chunks += head + content
    file.seek(0)
    file.write(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks)
    file.truncate()


def _into_avif(file: BinaryIO, tiff: bytes) -> None:
    """Appends the blob, and makes the item of the old one, which is zeroed, point to it."""
    old = containers.exif_extent(file)
    if old is None:
        return
    end = file.seek(0, io.SEEK_END)
    content = struct.pack(">I", len(_PREFIX)) + _PREFIX + tiff
    file.write(struct.pack(">I4s", 8 + len(content), b"mdat") + content)
    file.seek(old.base + old.offset)
    file.write(bytes(old.length))
    file.seek(old.numbers_at)
    file.write(struct.pack(">II", end + 8 - old.base, len(content)))


_INTO: dict[str, Callable[[BinaryIO, bytes], None]] = {
    "jpeg": _into_jpeg,
    "png": _into_png,
    "webp": _into_webp,
    "avif": _into_avif,
}
