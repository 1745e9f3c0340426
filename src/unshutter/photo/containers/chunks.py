"""Chunks, the building blocks of PNG files.

Source: W3C, PNG third edition, sections 5 (structure, naming conventions) and 14 (treatment of unknown chunks by
editors).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from typing import BinaryIO, NamedTuple

SIGNATURE_BYTES = 8
TEXTS = frozenset({b"tEXt", b"zTXt", b"iTXt"})
COLOURS = frozenset({b"gAMA", b"cHRM", b"sRGB", b"cICP", b"mDCV", b"cLLI"})
_NAMED = TEXTS | COLOURS | {b"pHYs", b"tIME", b"bKGD"}  # these are meaningful beyond PNG
_USUAL_GAMMA = struct.pack(">I", 45455)
_USUAL_PRIMARIES = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
_LARGEST, _MOST, _MOST_BYTES = 1 << 26, 10_000, 1 << 27  # of a chunk's data, of chunks, and of the data of all [bytes]
_LOWER = 0x20  # the bit that distinguishes lower-case from upper-case letters


class Chunk(NamedTuple):
    """A chunk's name and data; ``data`` is None if they are damaged, or too long for a photo's metadata."""

    name: bytes
    data: bytes | None


def is_safe_to_copy(name: bytes) -> bool:
    """Whether a chunk's data remain valid for other pixels, according to the case of letters in its name."""
    return bool(name[0] & _LOWER and name[3] & _LOWER)


def of_file(file: BinaryIO, skipped: Collection[bytes]) -> Iterator[Chunk]:
    """Yields all chunks of a PNG, including those after the pixels, except for names to skip."""
    file.seek(SIGNATURE_BYTES)
    count, left = 0, _MOST_BYTES
    while len(head := file.read(8)) == 8 and head[4:] != b"IEND":
        length, name = struct.unpack(">I4s", head)
        if name in skipped:
            file.seek(length + 4, 1)
            continue
        count += 1
        if length > min(_LARGEST, left) or count > _MOST:
            file.seek(length + 4, 1)
            yield Chunk(name, None)
            continue
        left -= length
        data, checksum = file.read(length), file.read(4)
        yield Chunk(name, data if checksum == struct.pack(">I", zlib.crc32(name + data)) else None)


def has_data_behind(file: BinaryIO) -> bool:
    """Whether data follow the last chunk of a PNG; to be called after reading :func:`of_file` to the end."""
    return bool(file.read(_LARGEST)[4:].strip(b"\0\r\n"))  # after a checksum


def encoded(name: bytes, data: bytes) -> bytes:
    """Encodes a chunk."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def place_of(file: BinaryIO, name: bytes) -> tuple[int, int] | None:
    """Returns the start and end of a chunk before the pixels; None if there is none."""
    at = SIGNATURE_BYTES
    file.seek(at)
    while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
        (length,) = struct.unpack_from(">I", head)
        if head[4:] == name:
            return at, at + 12 + length
        at += 12 + length
        file.seek(at)
    return None


def in_words(chunks: Sequence[tuple[bytes, bytes]], has_profile: bool) -> Iterator[str]:
    """Yields names of what is lost without chunks; not colours, if a profile describes them or they are sRGB's."""
    names = {name for name, _ in chunks}
    if names & TEXTS:
        yield "texts"
    by_name = dict(chunks)
    are_usual = b"sRGB" in names or (
        by_name.get(b"gAMA", _USUAL_GAMMA) == _USUAL_GAMMA
        and by_name.get(b"cHRM", _USUAL_PRIMARIES) == _USUAL_PRIMARIES
    )
    if not has_profile and names & {b"gAMA", b"cHRM"} and not are_usual:
        yield "colours (gAMA and cHRM)"
    if b"bKGD" in names:
        yield "background colour (bKGD)"
    if b"mDCV" in names or b"cLLI" in names:
        yield "brightness of the screen (mDCV, cLLI)"
    if any(name not in _NAMED for name in names):
        yield "chunks of other programs"
