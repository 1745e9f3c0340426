"""Encodes TIFF directories, in either byte order and layout.

Source: TIFF 6.0, section 2; CIPA DC-008 (EXIF 2.32), section 4.6.2.
"""

from __future__ import annotations

import struct
from contextlib import suppress

from unshutter.photo.tags.directories import CLASSIC, VALUE_BYTES, Directory, Entry, Layout

# Bytes of the units affected by byte order, by TIFF type.
_UNIT = {**VALUE_BYTES, 5: 4, 10: 4}
# BigTIFF's types: the corresponding 4-byte type, and struct's letters for both.
_NARROWER = {16: (4, "Q", "I"), 17: (9, "q", "i"), 18: (4, "Q", "I")}


def encoded(directory: Directory, at: int, order: str, layout: Layout = CLASSIC) -> bytes:
    """Encodes a directory for offset ``at``, followed by its values and sub-directories."""
    table = [struct.pack(order + layout.count, len(directory))]
    values, here = [], at + len(table[0]) + layout.entry_bytes * len(directory) + layout.offset_bytes
    for tag, entry in sorted(directory.items(), key=lambda item: item[0]):
        if isinstance(entry, dict):
            kind, count, data, inline = layout.directory, 1, encoded(entry, here, order, layout), False
        else:
            kind, count, data = entry
            inline = len(data) <= layout.offset_bytes
        table += [struct.pack(f"{order}HH{layout.offset}", tag, kind, count)]
        table += [data.ljust(layout.offset_bytes, b"\0") if inline else struct.pack(order + layout.offset, here)]
        if not inline:
            values += [data, bytes(len(data) % 2)]
            here += len(data) + len(data) % 2
    return b"".join([*table, bytes(layout.offset_bytes), *values])  # no further directory


def encoded_number(order: str, tag: int, kind: int, value: int) -> bytes:
    """Encodes an entry of one number in twelve bytes: type 3 (SHORT) or 4 (LONG)."""
    number = struct.pack(order + "HH", value, 0) if kind == 3 else struct.pack(order + "I", value)
    return struct.pack(order + "HHI", tag, kind, 1) + number


def in_classic(directory: Directory, order: str) -> Directory:
    """Converts a directory to types that all TIFFs have; numbers too large for them are left out."""
    narrow: Directory = {}
    for tag, entry in directory.items():
        if isinstance(entry, dict):
            narrow[tag] = in_classic(entry, order)
        elif entry.kind not in _NARROWER:
            narrow[tag] = entry
        else:
            kind, wide, form = _NARROWER[entry.kind]
            with suppress(struct.error):
                numbers = struct.unpack(f"{order}{entry.count}{wide}", entry.data)
                narrow[tag] = Entry(kind, entry.count, struct.pack(f"{order}{entry.count}{form}", *numbers))
    return narrow


def in_other_order(directory: Directory) -> Directory:
    """Converts a directory to the other byte order; opaque data (maker notes) are left unchanged."""
    turned: Directory = {}
    for tag, entry in directory.items():
        if isinstance(entry, dict):
            turned[tag] = in_other_order(entry)
        else:
            unit, data = _UNIT[entry.kind], bytearray(entry.data)
            for byte in range(unit):
                data[byte::unit] = entry.data[unit - 1 - byte :: unit]
            turned[tag] = Entry(entry.kind, entry.count, bytes(data))
    return turned
