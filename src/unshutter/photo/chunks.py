"""The pieces that PNG, JPEG and Photoshop's metadata consist of: chunks, segments and image resources.

libvips truncates the image resources of a TIFF, which include IPTC, to a quarter when writing them. Therefore
``Metadata.resources`` stores them as in a JPEG, and each format writes them itself, TIFF by :func:`resource_tags`.

Source: W3C, PNG third edition, sections 5 (structure, naming conventions) and 14 (treatment of unknown chunks by
editors); ITU-T T.81, annex B (segments); Adobe, Photoshop File Formats (image resource blocks); TIFF tags 33723 (IPTC)
and 34377 (Photoshop).
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from typing import BinaryIO, NamedTuple

from unshutter.photo.directories import EXIF_PREFIX, Entry, Tree

_PIECE = 1 << 20  # bytes read at once, because pictures may be larger than memory

# ---- files ---------------------------------------------------------------------------------------------


def remove(file: BinaryIO, start: int, end: int) -> None:
    """Removes bytes in the middle of a finished file."""
    while file.seek(end) and (piece := file.read(_PIECE)):
        file.seek(start)
        file.write(piece)
        start = start + len(piece)
        end = end + len(piece)
    file.truncate(start)


def insert(file: BinaryIO, at: int, data: bytes) -> None:
    """Inserts bytes, moving the data after them in pieces from the end."""
    end = file.seek(0, io.SEEK_END)
    while end > at:
        start = max(at, end - _PIECE)
        file.seek(start)
        piece = file.read(end - start)
        file.seek(start + len(data))
        file.write(piece)
        end = start
    file.seek(at)
    file.write(data)


# ---- chunks of PNG -------------------------------------------------------------------------------------

SIGNATURE_BYTES = 8
TEXTS = frozenset({b"tEXt", b"zTXt", b"iTXt"})
COLOURS = frozenset({b"gAMA", b"cHRM", b"sRGB", b"cICP", b"mDCV", b"cLLI"})
_USUAL_GAMMA = struct.pack(">I", 45455)
_USUAL_PRIMARIES = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
_LARGEST = 1 << 26  # most data of a chunk [bytes]
_MOST = 10_000  # most chunks
_LOWER = 0x20  # the bit that distinguishes lower-case from upper-case letters


class Chunk(NamedTuple):
    """A chunk's name and data; ``data`` is None if they are damaged, or too long for a photo's metadata."""

    name: bytes
    data: bytes | None
    size: int  # of the whole chunk [bytes]


def is_safe_to_copy(name: bytes) -> bool:
    """Whether a chunk's data remain valid for other pixels, according to the case of letters in its name."""
    return bool(name[0] & _LOWER and name[3] & _LOWER)


def chunks_of(file: BinaryIO, skipped: Collection[bytes]) -> Iterator[Chunk]:
    """Yields all chunks of a PNG, including those after the pixels, except for names to skip."""
    file.seek(SIGNATURE_BYTES)
    count = 0
    left = 1 << 27  # most data of all chunks [bytes]
    while len(head := file.read(8)) == 8 and head[4:] != b"IEND":
        length, name = struct.unpack(">I4s", head)
        if name in skipped:
            file.seek(length + 4, 1)
            continue
        count += 1
        if length > min(_LARGEST, left) or count > _MOST:
            file.seek(length + 4, 1)
            yield Chunk(name, None, length + 12)
            continue
        left -= length
        data = file.read(length)
        checksum = file.read(4)
        yield Chunk(name, data if checksum == struct.pack(">I", zlib.crc32(name + data)) else None, length + 12)


def bytes_behind_chunks(file: BinaryIO) -> int:
    """Counts the bytes after the last chunk of a PNG, without fill; to be called after :func:`chunks_of`."""
    return len(file.read(_LARGEST)[4:].strip(b"\0\r\n"))  # after a checksum


def encoded_chunk(name: bytes, data: bytes) -> bytes:
    """Encodes a chunk."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def extent_of(file: BinaryIO, name: bytes) -> tuple[int, int] | None:
    """Returns the start and end of a chunk before the pixels; None if there is none."""
    extents = ((at, at + 12 + length) for at, found, length in heads_before_pixels(file) if found == name)
    return next(extents, None)


def heads_before_pixels(file: BinaryIO) -> Iterator[tuple[int, bytes, int]]:
    """Yields the start, name and length of the data of each chunk before the pixels; the file may be moved."""
    at = SIGNATURE_BYTES
    file.seek(at)
    while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
        length, name = struct.unpack(">I4s", head)
        yield at, name, length
        at += 12 + length
        file.seek(at)


def are_usual(colours: Mapping[bytes, bytes]) -> bool:
    """Whether the chunks of a PNG say that its colours are sRGB's."""
    return b"sRGB" in colours or (
        colours.get(b"gAMA", _USUAL_GAMMA) == _USUAL_GAMMA
        and colours.get(b"cHRM", _USUAL_PRIMARIES) == _USUAL_PRIMARIES
    )


# ---- segments of JPEG ----------------------------------------------------------------------------------

# markers; application segments identify their content by their first bytes
END = 0xD9
SCAN = 0xDA
APP0 = 0xE0
APP1 = 0xE1
APP2 = 0xE2
APP11 = 0xEB
APP13 = 0xED
APP14 = 0xEE
COMMENT = 0xFE
LONGEST = 65_533  # bytes of content
XMP_PREFIX = b"http://ns.adobe.com/xap/1.0/\0"
_IN_A_SCAN = re.compile(rb"\xff[\x02-\xcf\xd8-\xfe]")  # a marker that ends coded data, unlike restart markers
_FILL = b"\0\xff \r\n\t"


def before_the_scan(file: BinaryIO, markers: Collection[int] | None = None, at: int = 0) -> Iterator[tuple[int, bytes]]:
    """Yields (marker, content) of the segments before the first scan that have one of the markers, by default all.

    The picture begins at a position in the file.
    """
    file.seek(at + 2)
    while (marker := _marker(file)) not in (None, SCAN):
        size = file.read(2)
        length = int.from_bytes(size, "big")
        if len(size) < 2 or length < 2:
            return
        if markers is None or marker in markers:
            yield marker, file.read(length - 2)
        else:
            file.seek(length - 2, 1)


def _marker(file: BinaryIO) -> int | None:
    """Reads the next marker, which 0xFF and, to decoders, any other bytes may precede; None if there is none."""
    before = b""
    for _ in range(1 << 16):  # bytes that fill
        byte = file.read(1)
        if not byte or (before == b"\xff" and byte not in b"\0\xff"):
            return byte[0] if byte else None
        before = byte
    return None


def picture_end(file: BinaryIO, at: int = 0) -> int | None:
    """Returns where the picture that begins at a position ends; None if nothing tells."""
    for _ in before_the_scan(file, (), at):
        pass
    while (marker := _after_segment(file)) not in (None, END):
        pass
    return None if marker is None else file.tell()


def pieces_behind(file: BinaryIO, end: int) -> Iterator[tuple[int, int]]:
    """Yields start and length of what follows the picture before ``end``: each picture, and then all the rest.

    Fill is skipped; nothing is yielded after 64 MB of it, or if the picture has no end.
    """
    at = picture_end(file)
    for _ in range(64):  # pieces
        if at is None or at >= end:
            return
        file.seek(at)
        piece = file.read(min(_PIECE, end - at))
        fill = len(piece) - len(piece.lstrip(_FILL))
        if fill < len(piece) and piece[fill - 1 : fill + 2] == b"\xff\xd8\xff":
            fill -= 1
        at += fill
        if fill == len(piece):
            continue
        stop = picture_end(file, at) if piece[fill : fill + 3] == b"\xff\xd8\xff" else None
        stop = min(stop or end, end)
        yield at, stop - at
        at = stop


def _after_segment(file: BinaryIO) -> int | None:
    """Skips a segment whose marker was read, and coded data after it; reads and returns the next marker."""
    size = file.read(2)
    if len(size) < 2:
        return None
    at = file.tell() + int.from_bytes(size, "big") - 2
    file.seek(at)
    while len(piece := file.read(_PIECE)) > 1:
        match = _IN_A_SCAN.search(piece)
        if match is not None:
            file.seek(at + match.end())
            return piece[match.end() - 1]
        at += len(piece) - 1  # a marker may be split between two pieces
        file.seek(at)
    return None


def encoded_segment(marker: int, content: bytes) -> bytes:
    """Encodes a segment."""
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def exif_of(file: BinaryIO) -> bytes | None:
    """Returns the EXIF blob of a JPEG; None if there is none."""
    return next((content for _, content in before_the_scan(file, (APP1,)) if content.startswith(EXIF_PREFIX)), None)


# ---- Photoshop's image resources -----------------------------------------------------------------------

IPTC_TAG = 33723
RESOURCES_TAG = 34377
RESOURCES_PREFIX = b"Photoshop 3.0\0"
_IPTC = 1028


def resources_of_tiff(tree: Tree) -> bytes | None:
    """Returns the resources of a TIFF's first page in the form used in JPEG; None if it has none."""
    blocks = tree.data(RESOURCES_TAG) or b""
    iptc = tree.data(IPTC_TAG)
    if iptc and not any(kind == _IPTC for kind, _, _ in resource_blocks(blocks)):
        blocks = _iptc_block(iptc) + blocks
    return RESOURCES_PREFIX + blocks if blocks else None


def resources_of_blocks(blocks: bytes) -> bytes:
    """Converts blocks without a prefix, or bare IPTC, to resources in the form used in JPEG."""
    return RESOURCES_PREFIX + (blocks if blocks.startswith(b"8BIM") else _iptc_block(blocks))


def _iptc_block(iptc: bytes) -> bytes:
    return b"8BIM" + struct.pack(">HHI", _IPTC, 0, len(iptc)) + iptc + bytes(len(iptc) % 2)


def resource_tags(resources: bytes | None) -> dict[int, Entry]:
    """Returns the TIFF tags for resources; empty without resources."""
    blocks = (resources or b"").removeprefix(RESOURCES_PREFIX)
    tags = {RESOURCES_TAG: Entry(7, len(blocks), blocks)} if blocks else {}
    iptc = next((data for kind, data, _ in resource_blocks(blocks) if kind == _IPTC), None)
    return tags | ({IPTC_TAG: Entry(7, len(iptc), iptc)} if iptc else {})


def split_resources(resources: bytes | None) -> list[bytes]:
    """Splits resources into contents of JPEG segments; empty without resources."""
    blocks = (resources or b"").removeprefix(RESOURCES_PREFIX)
    room = LONGEST - len(RESOURCES_PREFIX)
    return [RESOURCES_PREFIX + blocks[at : at + room] for at in range(0, len(blocks), room)]


def has_iptc(resources: bytes) -> bool:
    """Whether the resources contain IPTC."""
    return any(kind == _IPTC for kind, _, _ in resource_blocks(resources.removeprefix(RESOURCES_PREFIX)))


def without_thumbnails(resources: bytes) -> bytes:
    """Removes thumbnails from resources; anything unreadable is left unchanged."""
    prefix = RESOURCES_PREFIX if resources.startswith(RESOURCES_PREFIX) else b""
    blocks = resources.removeprefix(prefix)
    kept = []
    end = 0
    for kind, _, block in resource_blocks(blocks):
        end += len(block)
        kept += [] if kind in (1033, 1036) else [block]  # thumbnails
    return prefix + b"".join(kept) + blocks[end:]


def resource_blocks(blocks: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Yields (kind, content, whole block) of each resource, as far as they can be read."""
    at = 0
    while blocks[at : at + 4] == b"8BIM" and len(blocks) >= at + 12:
        name = blocks[at + 6] + 1
        size_at = at + 6 + name + name % 2
        if len(blocks) < size_at + 4:
            return
        kind = struct.unpack_from(">H", blocks, at + 4)[0]
        size = struct.unpack_from(">I", blocks, size_at)[0]
        end = size_at + 4 + size + size % 2
        yield kind, blocks[size_at + 4 : size_at + 4 + size], blocks[at:end]
        at = end
