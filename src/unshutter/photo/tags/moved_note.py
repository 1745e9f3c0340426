"""Makers' notes that move: their own directories mostly point to places counted from the beginning of all EXIF.

What stands in a note is the maker's secret. But most are a TIFF directory behind a few bytes of name, and whether its
offsets are counted from outside shows: then more of its values lie within the note than otherwise, or as many, and
nearer to the directory's end, where values begin.

Source: exiftool.org/makernote_types.html (facts only).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from typing import NamedTuple

from unshutter.photo.tags.directories import (
    BYTE_ORDERS,
    EXIF,
    MAKER_NOTE,
    VALUE_BYTES,
    Directory,
    Entry,
    Slot,
    Tree,
    read_tree,
    slots,
)

_STARTS = (0, 6, 8, 10, 12)  # bytes before the directory: none (Canon), a name and a version (Nikon, Olympus, Sony ...)
_OPAQUE = 7  # TIFF type: bytes without a meaning
_MOST_TAGS = 1000
_UNUSED = (0, 0, 0)  # tag, TIFF type and number of values of an entry that a camera left empty
_SURELY = 3  # values, all of which lie elsewhere in EXIF, are no coincidence
_NIKON, _NIKON_HEAD, _NIKON_PREVIEW = b"Nikon\0\x02", 10, 0x0011  # its later notes; the directory of their preview
_THUMBNAIL, _THUMBNAIL_LENGTH = 0x0201, 0x0202
_FOOTER_BYTES = 8  # with which Canon's notes may end: a TIFF header with the place where the note began


def complete(directory: Directory, tree: Tree, whole: bytes) -> None:
    """Brings values of the maker's note that lie elsewhere in EXIF into the note, before that moves.

    Args:
        directory: the first one, with EXIF's below it; changed.
        tree: in which the note stood.
        whole: the bytes of that.
    """
    details, note = directory.get(EXIF), _note_of(directory)
    if isinstance(details, dict) and note is not None and note.kind == _OPAQUE and tree.note_at is not None:
        data = completed(note.data, tree.order, tree.note_at, whole)
        details[MAKER_NOTE] = Entry(_OPAQUE, len(data), data)


def in_place(written: bytes, at: int, directory: Directory, tree: Tree) -> bytes:
    """An encoded directory for a place in a file, its maker's note, which comes from a tree, adjusted to that place."""
    note = _note_of(directory)
    start = written.find(note.data) if note is not None and tree.note_at is not None else -1
    if start < 0 or tree.note_at is None or note is None:
        return written
    follows = moved(note.data, tree.order, tree.note_at, at + start)
    return written[:start] + follows + written[start + len(follows) :]


def is_incomplete(tree: Tree) -> bool:
    """Whether parts of the maker's note stand elsewhere in the file, so that no other file gets them."""
    note = _note_of(tree.pages[0])
    return note is not None and tree.note_at is not None and points_outside(note.data, tree.order, tree.note_at)


def _note_of(directory: Directory) -> Entry | None:
    """The maker's note of a first directory."""
    details = directory.get(EXIF)
    note = details.get(MAKER_NOTE) if isinstance(details, dict) else None
    return note if isinstance(note, Entry) else None


# ---- notes alone ---------------------------------------------------------------------------------------


def moved(note: bytes, order: str, was_at: int, is_at: int) -> bytes:
    """The note with offsets that fit its new place; as it was where they are counted from within, or cannot be read.

    Args:
        note: its bytes.
        order: of the EXIF around it, ``<`` or ``>``.
        was_at: where it began, counted from the beginning of the EXIF.
        is_at: where it begins now.
    """
    directory = _from_outside(note, order, was_at)
    if directory is None:
        return note
    changed = bytearray(note)
    for slot in directory.inside:
        (offset,) = struct.unpack_from(directory.order + "I", note, slot.value_at)
        struct.pack_into(directory.order + "I", changed, slot.value_at, offset - was_at + is_at)
    _follow_footer(changed, was_at, is_at)
    return bytes(changed)


def points_outside(note: bytes, order: str, was_at: int) -> bool:
    """Whether values of the note, or Nikon's preview, lie elsewhere in the file, and are lost if the note moves.

    Args:
        note: its bytes.
        order: of the EXIF around it.
        was_at: where it began.
    """
    if note.startswith(_NIKON):
        return _preview_is_outside(note[_NIKON_HEAD:])
    directory = _from_outside(note, order, was_at)
    return directory is not None and bool(directory.elsewhere)


def completed(note: bytes, order: str, was_at: int, whole: bytes) -> bytes:
    """The note with those of its values that lie elsewhere in EXIF brought in, behind its end.

    Args:
        note: its bytes.
        order: of the EXIF around it.
        was_at: where it began.
        whole: the EXIF, from where offsets are counted.
    """
    for directory in _directories(note, order, was_at):
        stray = [(slot, at, size) for slot, at, size in directory.elsewhere if 8 <= at <= len(whole) - size]
        all_are_in_exif = len(stray) == len(directory.elsewhere) >= _SURELY and not directory.from_within
        if directory.is_from_outside or all_are_in_exif:
            changed, values = bytearray(note), b""
            for slot, at, size in stray:
                struct.pack_into(directory.order + "I", changed, slot.value_at, was_at + len(note) + len(values))
                values += whole[at : at + size]
            return bytes(changed) + values
    return note


class _Directory(NamedTuple):
    """The directory of a note, with the values that do not stand in it.

    Attributes:
        order: its byte order.
        inside: entries whose values lie in the note, if their offsets are counted from the beginning of all EXIF.
        elsewhere: (entry, offset, bytes) of those whose values do not.
        from_outside, from_within: how far behind the directory the values in the note lie, by either way of counting.
    """

    order: str
    inside: list[Slot]
    elsewhere: list[tuple[Slot, int, int]]
    from_outside: list[int]
    from_within: list[int]

    @property
    def is_from_outside(self) -> bool:
        """Whether the offsets are counted from the beginning of all EXIF: more values lie in the note, or nearer."""
        if not self.inside or len(self.inside) < len(self.elsewhere):
            return False
        if len(self.from_outside) != len(self.from_within):
            return len(self.from_outside) > len(self.from_within)
        return min(self.from_outside) < min(self.from_within)


def _from_outside(note: bytes, order: str, was_at: int) -> _Directory | None:
    """The directory of a note whose offsets are counted from the beginning of all EXIF; None for other notes."""
    return next((directory for directory in _directories(note, order, was_at) if directory.is_from_outside), None)


def _directories(note: bytes, order: str, was_at: int) -> Iterator[_Directory]:
    """What may be the directory of a note: at each place where it may begin, in either byte order."""
    for start in _STARTS:
        for each in (order, {"<": ">", ">": "<"}[order]):
            directory = _directory(note, each, start, was_at)
            if directory is not None:
                yield directory


def _directory(note: bytes, order: str, start: int, was_at: int) -> _Directory | None:
    """The directory of a note, if it begins at a place in the note and has a byte order; None if it cannot."""
    if len(note) < start + 2:
        return None
    (count,) = struct.unpack_from(order + "H", note, start)
    end = start + 2 + 12 * count
    if not 0 < count <= _MOST_TAGS or end > len(note):
        return None
    directory = _Directory(order, [], [], [], [])
    for slot in slots(note, order, start + 2, count):
        size = VALUE_BYTES.get(slot.kind, 0) * slot.count
        if not size and (slot.tag, slot.kind, slot.count) != _UNUSED:
            return None
        if size > 4:
            (at,) = struct.unpack_from(order + "I", note, slot.value_at)
            if end <= at <= len(note) - size:
                directory.from_within.append(at - end)
            if end <= at - was_at <= len(note) - size:
                directory.inside.append(slot)
                directory.from_outside.append(at - was_at - end)
            else:
                directory.elsewhere.append((slot, at, size))
    return directory


def _preview_is_outside(own: bytes) -> bool:
    """Whether the preview of a note of Nikon's, which is a TIFF structure of its own, lies behind its end."""
    tree = read_tree(io.BytesIO(own), most_pages=1)
    at = tree.number(_NIKON_PREVIEW) if tree else None
    if tree is None or at is None:
        return False
    preview = read_tree(io.BytesIO(own), most_pages=1, first_at=at)
    if preview is None:
        return True
    begin, length = preview.number(_THUMBNAIL), preview.number(_THUMBNAIL_LENGTH)
    return begin is not None and length is not None and begin + length > len(own)


def _follow_footer(note: bytearray, was_at: int, is_at: int) -> None:
    order = BYTE_ORDERS.get(bytes(note[-_FOOTER_BYTES:-4]))
    if order and struct.unpack_from(order + "I", note, len(note) - 4)[0] == was_at:
        struct.pack_into(order + "I", note, len(note) - 4, is_at)
