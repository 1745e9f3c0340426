"""What in a photo's metadata must follow new pixels: sizes, orientation, the small pictures of it.

EXIF blobs are changed in place or at their end, so that all else stays where it was: makers' notes often point to
places counted from the blob's beginning.

Source: CIPA DC-008 (EXIF 2.32), section 4.5; Adobe, XMP specification part 3.
"""

from __future__ import annotations

import re
import struct

from unshutter.photo.metadata import EXIF, PIXEL_HEIGHT, PIXEL_WIDTH

_PREFIX = b"Exif\0\0"
_IMAGE_WIDTH, _IMAGE_HEIGHT, _ORIENTATION = 0x0100, 0x0101, 0x0112
_THUMBNAIL, _THUMBNAIL_LENGTH = 0x0201, 0x0202
_LARGEST_WITH_THUMBNAIL = 65_000  # bytes; a JPEG's EXIF ends at 65,527


# ---- EXIF ----------------------------------------------------------------------------------------------


def exif_with_size(exif: bytes, height: int, width: int) -> bytes:
    """The blob with the size tags that it has set to [px]."""
    blob = _Blob(exif)
    for entries, tags in (
        (blob.first, (_IMAGE_WIDTH, _IMAGE_HEIGHT)),
        (blob.below(blob.first, EXIF), (PIXEL_WIDTH, PIXEL_HEIGHT)),
    ):
        for tag, size in zip(tags, (width, height), strict=True):
            if tag in entries:
                blob.put(entries[tag], tag, size)
    return bytes(blob.data)


def exif_with_orientation(exif: bytes | None, orientation: int) -> bytes | None:
    """The blob with EXIF orientation 1-8; made up where there is none and 1 does not go without saying."""
    if exif is None:
        if orientation == 1:
            return None
        exif = _PREFIX + b"II*\0" + struct.pack("<IHI", 8, 0, 0)
    blob = _Blob(exif)
    if _ORIENTATION in blob.first:
        blob.put(blob.first[_ORIENTATION], _ORIENTATION, orientation)
    elif orientation != 1:
        blob.add_to_first(_ORIENTATION, orientation)
    return bytes(blob.data)


def has_thumbnail(exif: bytes | None) -> bool:
    """Whether the blob has a second directory, which is the thumbnail's."""
    return exif is not None and _Blob(exif).second_at != 0


def exif_with_thumbnail(exif: bytes, jpeg: bytes | None, orientation: int = 1) -> bytes:
    """The blob with another thumbnail instead of its own, which is wiped out; without one for None or lack of room."""
    blob = _Blob(exif)
    if blob.second_at:
        blob.wipe_thumbnail()
    if jpeg is not None and blob.link_at and len(blob.data) + len(jpeg) + 100 <= _LARGEST_WITH_THUMBNAIL:
        start, order = blob.end(), blob.order
        tags = ((0x0103, 3, 6), (_ORIENTATION, 3, orientation))
        tags += ((_THUMBNAIL, 4, start + 2 + 12 * 4 + 4), (_THUMBNAIL_LENGTH, 4, len(jpeg)))
        directory = struct.pack(order + "H", len(tags)) + b"".join(_entry(order, *tag) for tag in tags) + bytes(4)
        blob.data += directory + jpeg
        struct.pack_into(order + "I", blob.data, blob.link_at, start)
    return bytes(blob.data)


def _entry(order: str, tag: int, kind: int, value: int) -> bytes:
    return struct.pack(order + "HHI" + {3: "HH", 4: "I"}[kind], tag, kind, 1, *([value, 0] if kind == 3 else [value]))


class _Blob:
    """An EXIF blob by the places of its entries; a damaged one seems to have none.

    Attributes:
        first: place of each tag's entry in the first directory.
        link_at: place of the offset of the second directory; 0 if there is none to be written.
        second_at: place of the second directory, or 0.
    """

    def __init__(self, exif: bytes) -> None:
        self.data = bytearray(exif)
        self.start = len(_PREFIX) if exif.startswith(_PREFIX) else 0
        self.order = {b"II*\0": "<", b"MM\0*": ">"}.get(exif[self.start : self.start + 4], "")
        self.first: dict[int, int] = {}
        self.link_at = self.second_at = 0
        if self.order and len(exif) >= self.start + 8:
            first_at = self._place(self.start + 4)
            self.first = self.entries(first_at)
            link_at = first_at + 2 + 12 * len(self.first)
            if first_at > self.start and link_at + 4 <= len(exif):
                self.link_at = link_at
                self.second_at = self._place(link_at)

    def _place(self, at: int) -> int:
        """The place that the offset at another place means; 0 for none."""
        (offset,) = struct.unpack_from(self.order + "I", self.data, at)
        return self.start + offset if 0 < offset < len(self.data) - self.start else 0

    def entries(self, at: int) -> dict[int, int]:
        """Place of each tag's entry in the directory at a place."""
        if not 0 < at <= len(self.data) - 2:
            return {}
        (count,) = struct.unpack_from(self.order + "H", self.data, at)
        if at + 2 + 12 * count > len(self.data):
            return {}
        places = range(at + 2, at + 2 + 12 * count, 12)
        return {struct.unpack_from(self.order + "H", self.data, place)[0]: place for place in places}

    def below(self, entries: dict[int, int], tag: int) -> dict[int, int]:
        """The entries of the directory that hangs on a tag."""
        return self.entries(self._place(entries[tag] + 8)) if tag in entries else {}

    def put(self, place: int, tag: int, value: int) -> None:
        """Makes the entry at a place a single number."""
        self.data[place : place + 12] = _entry(self.order, tag, 3 if value < 1 << 16 else 4, value)

    def end(self) -> int:
        """Pads to an even offset, and gives it."""
        self.data += bytes((len(self.data) - self.start) % 2)
        return len(self.data) - self.start

    def add_to_first(self, tag: int, value: int) -> None:
        """Writes the first directory anew, at the end, with one entry more."""
        if not self.link_at:
            return
        old = [bytes(self.data[place : place + 12]) for place in self.first.values()]
        link = bytes(self.data[self.link_at : self.link_at + 4])
        new = sorted([*old, _entry(self.order, tag, 3, value)], key=lambda e: struct.unpack(self.order + "H", e[:2]))
        struct.pack_into(self.order + "I", self.data, self.start + 4, self.end())
        self.data += struct.pack(self.order + "H", len(new)) + b"".join(new) + link

    def wipe_thumbnail(self) -> None:
        """Zeroes the thumbnail and the link to its directory."""
        entries = self.entries(self.second_at)
        if _THUMBNAIL in entries and _THUMBNAIL_LENGTH in entries:
            at = self._place(entries[_THUMBNAIL] + 8)
            (length,) = struct.unpack_from(self.order + "I", self.data, entries[_THUMBNAIL_LENGTH] + 8)
            length = min(length, len(self.data) - at)
            if at > self.start + 8:
                self.data[at : at + length] = bytes(length)
        self.data[self.link_at : self.link_at + 4] = bytes(4)
        self.second_at = 0


# ---- XMP -----------------------------------------------------------------------------------------------


def xmp_for(xmp: bytes, height: int, width: int, orientation: int) -> bytes:
    """XMP whose sizes and orientation, where it has them, are those of the picture."""
    for names, value in (
        (b"exif:PixelXDimension|tiff:ImageWidth", width),
        (b"exif:PixelYDimension|tiff:ImageLength", height),
        (b"tiff:Orientation", orientation),
    ):
        told = b"\\g<1>%d" % value
        xmp = re.sub(rb"(<(?:%s)\s*>\s*)\d+" % names, told, xmp)
        xmp = re.sub(rb"""((?:%s)\s*=\s*["'])\d+""" % names, told, xmp)
    return xmp


def xmp_without_pictures(xmp: bytes) -> bytes:
    """XMP without embedded thumbnails, and without the link to more XMP that a JPEG may have elsewhere."""
    xmp = re.sub(rb"<(xmp|xap):Thumbnails\b.*?</\1:Thumbnails\s*>", b"", xmp, flags=re.DOTALL)
    return re.sub(rb"""\s+xmpNote:HasExtendedXMP\s*=\s*(["'])[^"']*\1""", b"", xmp)
