"""Inserts or replaces bytes in the middle of a finished file."""

from __future__ import annotations

import io
from typing import BinaryIO

_PIECE = 1 << 24  # bytes


def replace(file: BinaryIO, start: int, end: int, data: bytes) -> None:
    """Replaces bytes with others. Data after them are moved in pieces, because pictures may be larger than memory."""
    if len(data) >= end - start:
        file.seek(start)
        file.write(data[: end - start])
        insert(file, end, data[end - start :])
        return
    file.seek(start)
    file.write(data)
    behind, to = end, start + len(data)
    while piece := _read_at(file, behind):
        file.seek(to)
        file.write(piece)
        behind, to = behind + len(piece), to + len(piece)
    file.truncate(to)


def _read_at(file: BinaryIO, at: int) -> bytes:
    file.seek(at)
    return file.read(_PIECE)


def insert(file: BinaryIO, at: int, data: bytes) -> None:
    """Inserts bytes, moving the data after them in pieces from the end, because pictures may be larger than memory."""
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
