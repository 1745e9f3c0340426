"""Makers' notes as cameras write them, put together by hand, and photos with them."""

import struct

from PIL import Image

from support.drawn_photos import drawn, encoded
from support.tagged_files import EXIF
from unshutter.photo import Photo


def directory(order: str, at: int, *tags: tuple[int, int, bytes]) -> bytes:
    """A directory of (tag, TIFF type, bytes) that stands at a place; longer values follow it."""
    sizes = {2: 1, 3: 2, 7: 1, 8: 2, 9: 4, 10: 8, 13: 4}
    table, values = struct.pack(order + "H", len(tags)), b""
    for tag, kind, data in tags:
        table += struct.pack(order + "HHI", tag, kind, len(data) // sizes[kind])
        if len(data) <= 4:
            table += data.ljust(4, b"\0")
        else:
            table += struct.pack(order + "I", at + 2 + 12 * len(tags) + 4 + len(values))
            values += data
    return table + bytes(4) + values


def apple(vector: tuple[float, float, float]) -> bytes:
    """A note of Apple's with an acceleration [g] in the frame of the phone."""
    parts = b"".join(struct.pack(">ii", round(part * 1_000_000), 1_000_000) for part in vector)
    return b"Apple iOS\0\0\1MM" + directory(">", 14, (0x0008, 10, parts))


def exif_with_note(note: bytes, make: str, orientation: int = 1, lens: str = "", order: str = "<") -> bytes:
    """EXIF with a maker's note."""
    tags = Image.Exif()
    tags.endian = order
    tags.update({0x010F: make, 0x0112: orientation})
    tags.get_ifd(EXIF).update({0x927C: note} | ({0xA434: lens} if lens else {}))
    return tags.tobytes()


def photo_with_note(
    note: bytes, make: str, orientation: int = 1, lens: str = "", height: int = 120, width: int = 160
) -> Photo:
    """A photo whose EXIF has a maker's note."""
    exif = exif_with_note(note, make, orientation, lens)
    return Photo.from_bytes(encoded(drawn(height, width), "JPEG", exif=exif))
