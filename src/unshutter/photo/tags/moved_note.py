"""Makers' notes that move: their own directories mostly point to places counted from the beginning of all EXIF.

What stands in a note is the maker's secret. But most are a TIFF directory behind a few bytes of name, and whether its
offsets are counted from outside shows: then more of its values lie within the note than otherwise.

Source: exiftool.org/makernote_types.html (facts only).
"""

from __future__ import annotations

import struct

from unshutter.photo.tags.directories import BYTE_ORDERS, VALUE_BYTES, Slot, slots

_STARTS = (0, 6, 8, 10, 12)  # bytes before the directory: none (Canon), a name and a version (Nikon, Olympus, Sony ...)
_MOST_TAGS = 1000
_FOOTER_BYTES = 8  # with which Canon's notes may end: a TIFF header that tells where the note began


def moved(note: bytes, order: str, was_at: int, is_at: int) -> bytes:
    """The note with offsets that fit its new place; as it was where they are counted from within, or cannot be read.

    Args:
        note: its bytes.
        order: of the EXIF around it, ``<`` or ``>``.
        was_at: where it began, counted from the beginning of the EXIF.
        is_at: where it begins now.
    """
    changed = bytearray(note)
    for start in _STARTS:
        for each in (order, {"<": ">", ">": "<"}[order]):
            pointing = _pointing(note, each, start, was_at)
            for slot in pointing:
                (offset,) = struct.unpack_from(each + "I", note, slot.value_at)
                struct.pack_into(each + "I", changed, slot.value_at, offset - was_at + is_at)
            if pointing:
                _follow_footer(changed, was_at, is_at)
                return bytes(changed)
    return note


def _pointing(note: bytes, order: str, start: int, was_at: int) -> list[Slot]:
    """Entries whose values lie elsewhere in the note; none where what begins there is no directory of that kind."""
    if len(note) < start + 2:
        return []
    (count,) = struct.unpack_from(order + "H", note, start)
    end = start + 2 + 12 * count
    if not 0 < count <= _MOST_TAGS or end > len(note):
        return []
    from_outside, from_within, elsewhere = [], 0, 0
    for slot in slots(note, order, start + 2, count):
        size = VALUE_BYTES.get(slot.kind, 0) * slot.count
        if not size:
            return []
        if size > 4:
            (at,) = struct.unpack_from(order + "I", note, slot.value_at)
            from_within += end <= at <= len(note) - size
            if end <= at - was_at <= len(note) - size:
                from_outside.append(slot)
            else:
                elsewhere += 1
    return from_outside if len(from_outside) > from_within and len(from_outside) >= elsewhere else []


def _follow_footer(note: bytearray, was_at: int, is_at: int) -> None:
    order = BYTE_ORDERS.get(bytes(note[-_FOOTER_BYTES:-4]))
    if order and struct.unpack_from(order + "I", note, len(note) - 4)[0] == was_at:
        struct.pack_into(order + "I", note, len(note) - 4, is_at)
