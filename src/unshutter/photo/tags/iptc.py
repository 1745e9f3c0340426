"""IPTC in Photoshop's image resources: one block of them in JPEG, two tags in TIFF.

libvips truncates those of a TIFF to a quarter when writing them. Therefore ``Metadata.resources`` stores them as in a
JPEG, and each format writes them itself, TIFF by :func:`tiff_tags`.

Source: Adobe, Photoshop File Formats (image resource blocks); TIFF tags 33723 (IPTC) and 34377 (Photoshop).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from unshutter.photo.tags.directories import Entry, Tree

IPTC_TAG, RESOURCES_TAG = 33723, 34377
PREFIX = b"Photoshop 3.0\0"
_IPTC, _THUMBNAILS = 1028, (1033, 1036)


def of_tiff(tree: Tree) -> bytes | None:
    """Returns the resources of a TIFF's first page in the form used in JPEG; None if it has none."""
    blocks, iptc = tree.data(RESOURCES_TAG) or b"", tree.data(IPTC_TAG)
    if iptc and not any(kind == _IPTC for kind, _, _ in _blocks(blocks)):
        blocks = b"8BIM" + struct.pack(">HHI", _IPTC, 0, len(iptc)) + iptc + bytes(len(iptc) % 2) + blocks
    return PREFIX + blocks if blocks else None


def of_blocks(blocks: bytes) -> bytes:
    """Converts blocks without a prefix, or bare IPTC, to resources in the form used in JPEG."""
    if blocks.startswith(b"8BIM"):
        return PREFIX + blocks
    return PREFIX + b"8BIM" + struct.pack(">HHI", _IPTC, 0, len(blocks)) + blocks + bytes(len(blocks) % 2)


def tiff_tags(resources: bytes | None) -> dict[int, Entry]:
    """Returns the TIFF tags for resources; empty without resources."""
    blocks = (resources or b"").removeprefix(PREFIX)
    tags = {RESOURCES_TAG: Entry(7, len(blocks), blocks)} if blocks else {}
    iptc = next((data for kind, data, _ in _blocks(blocks) if kind == _IPTC), None)
    return tags | ({IPTC_TAG: Entry(7, len(iptc), iptc)} if iptc else {})


def joined(parts: list[bytes]) -> bytes:
    """Joins resources of a JPEG that are split into several segments, possibly within a block."""
    return PREFIX + b"".join(part.removeprefix(PREFIX) for part in parts)


def segments(resources: bytes | None, longest: int) -> list[bytes]:
    """Splits resources into contents of JPEG segments of limited length; empty without resources."""
    blocks, room = (resources or b"").removeprefix(PREFIX), longest - len(PREFIX)
    return [PREFIX + blocks[at : at + room] for at in range(0, len(blocks), room)]


def has_iptc(resources: bytes) -> bool:
    """Whether the resources contain IPTC."""
    return any(kind == _IPTC for kind, _, _ in _blocks(resources.removeprefix(PREFIX)))


def without_thumbnails(resources: bytes) -> bytes:
    """Removes thumbnails from resources; anything unreadable is left unchanged."""
    prefix = PREFIX if resources.startswith(PREFIX) else b""
    blocks = resources.removeprefix(prefix)
    kept, end = [], 0
    for kind, _, block in _blocks(blocks):
        end += len(block)
        kept += [] if kind in _THUMBNAILS else [block]
    return prefix + b"".join(kept) + blocks[end:]


def _blocks(blocks: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Yields (kind, content, whole block) of each resource, as far as they can be read."""
    at = 0
    while blocks[at : at + 4] == b"8BIM" and len(blocks) >= at + 12:
        name = blocks[at + 6] + 1
        size_at = at + 6 + name + name % 2
        if len(blocks) < size_at + 4:
            return
        kind, size = struct.unpack_from(">H", blocks, at + 4)[0], struct.unpack_from(">I", blocks, size_at)[0]
        end = size_at + 4 + size + size % 2
        yield kind, blocks[size_at + 4 : size_at + 4 + size], blocks[at:end]
        at = end
