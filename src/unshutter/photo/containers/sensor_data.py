"""Checks whether a raw file still contains all of its sensor's data.

LibRaw silently treats missing data as zeros: a truncated file becomes a picture that is black from some row on. A file
that is complete according to its own tables counts as complete. Any other is decoded a second time with extra bytes
after its end: values that differ were missing.

Source: TIFF 6.0 (strips, tiles); TIFF/EP, DNG 1.6 (sub-directories); ISO/IEC 14496-12 (boxes).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, BinaryIO

from unshutter.photo.containers import boxes
from unshutter.photo.tags.directories import Directory, Entry, Tree, read_tree

if TYPE_CHECKING:
    import numpy as np

_PHOTOMETRIC, _SUB_PICTURES = 0x0106, 0x014A
_TABLES = ((0x0111, 0x0117), (0x0144, 0x0145))  # starts and lengths of strips and tiles
_OF_SENSORS = ((32803,), (34892,))  # photometric interpretation: colour filter array, linear raw
_MOST_SUB_PICTURES = 64
_FUJI_TABLE = 84  # positions and lengths of the JPEG, the header and the data
_AFTER = b"\xa5" * 65_536  # unlike anything that a decoder substitutes for missing data


def is_whole(file: BinaryIO) -> bool | None:
    """Whether the file contains all data listed in its tables; None if there are no tables, or they may be wrong."""
    length = file.seek(0, io.SEEK_END)
    file.seek(0)
    head = file.read(_FUJI_TABLE + 24)
    if head[4:8] == b"ftyp":
        return max((end for _, _, end in boxes.top_level_extents(file)), default=0) <= length
    if head.startswith(b"FUJIFILM") and len(head) == _FUJI_TABLE + 24:
        places = struct.unpack_from(">6I", head, _FUJI_TABLE)
        return all(start + size <= length for start, size in zip(places[::2], places[1::2], strict=True))
    tree = read_tree(file)
    if tree is None:
        return None
    pictures = [*tree.pages, *_sub_pictures(file, tree)]
    if any(start >= length for picture in pictures if _is_sensors(picture, tree) for start, _ in _parts(picture, tree)):
        return False
    parts = [part for picture in pictures for part in _parts(picture, tree)]
    return True if parts and all(start + size <= length for start, size in parts) else None


def is_complete(data: bytes, pixels: np.ndarray, decode: Callable[[BinaryIO], np.ndarray | None]) -> bool:
    """Whether a decoder needed no data beyond the end of the file.

    Args:
        data: a raw file.
        pixels: sensor values decoded from it.
        decode: decodes another file; returns None for an unknown kind, and no values if decoding fails later.
    """
    import numpy as np

    if pixels.min() == pixels.max():  # no sensor is so free of noise: all its data are missing
        return False
    again = decode(io.BytesIO(data + _AFTER))  # None for kinds read from the end, which skip this check
    return again is None or np.array_equal(again, pixels)


def _sub_pictures(file: BinaryIO, tree: Tree) -> list[Directory]:
    """Returns the sub-directories of pages that are separate pictures."""
    offsets = [offset for page in tree.pages for offset in _numbers(page, _SUB_PICTURES, tree)]
    trees = (read_tree(file, most_pages=1, first_at=offset) for offset in offsets[:_MOST_SUB_PICTURES])
    return [tree.pages[0] for tree in trees if tree is not None]


def _is_sensors(picture: Directory, tree: Tree) -> bool:
    """Whether a picture is declared to be sensor data rather than a preview."""
    return _numbers(picture, _PHOTOMETRIC, tree)[:1] in _OF_SENSORS


def _parts(picture: Directory, tree: Tree) -> list[tuple[int, int]]:
    """Returns (start, length) of the strips and tiles of a picture."""
    tables = ((_numbers(picture, starts, tree), _numbers(picture, sizes, tree)) for starts, sizes in _TABLES)
    return [part for starts, sizes in tables for part in zip(starts, sizes, strict=False)]


def _numbers(directory: Directory, tag: int, tree: Tree) -> tuple[int, ...]:
    """Returns the values of a SHORT or LONG tag."""
    entry = directory.get(tag)
    if not isinstance(entry, Entry) or entry.kind not in (3, 4, 13):
        return ()
    return struct.unpack(f"{tree.order}{entry.count}{'H' if entry.kind == 3 else 'I'}", entry.data)
