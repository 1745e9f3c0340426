"""Reads a film file's stated length, in bytes and in seconds, which FFmpeg does not pass on.

Sources: RFC 8794 and 9559 (EBML, Matroska); ISO/IEC 14496-12 (MP4); Adobe's FLV specification 10.1; Microsoft's AVI
RIFF and ASF references; ISO/IEC 13818-1 (MPEG streams).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import BinaryIO

_MOST_PARTS = 100_000  # most parts of a file that are examined
_LARGEST_HEADER = 1 << 20  # bytes
_FLV_HEAD = 1 << 16  # bytes at the start of the file in which the length is stored
_TS_PACKETS = ((188, 0), (192, 4), (204, 0), (208, 0))  # packet size in bytes, and position of its first 0x47
_UNTIL_CLUSTER = 0x1F43B675
_SEGMENT, _INFO, _SCALE, _DURATION = 0x18538067, 0x1549A966, 0x2AD7B1, 0x4489
_ASF_FILE = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")


@dataclass(frozen=True)
class FileLength:
    """The length of a file according to its own headers.

    Attributes:
        cut: whether the file has fewer bytes than stated; None if no size is stated.
        seconds: end time of its longest stream; None if not stated.
    """

    cut: bool | None = None
    seconds: float | None = None


def file_length(path: str, kind: str) -> FileLength:
    """Reads the length of a file from its headers.

    Args:
        path: path of the file.
        kind: FFmpeg's name of the file format.
    """
    reader = _READERS.get(kind.partition(",")[0])
    if reader is not None:
        with suppress(OSError, struct.error, ValueError, OverflowError, IndexError), open(path, "rb") as stream:
            return reader(stream, os.fstat(stream.fileno()).st_size)
    return FileLength()


# ---- Matroska, WebM -----------------------------------------------------------------------------------------


def _matroska(stream: BinaryIO, size: int) -> FileLength:
    for name, start, length in _elements(stream, 0, size):
        if name == _SEGMENT:
            cut = None if length is None else start + length > size
            for inner, at, inner_length in _elements(stream, start, size):
                if inner == _INFO and inner_length is not None:
                    return FileLength(cut, _matroska_seconds(stream, at, min(inner_length, _LARGEST_HEADER)))
                if inner == _UNTIL_CLUSTER:
                    break
            return FileLength(cut)
    return FileLength()


def _matroska_seconds(stream: BinaryIO, start: int, length: int) -> float | None:
    scale, duration = 1_000_000, None
    for name, at, inner in _elements(stream, start, start + length):
        stream.seek(at)
        if name == _SCALE and inner:
            scale = int.from_bytes(stream.read(min(inner, 8)), "big")
        if name == _DURATION and inner in (4, 8):
            (duration,) = struct.unpack(">f" if inner == 4 else ">d", stream.read(inner))
    return duration * scale / 1e9 if duration and 0 < duration * scale / 1e9 < 1e9 else None


def _elements(stream: BinaryIO, at: int, end: int) -> Iterator[tuple[int, int, int | None]]:
    """Yields (name, start of the content, its length or None if unknown) of consecutive EBML elements."""
    for _ in range(_MOST_PARTS):
        if at >= end:
            return
        stream.seek(at)
        head = stream.read(12)
        wide = 9 - head[0].bit_length()
        name = int.from_bytes(head[:wide], "big")
        longer = 9 - head[wide].bit_length()
        if wide > 4 or longer > 8:
            return
        length: int | None = int.from_bytes(head[wide : wide + longer], "big") & ((1 << 7 * longer) - 1)
        if length == (1 << 7 * longer) - 1:
            length = None
        yield name, at + wide + longer, length
        if length is None:
            return
        at += wide + longer + length


# ---- others -------------------------------------------------------------------------------------------------


def _boxes(stream: BinaryIO, size: int) -> FileLength:
    """MP4 and QuickTime: checks whether the last box is complete; FFmpeg only passes on the duration."""
    at = 0
    for _ in range(_MOST_PARTS):
        stream.seek(at)
        head = stream.read(16)
        if len(head) < 8:
            break
        length, name = struct.unpack(">I4s", head[:8])
        if length == 1:
            (length,) = struct.unpack(">Q", head[8:16])
        if length < 8:  # extends to the end of the file
            break
        at += length
        if at > size:
            return FileLength(name in (b"mdat", b"moof", b"moov"))
    return FileLength(False)


def _riff(stream: BinaryIO, size: int) -> FileLength:
    at = 0
    for _ in range(_MOST_PARTS):
        stream.seek(at)
        head = stream.read(8)
        if len(head) < 8 or head[:4] != b"RIFF":
            break
        (length,) = struct.unpack("<I", head[4:])
        if length in (0, 0xFFFFFFFF):  # unknown when the file was written
            return FileLength()
        at += 8 + length + (length & 1)
        if at > size + 1:
            return FileLength(True)
    return FileLength(False)


def _flv(stream: BinaryIO, size: int) -> FileLength:
    head = stream.read(_FLV_HEAD)
    at = head.find(b"\0\x08duration\0") + 11
    seconds = struct.unpack(">d", head[at : at + 8])[0] if at >= 11 else None
    stream.seek(max(size - 4, 0))
    (last,) = struct.unpack(">I", stream.read(4))
    cut = True
    if 11 <= last <= size - 4:
        stream.seek(size - 4 - last)
        tag = stream.read(4)
        cut = int.from_bytes(tag[1:], "big") + 11 != last
    return FileLength(cut, seconds if seconds is not None and 0 < seconds < 1e9 else None)


def _asf(stream: BinaryIO, size: int) -> FileLength:
    head = stream.read(_FLV_HEAD)
    at = head.find(_ASF_FILE)
    if at < 0:
        return FileLength()
    (stated_size,) = struct.unpack_from("<Q", head, at + 40)
    played, _, ahead_ms, flags = struct.unpack_from("<QQQI", head, at + 64)
    if flags & 1 or not played:  # a broadcast of unknown length
        return FileLength()
    return FileLength(stated_size > size, played / 1e7 - ahead_ms / 1e3)


def _transport_stream(stream: BinaryIO, size: int) -> FileLength:
    head = stream.read(4 * 208)
    for length, at in _TS_PACKETS:
        if head[at::length][:3] == b"GGG":
            return FileLength(size % length != 0)
    return FileLength()


def _program_stream(stream: BinaryIO, size: int) -> FileLength:
    """MPEG-PS: checks whether the last packet is complete."""
    start = max(size - 3 * 0xFFFF, 0)
    stream.seek(start)
    tail = stream.read()
    at = len(tail)
    while (at := tail.rfind(b"\0\0\1", 0, at)) >= 0:
        code = tail[at + 3] if at + 3 < len(tail) else 0
        if code == 0xB9:
            return FileLength(False)
        if code in (0xBD, 0xBE) or 0xC0 <= code <= 0xEF:
            (length,) = struct.unpack_from(">H", tail, at + 4)
            return FileLength(at + 6 + length > len(tail))
    return FileLength()


_READERS: dict[str, Callable[[BinaryIO, int], FileLength]] = {
    "matroska": _matroska,
    "mov": _boxes,
    "avi": _riff,
    "flv": _flv,
    "asf": _asf,
    "mpegts": _transport_stream,
    "mpeg": _program_stream,
}
