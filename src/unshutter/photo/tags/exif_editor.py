"""Changes EXIF blobs in place or at their end, so that nothing else moves.

Source: CIPA DC-008 (EXIF 2.32), section 4.5.
"""

from __future__ import annotations

import struct

from unshutter.photo.tags.directories import BYTE_ORDERS, Slot, slots
from unshutter.photo.tags.directory_bytes import encoded_number

PREFIX = b"Exif\0\0"
_THUMBNAIL, _THUMBNAIL_LENGTH = 0x0201, 0x0202


class Editor:
    """An EXIF blob with the positions of its entries; a damaged blob appears to have none.

    Attributes:
        first: entries of the first directory, by tag; the first one of duplicates, as read by most programs.
        link_at: position of the offset of the second directory; 0 if it cannot be written.
        second_at: position of the second directory, or 0.
    """

    def __init__(self, blob: bytes) -> None:
        self.data = bytearray(blob)
        self.start = len(PREFIX) if blob.startswith(PREFIX) else 0
        self.order = BYTE_ORDERS.get(blob[self.start : self.start + 4], "")
        self.first: dict[int, Slot] = {}
        self.link_at = self.second_at = 0
        if self.order and len(blob) >= self.start + 8:
            first_at = self._place(self.start + 4)
            listed = self.slots_at(first_at)
            self.first = self._by_tag(listed)
            link_at = first_at + 2 + 12 * len(listed)
            if first_at > self.start and link_at + 4 <= len(blob):
                self.link_at = link_at
                self.second_at = self._place(link_at)

    def _place(self, at: int) -> int:
        """Converts the offset stored at a position to a position; 0 if invalid."""
        (offset,) = struct.unpack_from(self.order + "I", self.data, at)
        return self.start + offset if 0 < offset < len(self.data) - self.start else 0

    def slots_at(self, at: int) -> list[Slot]:
        """Returns the entries of the directory at a position; tags may be duplicated."""
        if not 0 < at <= len(self.data) - 2:
            return []
        (count,) = struct.unpack_from(self.order + "H", self.data, at)
        if at + 2 + 12 * count > len(self.data):
            return []
        return list(slots(self.data, self.order, at + 2, count))

    @staticmethod
    def _by_tag(listed: list[Slot]) -> dict[int, Slot]:
        return {slot.tag: slot for slot in reversed(listed)}

    def below(self, entries: dict[int, Slot], tag: int) -> dict[int, Slot]:
        """Returns the entries of the sub-directory that a tag points to."""
        return self._by_tag(self.slots_at(self._place(entries[tag].value_at))) if tag in entries else {}

    def put(self, slot: Slot, value: int) -> None:
        """Replaces the value of an entry with a single number."""
        number = encoded_number(self.order, slot.tag, 3 if value < 1 << 16 else 4, value)
        self.data[slot.at : slot.at + len(number)] = number

    def end(self) -> int:
        """Pads to an even offset, and returns it."""
        self.data += bytes((len(self.data) - self.start) % 2)
        return len(self.data) - self.start

    def add_to_first(self, tag: int, value: int) -> None:
        """Rewrites the first directory at the end of the blob, with one more entry."""
        if not self.link_at:
            return
        count = (self.link_at - first_at - 2) // 12 if (first_at := self._place(self.start + 4)) else 0
        old = [bytes(self.data[slot.at : slot.at + 12]) for slot in slots(self.data, self.order, first_at + 2, count)]
        link = bytes(self.data[self.link_at : self.link_at + 4])
        added = encoded_number(self.order, tag, 3, value)
        new = sorted([*old, added], key=lambda entry: struct.unpack(self.order + "H", entry[:2]))
        struct.pack_into(self.order + "I", self.data, self.start + 4, self.end())
        self.data += struct.pack(self.order + "H", len(new)) + b"".join(new) + link

    def wipe_thumbnail(self) -> None:
        """Overwrites the thumbnail and the link to its directory with zeros."""
        listed = self.slots_at(self.second_at)
        places = [self._place(slot.value_at) for slot in listed if slot.tag == _THUMBNAIL]
        lengths = [slot.value_at for slot in listed if slot.tag == _THUMBNAIL_LENGTH]
        for at, length_at in zip(places, lengths, strict=False):
            (length,) = struct.unpack_from(self.order + "I", self.data, length_at)
            length = min(length, len(self.data) - at)
            if at > self.start + 8:
                self.data[at : at + length] = bytes(length)
        self.data[self.link_at : self.link_at + 4] = bytes(4)
        self.second_at = 0
