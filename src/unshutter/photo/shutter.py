"""The kind of shutter that exposed a photo, where its camera states it: in XMP, or in the maker's note.

Sources: the tags ShutterType, ShutterMode and DriveMode of makers' notes, as ExifTool 13.58 lists them (facts only).
DJI's cameras with a mechanical shutter (Mavic 3E, Zenmuse P1) have it in the lens.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import NamedTuple

from unshutter.photo import directories as tiff
from unshutter.photo.directories import EXIF, MAKER_NOTE, Tree


class Shutter(StrEnum):
    """A kind of shutter; one whose first curtain is electronic counts as mechanical."""

    MECHANICAL = "mechanical"
    ELECTRONIC = "electronic"
    IN_LENS = "in the lens"  # a mechanical one, which exposes all rows at once


class _Note(NamedTuple):
    """Where a maker's note states the shutter."""

    start: bytes  # of the note
    order_at: int | None  # position of its byte order; None: that of EXIF
    directory_at: int
    tag: int
    mechanical: tuple[int, ...]
    electronic: tuple[int, ...]
    inside: int | None = None  # tag of the directory in which it stands; None: the first one
    element: int = 0  # which of its numbers
    has_tiff_head: bool = False  # offsets are relative to ``order_at``


_NOTES = (
    _Note(b"FUJIFILM", None, 12, 0x1050, (0, 3), (1, 2)),
    _Note(b"Panasonic\0", None, 12, 0x009F, (0, 2), (1,)),
    _Note(b"AOC\0", 4, 6, 0x0087, (0,), (1,)),
    _Note(b"PENTAX \0", 8, 10, 0x0087, (0,), (1,)),
    _Note(b"Nikon\0\x02", 10, 18, 0x0034, (0, 48, 80, 81), (16, 64, 96), has_tiff_head=True),
    _Note(b"OLYMPUS\0", 8, 12, 0x0600, (2,), (4,), inside=0x2020, element=4),
    _Note(b"OM SYSTEM\0", 12, 16, 0x0600, (2,), (4,), inside=0x2020, element=4),
)
_CANON = _Note(b"", None, 0, 0x0093, (0, 1), (2,), element=23)  # its offsets are relative to all EXIF
_DJI = re.compile(rb"""drone-dji:ShutterType\s*(?:=\s*["']|>)\s*(\w+)""")


def stated_shutter(tree: Tree, make: str, xmp: bytes | None) -> Shutter | None:
    """Returns the shutter that the camera states in XMP or in its maker's note; None if it states none.

    Args:
        tree: EXIF.
        make: the camera's maker, in lower case.
        xmp: the XMP packet.
    """
    found = _DJI.search(xmp) if xmp and make == "dji" else None
    if found is not None:
        return {b"Mechanical": Shutter.IN_LENS, b"Electronic": Shutter.ELECTRONIC}.get(found[1])
    entry = tree.entry(MAKER_NOTE, EXIF)
    if entry is None:
        return None
    data = entry.data
    note = next((each for each in _NOTES if data.startswith(each.start)), _CANON if make == "canon" else None)
    if note is None:
        return None
    number = _number(data, note, tree)
    if number in note.mechanical:
        return Shutter.MECHANICAL
    return Shutter.ELECTRONIC if number in note.electronic else None


def _number(data: bytes, note: _Note, tree: Tree) -> int | None:
    """Returns the number in which a note states the shutter; None if it is missing."""
    order = tree.order
    at = note.directory_at
    if note.order_at is not None:
        order = {b"II": "<", b"MM": ">"}.get(data[note.order_at : note.order_at + 2], order)
    if note is _CANON:
        at = tree.note_at or 0
        data = bytes(at) + data
    elif note.has_tiff_head and note.order_at is not None:
        data = data[note.order_at :]
        at -= note.order_at
    directory = tiff.read_directory(data, at, order) or {}
    if note.inside is not None:
        below = Tree(order, [directory]).numbers(note.inside)
        directory = (tiff.read_directory(data, int(below[0]), order) if below else None) or {}
    numbers = Tree(order, [directory]).numbers(note.tag)
    return int(numbers[note.element]) if len(numbers) > note.element else None
