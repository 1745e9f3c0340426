"""Maker notes: a maker's own directory of tags in EXIF, as far as it is needed here.

Each begins with the maker's name in some form; its offsets are relative to its own start or to that of EXIF.

Source: the public descriptions of these notes by exiftool.org (facts only).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

from unshutter.photo.tags import exif
from unshutter.photo.tags.directories import (
    EXIF,
    Directory,
    Entry,
    Tree,
    numbers,
    read_directory,
    read_tree,
)
from unshutter.photo.tags.exif_editor import PREFIX

_MAKER_NOTE, _MAKE = 0x927C, 0x010F
_APPLE_CONTENT_IDENTIFIER = 0x0011


@dataclass(frozen=True)
class MakerNote:
    """A maker's directory.

    Attributes:
        maker: name of the maker, as in :data:`_LAYOUTS`.
        order: its byte order, as for struct.
        tags: its entries by number.
        data: data that its offsets refer to.
    """

    maker: str
    order: str
    tags: Directory
    data: bytes

    def numbers(self, tag: int) -> tuple[float, ...]:
        """Returns all values of a numeric tag, fractions divided; empty if absent."""
        entry = self.tags.get(tag)
        return numbers(entry, self.order) if isinstance(entry, Entry) else ()

    def bytes(self, tag: int) -> bytes:
        """Returns the bytes of a tag; empty if absent."""
        entry = self.tags.get(tag)
        return entry.data if isinstance(entry, Entry) else b""

    def below(self, tag: int) -> MakerNote | None:
        """Returns the sub-directory that a tag contains or points to; None without one."""
        entry, numbers = self.tags.get(tag), self.numbers(tag)
        if not isinstance(entry, Entry):
            return None
        at = int(numbers[0]) if len(numbers) == 1 else self.data.find(entry.data)
        directory = read_directory(self.data, at, self.order)
        return replace(self, tags=directory) if directory is not None else None


@dataclass(frozen=True)
class _Layout:
    """The layout of the start of a maker note.

    Attributes:
        maker: name of the maker.
        begins: its first bytes.
        at: start of the directory in the note; None: stated in the note at byte 8.
        own_places: whether offsets are relative to its own start, rather than to that of EXIF.
        order: returns its byte order, from its first bytes and the byte order of EXIF.
    """

    maker: str
    begins: bytes
    at: int | None
    own_places: bool
    order: Callable[[bytes, str], str]


def _exif_order(_: bytes, order: str) -> str:
    return order


def _order_at(place: int) -> Callable[[bytes, str], str]:
    return lambda note, order: {b"II": "<", b"MM": ">"}.get(note[place : place + 2], order)


_LAYOUTS = (
    _Layout("Apple", b"Apple iOS\0", 14, True, _order_at(12)),
    _Layout("Fujifilm", b"FUJIFILM", None, True, lambda *_: "<"),
    _Layout("Olympus", b"OLYMPUS\0", 12, True, _order_at(8)),
    _Layout("Olympus", b"OM SYSTEM\0", 16, True, _order_at(12)),
    _Layout("Olympus", b"OLYMP\0", 8, False, _exif_order),
    _Layout("Panasonic", b"Panasonic\0\0\0", 12, False, _exif_order),
    _Layout("Pentax", b"PENTAX \0", 10, True, _order_at(8)),
    _Layout("Pentax", b"AOC\0", 6, False, _order_at(4)),
)


def read(blob: bytes | None) -> MakerNote | None:
    """Reads the maker note of an EXIF blob; returns None if there is none of a known kind."""
    tree = exif.read(blob)
    entry = tree.entry(_MAKER_NOTE, EXIF) if tree else None
    if tree is None or entry is None or blob is None:
        return None
    note, whole = entry.data, blob.removeprefix(PREFIX)
    if note.startswith(b"Nikon\0\x02"):
        return _of_nikon(note[10:])
    for layout in _LAYOUTS:
        if note.startswith(layout.begins) and len(note) > 16:
            return _as_laid_out(layout, note, whole, tree)
    if tree.text(_MAKE).startswith("Canon"):
        return _note_at("Canon", tree.order, whole, whole.find(note))
    return None


def content_identifier(blob: bytes | None) -> str:
    """Returns the identifier that Apple gives to a Live Photo and its film; empty if EXIF has none."""
    note = read(blob)
    if note is None or note.maker != "Apple":
        return ""
    return note.bytes(_APPLE_CONTENT_IDENTIFIER).split(b"\0")[0].decode("ascii", errors="replace").strip()


def _as_laid_out(layout: _Layout, note: bytes, whole: bytes, tree: Tree) -> MakerNote | None:
    order = layout.order(note, tree.order)
    at = struct.unpack_from("<I", note, 8)[0] if layout.at is None else layout.at
    if layout.own_places:
        return _note_at(layout.maker, order, note, at)
    return _note_at(layout.maker, order, whole, whole.find(note) + at)


def _note_at(maker: str, order: str, data: bytes, at: int) -> MakerNote | None:
    directory = read_directory(data, at, order)
    return MakerNote(maker, order, directory, data) if directory else None


def _of_nikon(note: bytes) -> MakerNote | None:
    """Reads Nikon's note, which contains a complete TIFF structure."""
    tree = read_tree(io.BytesIO(note), most_pages=1)
    return MakerNote("Nikon", tree.order, tree.pages[0], note) if tree else None
