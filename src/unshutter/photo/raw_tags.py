"""Where the makers of cameras put EXIF in their raw files.

Most raw files are TIFFs, some of them under another magic number. Fuji's holds a JPEG that has EXIF, Canon's newest
is a box file like HEIC with a TIFF for each directory. Of other kinds no tags are read.

Source: the public descriptions of these formats by exiftool.org and github.com/lclevy/canon_cr3 (facts only).
"""

from __future__ import annotations

import io
import struct
from typing import BinaryIO

from unshutter.photo import containers, metadata
from unshutter.photo.metadata import EXIF, GPS, Directory, Tree

_OTHER_MAGIC = (b"IIRO", b"IIRS", b"MMOR", b"IIU\0")  # Olympus, Panasonic
_MAGIC = {b"II": b"II*\0", b"MM": b"MM\0*"}
_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")


def read_tags(file: BinaryIO) -> Tree | None:
    """The directories of a raw file; None where there are none that can be read."""
    file.seek(0)
    head = file.read(96)
    if head[:4] in _OTHER_MAGIC:
        file.seek(4)
        return metadata.read_tree(io.BytesIO(_MAGIC[head[:2]] + file.read()))
    if head.startswith(b"FUJIFILM") and len(head) == 96:
        start, length = struct.unpack_from(">II", head, 84)
        file.seek(start)
        return metadata.read_exif(containers.jpeg_exif(io.BytesIO(file.read(length))))
    if head[4:12] == b"ftypcrx ":
        return _canon(file)
    return metadata.read_tree(file)


def _canon(file: BinaryIO) -> Tree | None:
    """One tree of the three that a CR3 has for its first directory, EXIF and GPS; the maker's note stays behind."""
    try:
        boxes = dict(containers.boxes(containers.top_level_box(file, b"moov")))
    except KeyError:
        return None
    own = boxes.get(b"uuid", b"")
    parts = dict(containers.boxes(own[16:])) if own.startswith(_CANON) else {}
    first, exif, gps = (metadata.read_tree(io.BytesIO(parts.get(name, b""))) for name in (b"CMT1", b"CMT2", b"CMT4"))
    if first is None:
        return None
    more: Directory = {
        tag: tree.pages[0] for tag, tree in ((EXIF, exif), (GPS, gps)) if tree is not None and tree.order == first.order
    }
    return Tree(first.order, [first.pages[0] | more])
