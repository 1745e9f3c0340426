"""Maker notes: a maker's own directory of tags in EXIF; Apple's is read, and all are adjusted when they move.

A note usually begins with the maker's name in some form. Its offsets are relative to its own start or to that of EXIF;
those of the second kind are adjusted when the note moves. The content of a note is the maker's secret, but most notes
are a TIFF directory after a few bytes of name. Offsets are taken as relative to all EXIF if more values then lie within
the note than otherwise, or equally many that are closer to the directory's end, where values begin.

Source: the public descriptions of these notes by exiftool.org (facts only), makernote_types.html among them.
"""

from __future__ import annotations

import io
import struct
from typing import NamedTuple

from unshutter.photo import directories as tiff

_APPLE = b"Apple iOS\0"
_APPLE_DIRECTORY_AT = 14
APPLE_CONTENT_IDENTIFIER = 0x0011
_NIKON = b"Nikon\0\x02"  # its later notes
_NIKON_PREVIEW = 0x0011  # the directory of their preview


def apple(blob: bytes | None) -> tiff.Tree:
    """Reads the directory of Apple's maker note in an EXIF blob; empty if there is none."""
    tree = tiff.read_tree(io.BytesIO((blob or b"").removeprefix(tiff.EXIF_PREFIX)))
    entry = tree.entry(tiff.MAKER_NOTE, tiff.EXIF) if tree else None
    note = entry.data if entry else b""
    order = "<" if note[12:14] == b"II" else ">"
    directory = tiff.read_directory(note, _APPLE_DIRECTORY_AT, order) if note.startswith(_APPLE) else None
    return tiff.Tree(order, [directory or {}])


# ---- notes that move -----------------------------------------------------------------------------------

# beginnings of notes whose offsets are relative to their own start
_SELF_CONTAINED = (b"OLYMPUS\0", b"OM SYSTEM\0", b"Nikon\0\x02", b"PENTAX \0", b"FUJIFILM", _APPLE)
_OPAQUE = 7  # TIFF type: bytes without a meaning
_UNUSED = (0, 0, 0)  # tag, TIFF type and number of values of an entry left empty by a camera
_SURELY = 3  # this many values that all lie elsewhere in EXIF are not a coincidence
_FOOTER_BYTES = 8  # Canon's notes may end with a TIFF header with the note's original position


def complete(directory: tiff.Directory, tree: tiff.Tree, whole: bytes) -> None:
    """Copies values of the maker note that lie elsewhere in EXIF into the note, before it is moved.

    Changes the first directory of the tree, whose bytes are ``whole``.
    """
    details = directory.get(tiff.EXIF)
    note = _note_of(directory)
    if isinstance(details, dict) and note is not None and note.kind == _OPAQUE and tree.note_at is not None:
        data = _completed(note.data, tree.order, tree.note_at, whole)
        details[tiff.MAKER_NOTE] = tiff.Entry(_OPAQUE, len(data), data)


def in_place(written: bytes, at: int, directory: tiff.Directory, tree: tiff.Tree) -> bytes:
    """Adjusts the maker note from a tree in an encoded directory to the directory's new position in a file."""
    note = _note_of(directory)
    start = written.find(note.data) if note is not None and tree.note_at is not None else -1
    if start < 0 or tree.note_at is None or note is None:
        return written
    follows = move_note(note.data, tree.order, tree.note_at, at + start)
    return written[:start] + follows + written[start + len(follows) :]


def is_incomplete(tree: tiff.Tree) -> bool:
    """Whether parts of the maker note are elsewhere in the file, so that they are lost in any other file."""
    note = _note_of(tree.pages[0])
    if note is None or tree.note_at is None:
        return False
    if note.data.startswith(_NIKON):
        return _preview_is_outside(note.data[10:])  # after the name and version
    directory = _from_outside(note.data, tree.order, _offsets_begin(note.data, tree.note_at))
    return directory is not None and bool(directory.elsewhere)


def _note_of(directory: tiff.Directory) -> tiff.Entry | None:
    details = directory.get(tiff.EXIF)
    note = details.get(tiff.MAKER_NOTE) if isinstance(details, dict) else None
    return note if isinstance(note, tiff.Entry) else None


def move_note(note: bytes, order: str, was_at: int, is_at: int) -> bytes:
    """Adapts the note's offsets, relative to the start of EXIF in that byte order, to its new position.

    Returns the note unchanged if its offsets are relative to the note, or unreadable.
    """
    was_at = _offsets_begin(note, was_at)
    directory = _from_outside(note, order, was_at)
    if directory is None:
        return note
    changed = bytearray(note)
    for slot in directory.inside:
        (offset,) = struct.unpack_from(directory.order + "I", note, slot.value_at)
        struct.pack_into(directory.order + "I", changed, slot.value_at, offset - was_at + is_at)
    if footer_order := _footer_order(note):
        struct.pack_into(footer_order + "I", changed, len(note) - 4, is_at)
    return bytes(changed)


def _completed(note: bytes, order: str, was_at: int, whole: bytes) -> bytes:
    """Appends values that lie elsewhere in EXIF (``whole``) to the note."""
    if _offsets_begin(note, was_at) != was_at:
        return note
    for directory in _directories(note, order, was_at):
        stray = [(slot, at, size) for slot, at, size in directory.elsewhere if 8 <= at <= len(whole) - size]
        all_are_in_exif = len(stray) == len(directory.elsewhere) >= _SURELY and not directory.from_within
        if directory.is_from_outside or all_are_in_exif:
            changed = bytearray(note)
            values = b""
            for slot, at, size in stray:
                struct.pack_into(directory.order + "I", changed, slot.value_at, was_at + len(note) + len(values))
                values += whole[at : at + size]
            return bytes(changed) + values
    return note


class _Directory(NamedTuple):
    """A possible directory of a note, with values inside and outside the note."""

    order: str  # byte order
    inside: list[tiff.Slot]  # entries whose values are in the note, if offsets are relative to the start of all EXIF
    elsewhere: list[tuple[tiff.Slot, int, int]]  # (entry, offset, bytes) of entries whose values are not
    from_outside: list[int]  # distances from the directory's end of values in the note, for offsets relative to EXIF
    from_within: list[int]  # such distances for offsets relative to the note

    @property
    def is_from_outside(self) -> bool:
        """Whether offsets are relative to the start of all EXIF: then more values are in the note, or closer."""
        if not self.inside or len(self.inside) < len(self.elsewhere):
            return False
        if len(self.from_outside) != len(self.from_within):
            return len(self.from_outside) > len(self.from_within)
        return min(self.from_outside) < min(self.from_within)


def _from_outside(note: bytes, order: str, was_at: int) -> _Directory | None:
    """Returns the directory of a note whose offsets are relative to the start of all EXIF; None for other notes."""
    return next((directory for directory in _directories(note, order, was_at) if directory.is_from_outside), None)


def _directories(note: bytes, order: str, was_at: int) -> list[_Directory]:
    """Returns every possible directory of a note, at each usual start, in either byte order, the longest first.

    There are none in a note whose offsets are known to be relative to its own start.
    """
    if note.startswith(_SELF_CONTAINED):
        return []
    orders = (order, {"<": ">", ">": "<"}[order])
    # bytes before the directory: none (Canon), a name and a version (Nikon, Olympus, Sony ...)
    possible = (_directory(note, each, start, was_at) for start in (0, 6, 8, 10, 12) for each in orders)
    return sorted(filter(None, possible), key=lambda each: -len(each.inside) - len(each.elsewhere))


def _directory(note: bytes, order: str, start: int, was_at: int) -> _Directory | None:
    """Parses a directory at a position in a note, in one byte order; returns None if it cannot be one."""
    if len(note) < start + 2:
        return None
    (count,) = struct.unpack_from(order + "H", note, start)
    end = start + 2 + 12 * count
    if not 0 < count <= 1000 or end > len(note):
        return None
    directory = _Directory(order, [], [], [], [])
    for slot in tiff.slots(note, order, start + 2, count):
        if slot.kind not in tiff.VALUE_BYTES and (slot.tag, slot.kind, slot.count) != _UNUSED:
            return None
        size = tiff.VALUE_BYTES.get(slot.kind, 0) * slot.count
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
    """Whether the preview of a Nikon note, which is a separate TIFF structure, lies beyond its end."""
    tree = tiff.read_tree(io.BytesIO(own), most_pages=1)
    at = tree.number(_NIKON_PREVIEW) if tree else None
    if tree is None or at is None:
        return False
    preview = tiff.read_tree(io.BytesIO(own), most_pages=1, first_at=at)
    if preview is None:
        return True
    begin = preview.number(tiff.THUMBNAIL)
    length = preview.number(tiff.THUMBNAIL_LENGTH)
    return begin is not None and length is not None and begin + length > len(own)


def _offsets_begin(note: bytes, at: int) -> int:
    """Returns the position of the note for which its offsets hold: that in its footer, otherwise where it is now.

    They differ after another program has moved the note without adjusting it.
    """
    order = _footer_order(note)
    return struct.unpack_from(order + "I", note, len(note) - 4)[0] if order else at


def _footer_order(note: bytes) -> str | None:
    return tiff.BYTE_ORDERS.get(note[-_FOOTER_BYTES:-4])
