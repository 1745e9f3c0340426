"""TIFF directories: the structure in which TIFF files, EXIF and most raw files store tags.

They are read and encoded in either byte order, and in the layout of TIFF or BigTIFF.

Source: TIFF 6.0, section 2; CIPA DC-008 (EXIF 2.32), section 4.6.2; awaresystems.be, The BigTIFF file format (facts).
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import BinaryIO, NamedTuple, TypeAlias

# Tags by number. EXIF, GPS and interoperability point to sub-directories.
EXIF = 0x8769
GPS = 0x8825
INTEROPERABILITY = 0xA005
MAKER_NOTE = 0x927C
SUB_DIRECTORIES = frozenset({EXIF, GPS, INTEROPERABILITY})
SUBFILE_TYPE = 0x00FE
THUMBNAIL = 0x0201
THUMBNAIL_LENGTH = 0x0202
EXIF_PREFIX = b"Exif\0\0"  # may precede the TIFF structure of an EXIF blob

BYTE_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_BIG_BYTE_ORDERS = {b"II+\0": "<", b"MM\0+": ">"}
# Bytes per value, by TIFF type (1 BYTE ... 13 IFD; 16-18: BigTIFF's).
VALUE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
# Numeric types, with their letters in struct; fractions consist of two each.
_NUMBER = {1: "B", 3: "H", 4: "I", 5: "I", 6: "b", 8: "h", 9: "i", 10: "i", 11: "f", 12: "d", 13: "I"}
_FRACTIONS = (5, 10)


class Layout(NamedTuple):
    """Widths of the numbers in a TIFF structure."""

    header: int  # number of bytes before the offset of the first directory
    count: str  # struct's letter for the number of entries
    offset: str  # struct's letter for offsets, and for the number of an entry's values
    directory: int  # TIFF type of a directory's offset

    @property
    def offset_bytes(self) -> int:
        """Size of an offset; shorter values are stored in its place."""
        return struct.calcsize("=" + self.offset)

    @property
    def entry_bytes(self) -> int:
        """Size of an entry of a directory."""
        return 4 + 2 * self.offset_bytes


CLASSIC = Layout(4, "H", "I", 4)
BIG = Layout(8, "Q", "Q", 18)


class Entry(NamedTuple):
    """A tag's value: TIFF type, number of values, and their bytes in the byte order of the tree."""

    kind: int
    count: int
    data: bytes


Directory: TypeAlias = "dict[int, Entry | Directory]"


@dataclass(frozen=True)
class Tree:
    """Directories of one TIFF structure."""

    order: str  # byte order, ``<`` (II) or ``>`` (MM), as for struct
    pages: list[Directory]  # the chain of top-level directories; EXIF, GPS and interoperability nested in their tags
    layout: Layout = CLASSIC  # layout of the file that contains them
    note_at: int | None = None  # start of the maker note

    def __bool__(self) -> bool:
        return any(self.pages)

    def number(self, tag: int, *path: int, page: int = 0) -> int | None:
        """Returns the first value of a BYTE, SHORT or LONG tag in a page (or its sub-directory ``path``), or None."""
        entry = self.entry(tag, *path, page=page)
        if entry is None or entry.kind not in (1, 3, 4):
            return None
        return struct.unpack_from(self.order + _NUMBER[entry.kind], entry.data)[0]

    def entry(self, tag: int, *path: int, page: int = 0) -> Entry | None:
        """Returns a tag's entry in a page (or its sub-directory ``path``); None if absent."""
        directory: Directory | Entry | None = self.pages[page]
        for step in (*path, tag):
            directory = directory.get(step) if isinstance(directory, dict) else None
        return directory if isinstance(directory, Entry) else None

    def data(self, tag: int) -> bytes | None:
        """Returns the bytes of a tag in the first page; None if absent."""
        entry = self.pages[0].get(tag)
        return entry.data if isinstance(entry, Entry) else None

    def numbers(self, tag: int, *path: int) -> tuple[float, ...]:
        """Returns all values of a numeric tag in the first page (or its sub-directory ``path``), fractions divided.

        Empty if the tag is absent, not numeric, or a long table; a fraction with denominator zero is NaN.
        """
        entry = self.entry(tag, *path)
        # longer ones are tables, or malicious
        if entry is None or entry.kind not in _NUMBER or not 0 < entry.count <= 1000:
            return ()
        count = entry.count * (2 if entry.kind in _FRACTIONS else 1)
        values = struct.unpack(f"{self.order}{count}{_NUMBER[entry.kind]}", entry.data)
        if entry.kind not in _FRACTIONS:
            return values
        pairs = zip(values[::2], values[1::2], strict=True)
        return tuple(above / below if below else math.nan for above, below in pairs)

    def text(self, tag: int, *path: int) -> str:
        """Returns the text of a tag in the first page (or its sub-directory ``path``) up to a NUL; empty if absent."""
        entry = self.entry(tag, *path)
        if entry is None or entry.kind != 2:
            return ""
        return entry.data.partition(b"\0")[0].decode(errors="replace").strip()


# ---- reading -------------------------------------------------------------------------------------------


class Slot(NamedTuple):
    """One entry of a directory, in twelve bytes: tag, TIFF type, number of values; then 4 bytes.

    Those four are the values themselves if they fit, otherwise their offset. BigTIFF has counts and offsets of 8 bytes.
    """

    at: int  # start of the entry
    tag: int  # number of the tag
    kind: int  # TIFF type
    count: int  # number of values
    value_at: int  # position of the values or their offset


def slots(data: bytes | bytearray, order: str, at: int, count: int, layout: Layout = CLASSIC) -> Iterator[Slot]:
    """Yields ``count`` entries of a directory, starting at a position in the data."""
    to_value = 4 + layout.offset_bytes
    for place in range(at, at + layout.entry_bytes * count, layout.entry_bytes):
        tag, kind, values = struct.unpack_from(f"{order}HH{layout.offset}", data, place)
        yield Slot(place, tag, kind, values, place + to_value)


def read_tree(file: BinaryIO, most_pages: int = 1000, first_at: int | None = None) -> Tree | None:
    """Reads the directories of a TIFF, a BigTIFF or an EXIF blob without prefix; skips entries with invalid offsets.

    Reading begins at the first directory or at ``first_at``, and ends after so many pages. Returns None if nothing can
    be read.
    """
    file.seek(0)
    head = file.read(16)
    order = BYTE_ORDERS.get(head[:4])
    layout = CLASSIC if order else BIG
    order = order or _BIG_BYTE_ORDERS.get(head[:4])
    if order is None or len(head) < layout.header + layout.offset_bytes:
        return None
    reader = _Reader(file, order, layout)
    pages: list[Directory] = []
    offset = struct.unpack_from(order + layout.offset, head, layout.header)[0] if first_at is None else first_at
    while offset and len(pages) < most_pages and (page := reader.directory(offset)) is not None:
        directory, offset = page
        pages.append(directory)
    return Tree(order, pages, layout, reader.note_at) if pages else None


def read_directory(data: bytes, at: int, order: str) -> Directory | None:
    """Reads one directory, such as a maker note, at a position in the data; returns None if it is truncated."""
    file = io.BytesIO(data + bytes(4))  # some notes end without the offset of a next directory
    page = _Reader(file, order, CLASSIC).directory(at) if 0 <= at < len(data) else None
    return page[0] if page else None


class _Reader:
    def __init__(self, file: BinaryIO, order: str, layout: Layout) -> None:
        self.file = file
        self.order = order
        self.layout = layout
        self.length = file.seek(0, io.SEEK_END)
        # No photo has more; and values in a valid file do not overlap: many at one place could exhaust memory.
        self.bytes_left = min(1 << 28, 2 * self.length + (1 << 16))
        self.note_at: int | None = None
        self.visited: set[int] = set()  # detects directories that contain loops, or are shared

    def directory(self, offset: int, depth: int = 0) -> tuple[Directory, int] | None:
        """Reads (directory, offset of the next one); returns None if the file is truncated."""
        if offset in self.visited or offset > self.length:
            return None
        self.visited.add(offset)
        self.file.seek(offset)
        layout = self.layout
        try:
            (count,) = struct.unpack(self.order + layout.count, self.file.read(struct.calcsize("=" + layout.count)))
            if count > 65_535:
                return None
            table = self.file.read(layout.entry_bytes * count + layout.offset_bytes)
            (following,) = struct.unpack_from(self.order + layout.offset, table, layout.entry_bytes * count)
        except struct.error:
            return None
        self.bytes_left -= len(table)
        if self.bytes_left < 0:
            return None
        directory: Directory = {}
        for slot in slots(table, self.order, 0, count, layout):
            value = self._value(table, slot, depth)
            if value is not None:
                directory[slot.tag] = value
        return directory, following

    def _value(self, table: bytes, slot: Slot, depth: int) -> Entry | Directory | None:
        size = VALUE_BYTES.get(slot.kind, 0) * slot.count
        if not 0 < size <= self.bytes_left:
            return None
        wide = self.layout.offset if size > 4 or slot.tag not in SUB_DIRECTORIES else "I"  # a BigTIFF may use either
        (pointer,) = struct.unpack_from(self.order + wide, table, slot.value_at)
        if slot.tag in SUB_DIRECTORIES:
            below = self.directory(pointer, depth + 1) if depth < 2 else None
            return below[0] if below else None
        if size > self.layout.offset_bytes:
            if pointer > self.length:
                return None
            if slot.tag == MAKER_NOTE:
                self.note_at = pointer
            self.file.seek(pointer)
            data = self.file.read(size)
        else:
            data = table[slot.value_at : slot.value_at + size]
        self.bytes_left -= len(data)
        return Entry(slot.kind, slot.count, data) if len(data) == size else None


# ---- encoding ------------------------------------------------------------------------------------------

# Bytes of the units affected by byte order, by TIFF type.
_UNIT = {**VALUE_BYTES, 5: 4, 10: 4}
# BigTIFF's types: the corresponding 4-byte type, and struct's letters for both.
_NARROWER = {16: (4, "Q", "I"), 17: (9, "q", "i"), 18: (4, "Q", "I")}


def encoded(directory: Directory, at: int, order: str, layout: Layout = CLASSIC) -> bytes:
    """Encodes a directory for offset ``at``, followed by its values and sub-directories."""
    table = [struct.pack(order + layout.count, len(directory))]
    values = []
    here = at + len(table[0]) + layout.entry_bytes * len(directory) + layout.offset_bytes
    for tag, entry in sorted(directory.items(), key=lambda item: item[0]):
        if isinstance(entry, dict):
            kind = layout.directory
            count = 1
            data = encoded(entry, here, order, layout)
            inline = False
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
    rotated: Directory = {}
    for tag, entry in directory.items():
        if isinstance(entry, dict):
            rotated[tag] = in_other_order(entry)
        else:
            unit = _UNIT[entry.kind]
            data = bytearray(entry.data)
            for byte in range(unit):
                data[byte::unit] = entry.data[unit - 1 - byte :: unit]
            rotated[tag] = Entry(entry.kind, entry.count, bytes(data))
    return rotated
