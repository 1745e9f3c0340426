"""EXIF as the tree of TIFF directories it is: read from blobs and TIFF files, written into TIFF files.

libvips carries EXIF through JPEG, PNG, WebP and AVIF, but neither reads it from a TIFF file nor writes it to
one. This file takes that step: :func:`exif_of_tiff` lifts camera tags, EXIF and GPS out of a TIFF as the blob
that all other formats use, :func:`add_exif_to_tiff` puts such a blob into a finished TIFF.

Source: TIFF 6.0; CIPA DC-008 (EXIF 2.32), sections 4.5 and 4.6.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import BinaryIO, NamedTuple, TypeAlias

# Directories that hang on a tag of another one: EXIF, GPS, interoperability.
SUB_DIRECTORIES = frozenset({0x8769, 0x8825, 0xA005})
# What a TIFF's first directory says about the photo rather than about the storage of its pixels: description, make,
# model, software, date, artist, ratings, copyright, titles of Windows, print matching.
CAMERA_TAGS = frozenset(
    {0x010E, 0x010F, 0x0110, 0x0131, 0x0132, 0x013B, 0x4746, 0x4749, 0x8298, *range(0x9C9B, 0x9CA0), 0xC4A5}
)
EXIF, GPS, PIXEL_WIDTH, PIXEL_HEIGHT, FOCAL_35MM = 0x8769, 0x8825, 0xA002, 0xA003, 0xA405
SUBFILE_TYPE, COMPRESSION, XMP, DNG_VERSION = 0x00FE, 0x0103, 0x02BC, 0xC612
_MAKER_NOTE = 0x927C
LONGEST_IN_JPEG = 65_533  # bytes, with the prefix
_FULL_FRAME_DIAGONAL_MM = math.hypot(36, 24)

# Bytes of one value, and of the units in it that byte order turns, by TIFF type (1 BYTE ... 13 IFD).
_SIZE = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_UNIT = {**_SIZE, 5: 4, 10: 4}
_PREFIX = b"Exif\0\0"
# No photo has more; a damaged or malicious file may claim it.
_MAX_TREE_BYTES = 1 << 28
_MAX_PAGES = 1000


class Entry(NamedTuple):
    """One tag's value: TIFF type, number of values, their bytes in the byte order of the tree."""

    kind: int
    count: int
    data: bytes


Directory: TypeAlias = "dict[int, Entry | Directory]"


@dataclass(frozen=True)
class Tree:
    """Directories of one TIFF structure.

    Attributes:
        order: ``<`` (II) or ``>`` (MM), as for struct.
        pages: the chain of top-level directories; EXIF, GPS and interoperability nested in their tags.
    """

    order: str
    pages: list[Directory]

    def number(self, tag: int, *path: int, page: int = 0) -> int | None:
        """First value of a BYTE, SHORT or LONG tag in a page (below the sub-directories ``path``), None if absent."""
        directory: Directory | Entry | None = self.pages[page]
        for step in (*path, tag):
            directory = directory.get(step) if isinstance(directory, dict) else None
        if not isinstance(directory, Entry) or directory.kind not in (1, 3, 4):
            return None
        return struct.unpack_from(self.order + {1: "B", 3: "H", 4: "I"}[directory.kind], directory.data)[0]

    def data(self, tag: int) -> bytes | None:
        """Bytes of a tag in the first page, None if absent."""
        entry = self.pages[0].get(tag)
        return entry.data if isinstance(entry, Entry) else None


# ---- reading -------------------------------------------------------------------------------------------


def read_tree(file: BinaryIO) -> Tree | None:
    """Reads classic TIFF directories; entries that point nowhere are left out.

    Args:
        file: seekable, a TIFF file or the TIFF part of an EXIF blob.

    Returns:
        None when this is no classic TIFF (BigTIFF, damaged header).
    """
    file.seek(0)
    head = file.read(8)
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(head[:4])
    if order is None or len(head) < 8:
        return None
    reader = _Reader(file, order)
    pages: list[Directory] = []
    (offset,) = struct.unpack_from(order + "I", head, 4)
    while offset and len(pages) < _MAX_PAGES and (found := reader.directory(offset)) is not None:
        pages.append(found[0])
        offset = found[1]
    return Tree(order, pages) if pages else None


def read_exif(blob: bytes | None) -> Tree | None:
    """:func:`read_tree` of an EXIF blob, with or without its ``Exif`` prefix; None passes through."""
    return None if blob is None else read_tree(io.BytesIO(blob.removeprefix(_PREFIX)))


class _Reader:
    def __init__(self, file: BinaryIO, order: str) -> None:
        self.file, self.order, self.bytes_left = file, order, _MAX_TREE_BYTES

    def directory(self, offset: int, depth: int = 0) -> tuple[Directory, int] | None:
        """(directory, offset of the next one), or None where the file ends first."""
        self.file.seek(offset)
        try:
            (count,) = struct.unpack(self.order + "H", self.file.read(2))
            raw = self.file.read(12 * count + 4)
            (following,) = struct.unpack_from(self.order + "I", raw, 12 * count)
        except struct.error:
            return None
        self.bytes_left -= len(raw)
        directory: Directory = {}
        for at in range(0, 12 * count, 12):
            (tag,) = struct.unpack_from(self.order + "H", raw, at)
            value = self._entry(raw[at : at + 12], tag in SUB_DIRECTORIES, depth)
            if value is not None:
                directory[tag] = value
        return directory, following

    def _entry(self, raw: bytes, is_directory: bool, depth: int) -> Entry | Directory | None:
        kind, count, pointer = struct.unpack_from(self.order + "HII", raw, 2)
        size = _SIZE.get(kind, 0) * count
        if not 0 < size <= self.bytes_left:
            return None
        if is_directory:
            found = self.directory(pointer, depth + 1) if depth < 2 else None
            return found[0] if found else None
        data = raw[8 : 8 + size]
        if size > 4:
            self.file.seek(pointer)
            data = self.file.read(size)
        self.bytes_left -= len(data)
        return Entry(kind, count, data) if len(data) == size else None


def exif_of_tiff(tree: Tree) -> bytes | None:
    """EXIF blob of a TIFF file's first page: camera tags, EXIF, GPS; None when it has none of them.

    The byte order stays: makers' notes are often in the order of the file they stand in.
    """
    first = tree.pages[0]
    lifted = {tag: value for tag, value in first.items() if tag in CAMERA_TAGS or tag in SUB_DIRECTORIES}
    if not lifted:
        return None
    head = struct.pack(tree.order + "2sHI", b"II" if tree.order == "<" else b"MM", 42, 8)
    return _PREFIX + head + _encode(lifted, 8, tree.order)


def focal_px(exif: bytes | None, height: int, width: int) -> float | None:
    """Focal length [px] from the 35 mm equivalent, which EXIF defines by the diagonal; None where unknown."""
    tree = read_exif(exif)
    focal_mm = tree.number(FOCAL_35MM, EXIF) if tree else None
    return focal_mm * math.hypot(height, width) / _FULL_FRAME_DIAGONAL_MM if focal_mm else None


def shortened(exif: bytes) -> bytes:
    """A blob that fits into a JPEG: if it is too long, without its maker's note, which may hold previews."""
    tree = read_exif(exif) if len(exif) > LONGEST_IN_JPEG else None
    if tree is None:
        return exif
    details = tree.pages[0].get(EXIF)
    if isinstance(details, dict):
        details.pop(_MAKER_NOTE, None)
    return exif_of_tiff(tree) or exif


# ---- writing -------------------------------------------------------------------------------------------


def add_exif_to_tiff(
    file: BinaryIO, exif: bytes | None, height: int, width: int, more: Mapping[int, Entry] = MappingProxyType({})
) -> None:
    """Adds camera tags, EXIF and GPS of a blob to a finished TIFF of one page, at its end.

    The page's own tags win over the blob's. The pixel size that EXIF repeats is set to that of the picture.
    Does nothing to a BigTIFF, a file too long for more, or with a blob that cannot be read.

    Args:
        file: seekable, open for reading and writing.
        exif: EXIF blob.
        height: of the picture [px].
        width: of the picture [px].
        more: tags of bytes, which stand in either order.
    """
    tree, target = read_exif(exif), read_tree(file)
    end = file.seek(0, io.SEEK_END)
    length = len(exif or b"") + sum(len(entry.data) for entry in more.values())
    if target is None or (tree is None and not more) or end + length + 65536 >= 1 << 32:
        return
    added: Directory = {}
    if tree is not None:
        added = {tag: value for tag, value in tree.pages[0].items() if tag in CAMERA_TAGS or tag in SUB_DIRECTORIES}
        added = added if tree.order == target.order else _swapped(added)
    details = added.get(EXIF)
    if isinstance(details, dict):
        for tag, size in ((PIXEL_WIDTH, width), (PIXEL_HEIGHT, height)):
            if tag in details:
                details[tag] = Entry(4, 1, struct.pack(target.order + "I", size))
    start = end + end % 2  # directories begin at even offsets
    file.seek(end)
    file.write(bytes(end % 2) + _encode(added | dict(more) | target.pages[0], start, target.order))
    file.seek(4)
    file.write(struct.pack(target.order + "I", start))


def _encode(directory: Directory, at: int, order: str) -> bytes:
    """Bytes of a directory that will stand at offset ``at``, followed by its values and sub-directories."""
    table = struct.pack(order + "H", len(directory))
    values, values_at = b"", at + 2 + 12 * len(directory) + 4
    for tag, entry in sorted(directory.items(), key=lambda item: item[0]):
        here = values_at + len(values)
        if isinstance(entry, dict):
            kind, count, data, inline = 4, 1, _encode(entry, here, order), False
        else:
            kind, count, data, inline = entry.kind, entry.count, entry.data, len(entry.data) <= 4
        table += struct.pack(order + "HHI", tag, kind, count)
        table += data.ljust(4, b"\0") if inline else struct.pack(order + "I", here)
        values += b"" if inline else data + bytes(len(data) % 2)
    return table + bytes(4) + values  # no further directory


def _swapped(directory: Directory) -> Directory:
    """The directory in the other byte order; opaque data (makers' notes) stays as it is."""
    turned: Directory = {}
    for tag, entry in directory.items():
        if isinstance(entry, dict):
            turned[tag] = _swapped(entry)
        else:
            unit = _UNIT[entry.kind]
            units = (entry.data[i : i + unit] for i in range(0, len(entry.data), unit))
            turned[tag] = Entry(entry.kind, entry.count, b"".join(u[::-1] for u in units))
    return turned
