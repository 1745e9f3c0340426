"""Compares a photo's file with its result: each piece of the file has a part in the inventory, whose fate is true."""

import struct
from collections.abc import Iterator

from unshutter.inventory import Fate, Part, left_out
from unshutter.options import Save
from unshutter.photo import Photo
from unshutter.photo.formats import WRITTEN
from unshutter.photo.saving import encode_with_parts

Piece = tuple[int, bytes]  # its length in the file, and what it says


def jpeg_pieces(data: bytes) -> Iterator[Piece]:
    """Yields the segments before the first scan."""
    at = start = 2
    while data[at + 1] != 0xDA:
        if data[at + 1] == 0xFF:  # fill
            at += 1
            continue
        end = at + 2 + struct.unpack_from(">H", data, at + 2)[0]
        yield end - start, data[at + 4 : end]
        at = start = end


def png_pieces(data: bytes) -> Iterator[Piece]:
    """Yields the chunks but those of the pixels."""
    at = 8
    while data[at + 4 : at + 8] != b"IEND":
        length, name = struct.unpack_from(">I4s", data, at)
        if name != b"IDAT":
            yield length + 12, data[at + 8 : at + 8 + length]
        at += length + 12


def webp_pieces(data: bytes) -> Iterator[Piece]:
    """Yields the chunks, with their fill."""
    at = 12
    end = 8 + struct.unpack_from("<I", data, 4)[0]
    while at + 8 <= end:
        (length,) = struct.unpack_from("<I", data, at + 4)
        whole = 8 + length + length % 2
        yield whole, data[at + 8 : at + 8 + length]
        at += whole


PIECES = {"jpeg": jpeg_pieces, "png": png_pieces, "webp": webp_pieces}


def inventory_of(data: bytes, form: str | None = None) -> tuple[bytes, list[Part]]:
    """Returns the result with new pixels in a format, by default the photo's own, and what became of the parts."""
    photo = Photo.from_bytes(data)
    changed = photo.with_pixels(photo.pixels.copy())
    return encode_with_parts(changed, WRITTEN[form or photo.format], Save())


def audit(data: bytes, form: str | None = None) -> list[str]:
    """Returns what the inventory of a JPEG, PNG or WebP does not account for, or wrongly."""
    own = Photo.from_bytes(data).format
    result, parts = inventory_of(data, form)
    complaints = []
    unclaimed = list(parts)
    for size, content in PIECES[own](data):
        is_there = content in result
        same = [part for part in unclaimed if part.size == size]
        # of several pieces of one length, one that is in the result is more likely to be the carried one
        wanted = (Fate.CARRIED, Fate.TRANSFORMED) if is_there else (Fate.LEFT_OUT, Fate.REPLACED, Fate.TRANSFORMED)
        part = next((part for part in same if part.fate in wanted), same[0] if same else None)
        if part is None:
            complaints.append(f"{size} bytes are not in the inventory: {content[:20]!r}")
            continue
        unclaimed.remove(part)
        if part.fate is Fate.CARRIED and not is_there and form in (None, own) and part.name != "colour profile":
            complaints.append(f"{part} is not carried: {content[:20]!r}")
    return complaints


def names(data: bytes, form: str | None = None) -> list[str]:
    """Names what a result lacks."""
    return left_out(inventory_of(data, form)[1])
