"""Bytes put into the middle of a finished file."""

from __future__ import annotations

import io
from typing import BinaryIO

_PIECE = 1 << 24  # bytes


def insert(file: BinaryIO, at: int, data: bytes) -> None:
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
