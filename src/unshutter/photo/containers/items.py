"""Items of a box file: where in the file one of a kind is, EXIF for one.

Source: ISO/IEC 14496-12, boxes iinf and iloc.
"""

from __future__ import annotations

import io
import struct
from typing import BinaryIO

from unshutter.photo.containers import boxes

_MOST_ITEMS = 10_000


def place(file: BinaryIO, kind: bytes) -> tuple[int, int] | None:
    """(first byte, length) of the first item of a kind; None without one, or where it is not in one piece."""
    try:
        meta = dict(boxes.inside(boxes.top_level(file, b"meta")[4:]))
        iinf, iloc = meta[b"iinf"], meta[b"iloc"]
        entries = [data for name, data in boxes.inside(iinf[6 if iinf[0] == 0 else 8 :]) if name == b"infe"]
        found = next(number for number, own in map(_entry, entries) if own == kind)
        return _located(iloc, found)
    except (KeyError, IndexError, StopIteration, struct.error):
        return None


def _entry(data: bytes) -> tuple[int, bytes]:
    """(number, kind) of an item."""
    if data[0] < 3:
        return struct.unpack_from(">H", data, 4)[0], data[8:12]
    return struct.unpack_from(">I", data, 4)[0], data[10:14]


def _located(iloc: bytes, wanted: int) -> tuple[int, int] | None:
    version, sizes, more_sizes = iloc[0], iloc[4], iloc[5]
    stream = io.BytesIO(iloc[6:])

    def number(size: int) -> int:
        data = stream.read(size)
        if len(data) < size:
            raise IndexError
        return int.from_bytes(data, "big")

    for _ in range(min(number(4 if version == 2 else 2), _MOST_ITEMS)):
        item = number(4 if version == 2 else 2)
        in_file = version == 0 or number(2) & 15 == 0  # else counted from another box
        number(2)  # of the file in which it is: this one
        base, pieces = number(more_sizes >> 4), number(2)
        for _ in range(pieces):
            number(more_sizes & 15 if version else 0)
            offset, length = number(sizes >> 4), number(sizes & 15)
            if item == wanted:
                return (base + offset, length) if in_file and pieces == 1 else None
    return None
