"""Maker notes: a maker's own directory of tags in EXIF, read as far as it is needed here, and adjusted when it moves.

A note begins with the maker's name in some form. Its offsets are relative to its own start or to that of EXIF; those of
the second kind are adjusted when the note moves. The content of a note is the maker's secret, but most notes are a TIFF
directory after a few bytes of name. Offsets are taken as relative to all EXIF if more values then lie within the note
than otherwise, or equally many that are closer to the directory's end, where values begin.

Source: the public descriptions of these notes by exiftool.org (facts only), makernote_types.html among them.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from unshutter.photo import directories as tiff

_MAKE = 0x010F
_APPLE_CONTENT_IDENTIFIER = 0x0011
_NIKON, _NIKON_HEAD, _NIKON_PREVIEW = b"Nikon\0\x02", 10, 0x0011  # its later notes; the directory of their preview


@dataclass(frozen=True)
class MakerNote:
    """A maker's directory."""

    maker: str  # name of the maker, as in :data:`_LAYOUTS`
    order: str  # its byte order, as for struct
    tags: tiff.Directory  # its entries by number
    data: bytes  # data that its offsets refer to

    def numbers(self, tag: int) -> tuple[float, ...]:
        """Returns all values of a numeric tag, fractions divided; empty if absent."""
        entry = self.tags.get(tag)
        return tiff.numbers(entry, self.order) if isinstance(entry, tiff.Entry) else ()

    def bytes(self, tag: int) -> bytes:
        """Returns the bytes of a tag; empty if absent."""
        entry = self.tags.get(tag)
        return entry.data if isinstance(entry, tiff.Entry) else b""

    def below(self, tag: int) -> MakerNote | None:
        """Returns the sub-directory that a tag contains or points to; None without one."""
        entry, numbers = self.tags.get(tag), self.numbers(tag)
        if not isinstance(entry, tiff.Entry):
            return None
        at = int(numbers[0]) if len(numbers) == 1 else self.data.find(entry.data)
        directory = tiff.read_directory(self.data, at, self.order)
        return replace(self, tags=directory) if directory is not None else None


class _Layout(NamedTuple):
    """The layout of the start of a maker note."""

    maker: str
    begins: bytes  # its first bytes
    at: int | None  # start of the directory in the note; None: stated in the note at byte 8
    own_places: bool  # whether offsets are relative to its own start, rather than to that of EXIF
    order: int | str  # position of its byte order mark, or its byte order; empty: that of EXIF


_LAYOUTS = (
    _Layout("Apple", b"Apple iOS\0", 14, True, 12),
    _Layout("Fujifilm", b"FUJIFILM", None, True, "<"),
    _Layout("Olympus", b"OLYMPUS\0", 12, True, 8),
    _Layout("Olympus", b"OM SYSTEM\0", 16, True, 12),
    _Layout("Olympus", b"OLYMP\0", 8, False, ""),
    _Layout("Panasonic", b"Panasonic\0\0\0", 12, False, ""),
    _Layout("Pentax", b"PENTAX \0", 10, True, 8),
    _Layout("Pentax", b"AOC\0", 6, False, 4),
)


def read(blob: bytes | None) -> MakerNote | None:
    """Reads the maker note of an EXIF blob; returns None if there is none of a known kind."""
    whole = (blob or b"").removeprefix(tiff.EXIF_PREFIX)
    tree = tiff.read_tree(io.BytesIO(whole))
    entry = tree.entry(tiff.MAKER_NOTE, tiff.EXIF) if tree else None
    if tree is None or entry is None:
        return None
    note = entry.data
    if note.startswith(_NIKON):  # contains a complete TIFF structure
        own = note[_NIKON_HEAD:]
        nikon = tiff.read_tree(io.BytesIO(own), most_pages=1)
        return MakerNote("Nikon", nikon.order, nikon.pages[0], own) if nikon else None
    layout = next((one for one in _LAYOUTS if note.startswith(one.begins) and len(note) > 16), None)
    if layout is None:
        return _note_at("Canon", tree.order, whole, whole.find(note)) if tree.text(_MAKE).startswith("Canon") else None
    order = layout.order or tree.order
    if isinstance(order, int):
        order = {b"II": "<", b"MM": ">"}.get(note[order : order + 2], tree.order)
    at = struct.unpack_from("<I", note, 8)[0] if layout.at is None else layout.at
    if layout.own_places:
        return _note_at(layout.maker, order, note, at)
    return _note_at(layout.maker, order, whole, whole.find(note) + at)


def _note_at(maker: str, order: str, data: bytes, at: int) -> MakerNote | None:
    directory = tiff.read_directory(data, at, order)
    return MakerNote(maker, order, directory, data) if directory else None


def content_identifier(blob: bytes | None) -> str:
    """Returns the identifier that Apple gives to a Live Photo and its film; empty if EXIF has none."""
    note = read(blob)
    if note is None or note.maker != "Apple":
        return ""
    return note.bytes(_APPLE_CONTENT_IDENTIFIER).split(b"\0")[0].decode("ascii", errors="replace").strip()


# ---- notes that move -----------------------------------------------------------------------------------

_STARTS = (0, 6, 8, 10, 12)  # bytes before the directory: none (Canon), a name and a version (Nikon, Olympus, Sony ...)
_OPAQUE = 7  # TIFF type: bytes without a meaning
_MOST_TAGS = 1000
_UNUSED = (0, 0, 0)  # tag, TIFF type and number of values of an entry left empty by a camera
_SURELY = 3  # this many values that all lie elsewhere in EXIF are not a coincidence
_FOOTER_BYTES = 8  # Canon's notes may end with a TIFF header with the note's original position


def complete(directory: tiff.Directory, tree: tiff.Tree, whole: bytes) -> None:
    """Copies values of the maker note that lie elsewhere in EXIF into the note, before it is moved.

    Changes the first directory of the tree, whose bytes are ``whole``.
    """
    details, note = directory.get(tiff.EXIF), _note_of(directory)
    if isinstance(details, dict) and note is not None and note.kind == _OPAQUE and tree.note_at is not None:
        data = _completed(note.data, tree.order, tree.note_at, whole)
        details[tiff.MAKER_NOTE] = tiff.Entry(_OPAQUE, len(data), data)


def in_place(written: bytes, at: int, directory: tiff.Directory, tree: tiff.Tree) -> bytes:
    """Adjusts the maker note from a tree in an encoded directory to the directory's new position in a file."""
    note = _note_of(directory)
    start = written.find(note.data) if note is not None and tree.note_at is not None else -1
    if start < 0 or tree.note_at is None or note is None:
        return written
    follows = moved(note.data, tree.order, tree.note_at, at + start)
    return written[:start] + follows + written[start + len(follows) :]


def is_incomplete(tree: tiff.Tree) -> bool:
    """Whether parts of the maker note are elsewhere in the file, so that they are lost in any other file."""
    note = _note_of(tree.pages[0])
    if note is None or tree.note_at is None:
        return False
    if note.data.startswith(_NIKON):
        return _preview_is_outside(note.data[_NIKON_HEAD:])
    directory = _from_outside(note.data, tree.order, tree.note_at)
    return directory is not None and bool(directory.elsewhere)


def _note_of(directory: tiff.Directory) -> tiff.Entry | None:
    details = directory.get(tiff.EXIF)
    note = details.get(tiff.MAKER_NOTE) if isinstance(details, dict) else None
    return note if isinstance(note, tiff.Entry) else None


def moved(note: bytes, order: str, was_at: int, is_at: int) -> bytes:
    """Adapts the note's offsets, relative to the start of EXIF in that byte order, to its new position.

    Returns the note unchanged if its offsets are relative to the note, or unreadable.
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


def _completed(note: bytes, order: str, was_at: int, whole: bytes) -> bytes:
    """Appends values that lie elsewhere in EXIF (``whole``) to the note."""
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


def _directories(note: bytes, order: str, was_at: int) -> Iterator[_Directory]:
    """Yields every possible directory of a note: at each usual start, in either byte order."""
    for start in _STARTS:
        for each in (order, {"<": ">", ">": "<"}[order]):
            directory = _directory(note, each, start, was_at)
            if directory is not None:
                yield directory


def _directory(note: bytes, order: str, start: int, was_at: int) -> _Directory | None:
    """Parses a directory at a position in a note, in one byte order; returns None if it cannot be one."""
    if len(note) < start + 2:
        return None
    (count,) = struct.unpack_from(order + "H", note, start)
    end = start + 2 + 12 * count
    if not 0 < count <= _MOST_TAGS or end > len(note):
        return None
    directory = _Directory(order, [], [], [], [])
    for slot in tiff.slots(note, order, start + 2, count):
        size = tiff.VALUE_BYTES.get(slot.kind, 0) * slot.count
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
    """Whether the preview of a Nikon note, which is a separate TIFF structure, lies beyond its end."""
    tree = tiff.read_tree(io.BytesIO(own), most_pages=1)
    at = tree.number(_NIKON_PREVIEW) if tree else None
    if tree is None or at is None:
        return False
    preview = tiff.read_tree(io.BytesIO(own), most_pages=1, first_at=at)
    if preview is None:
        return True
    begin, length = preview.number(tiff.THUMBNAIL), preview.number(tiff.THUMBNAIL_LENGTH)
    return begin is not None and length is not None and begin + length > len(own)


def _follow_footer(note: bytearray, was_at: int, is_at: int) -> None:
    order = tiff.BYTE_ORDERS.get(bytes(note[-_FOOTER_BYTES:-4]))
    if order and struct.unpack_from(order + "I", note, len(note) - 4)[0] == was_at:
        struct.pack_into(order + "I", note, len(note) - 4, is_at)
