"""Items of a box file (AVIF, HEIC): its pictures and metadata, and their positions.

Results contain only the primary picture and its metadata. Everything else (maps, mattes, further pictures, films) is
only reported by name: maps and mattes fit only the old pixels, and nothing here can write the rest.

Source: ISO/IEC 14496-12 (boxes iinf, iloc), ISO/IEC 23008-12 (HEIF: items, references, auxiliary images), ISO 21496-1
(gain maps).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from unshutter.photo.containers import boxes

_MOST_ITEMS = 10_000
_ALPHA = (":auxid:1", ":auxiliary:alpha")  # endings of the types of auxiliary pictures
_DEPTH = (":auxid:2", ":auxiliary:depth")
_METADATA = {b"Exif": "a second EXIF", b"mime": "a second XMP"}  # names for further items of these kinds
_XMP = b"application/rdf+xml"
_FILMS = (b"moov", b"mpvd")
_STRUCTURE = frozenset({b"ftyp", b"meta", b"mdat", b"free", b"skip", b"wide"})
_LONGEST_NAME = 40


class _Item(NamedTuple):
    """An item: its kind, whether viewers should hide it, and the content type if its kind is ``mime``."""

    kind: bytes
    hidden: bool
    content_type: bytes


class _Reference(NamedTuple):
    """A reference from one item to others, of a certain kind."""

    kind: bytes
    item: int
    to: tuple[int, ...]


def extras_in_words(file: BinaryIO) -> tuple[str, ...]:
    """Names additional content of the file; empty if the file is damaged."""
    try:
        meta = dict(boxes.inside(boxes.top_level(file, b"meta")[4:]))
        names = [*_of_items(meta), *_of_boxes(file)]
    except (KeyError, IndexError, struct.error):
        return ()
    return tuple(dict.fromkeys(names))


def _of_boxes(file: BinaryIO) -> Iterator[str]:
    for name, _, _ in boxes.top_level_extents(file):
        if name in _FILMS:
            yield "film"
        elif name not in _STRUCTURE:
            yield f"data of other programs (box {_printable(name)})"


def _of_items(meta: dict[bytes, bytes]) -> Iterator[str]:
    items, references = _items(meta[b"iinf"]), _references(meta.get(b"iref", bytes(4)))
    (primary,) = struct.unpack_from(">I" if meta[b"pitm"][0] else ">H", meta[b"pitm"], 4)
    auxiliary = {one.item: one.to for one in references if one.kind == b"auxl"}
    described = {one.item: one.to for one in references if one.kind == b"cdsc"}
    maps = {number for number, item in items.items() if item.kind == b"tmap"}
    parts = _parts(primary, references)
    for one in references:
        if one.kind in (b"thmb", b"auxl"):
            parts |= _parts(one.item, references)
        elif one.kind == b"dimg" and one.item in maps:
            parts |= _parts(one.item, references) - {one.item}
    descriptions = {
        number: item.kind
        for number, item in items.items()
        if _is_metadata(item) and primary in described.get(number, (primary,))
    }
    for kind, name in _METADATA.items():
        if list(descriptions.values()).count(kind) > 1:
            yield name
    for number, item in items.items():
        if primary in auxiliary.get(number, ()):
            yield from _auxiliary_in_words(meta, number)
        elif not _is_metadata(item) and number not in parts:
            yield from _item_in_words(item)


def _is_metadata(item: _Item) -> bool:
    return item.kind in _METADATA and (item.kind != b"mime" or item.content_type == _XMP)


def _item_in_words(item: _Item) -> Iterator[str]:
    """Names an item that is neither part of the primary picture nor a thumbnail; nothing for hidden pictures."""
    if item.kind == b"tmap":
        yield "gain map"
    elif item.kind == b"iptc":
        yield "IPTC"
    elif item.kind in (b"mime", b"uri "):
        yield f"data of other programs ({_printable(item.content_type) or 'uri'})"
    elif not item.hidden:
        yield "further pictures"


def _parts(item: int, references: list[_Reference]) -> set[int]:
    """Returns an item and those that it is composed of."""
    components = {one.item: one.to for one in references if one.kind == b"dimg"}
    parts, waiting = set(), [item]
    while waiting:
        number = waiting.pop()
        if number not in parts:
            parts.add(number)
            waiting.extend(components.get(number, ()))
    return parts


def _auxiliary_in_words(meta: dict[bytes, bytes], item: int) -> Iterator[str]:
    """Names an auxiliary picture by its property auxC; nothing for transparency, which results keep."""
    own = dict(boxes.properties(meta, item))
    kind = own.get(b"auxC", b"")[4:].partition(b"\0")[0].decode(errors="replace").lower()
    if kind.endswith(_DEPTH):
        yield "depth map"
    elif "gainmap" in kind:
        yield "gain map"
    elif kind.endswith("matte"):
        yield "mattes"
    elif not kind.endswith(_ALPHA):
        name = _printable(kind.rpartition(":")[2].encode())
        yield f"auxiliary picture ({name})" if name else "auxiliary picture"


def _items(iinf: bytes) -> dict[int, _Item]:
    items: dict[int, _Item] = {}
    for name, data in boxes.inside(iinf[6 if iinf[0] == 0 else 8 :]):
        if name != b"infe" or data[0] < 2 or len(items) >= _MOST_ITEMS:
            continue
        (number,), at = struct.unpack_from(">H" if data[0] == 2 else ">I", data, 4), 8 if data[0] == 2 else 10
        _, _, texts = data[at + 4 :].partition(b"\0")
        items[number] = _Item(data[at : at + 4], bool(data[3] & 1), texts.partition(b"\0")[0])
    return items


def _references(iref: bytes) -> list[_Reference]:
    form = "I" if iref[0] else "H"
    size, references = struct.calcsize(form), []
    for kind, data in boxes.inside(iref[4:]):
        number, count = struct.unpack_from(f">{form}H", data)
        references.append(_Reference(kind, number, struct.unpack_from(f">{count}{form}", data, size + 2)))
        if len(references) >= _MOST_ITEMS:
            break
    return references


def _printable(name: bytes) -> str:
    return "".join(chr(byte) for byte in name[:_LONGEST_NAME] if 32 < byte < 127)


# ---- positions -----------------------------------------------------------------------------------------


def extent(file: BinaryIO, kind: bytes) -> tuple[int, int] | None:
    """Returns (first byte, length) of the first item of a kind; None if there is none, or it is fragmented."""
    try:
        meta = dict(boxes.inside(boxes.top_level(file, b"meta")[4:]))
        iinf, iloc = meta[b"iinf"], meta[b"iloc"]
        entries = [data for name, data in boxes.inside(iinf[6 if iinf[0] == 0 else 8 :]) if name == b"infe"]
        return _extent_of(iloc, next(number for number, own in map(_number_and_kind, entries) if own == kind))
    except (KeyError, IndexError, StopIteration, struct.error):
        return None


def _number_and_kind(data: bytes) -> tuple[int, bytes]:
    """Parses (number, kind) of an item."""
    if data[0] < 3:
        return struct.unpack_from(">H", data, 4)[0], data[8:12]
    return struct.unpack_from(">I", data, 4)[0], data[10:14]


def _extent_of(iloc: bytes, item: int) -> tuple[int, int] | None:
    """Finds (first byte, length) of an item in the box iloc; raises IndexError if that is damaged."""
    version, sizes, more_sizes = iloc[0], iloc[4], iloc[5]
    stream = io.BytesIO(iloc[6:])

    def number(size: int) -> int:
        data = stream.read(size)
        if len(data) < size:
            raise IndexError
        return int.from_bytes(data, "big")

    for _ in range(min(number(4 if version == 2 else 2), _MOST_ITEMS)):
        own = number(4 if version == 2 else 2)
        in_file = version == 0 or number(2) & 15 == 0  # otherwise relative to another box
        number(2)  # number of the file that contains it: this one
        base, pieces = number(more_sizes >> 4), number(2)
        for _ in range(pieces):
            number(more_sizes & 15 if version else 0)
            offset, length = number(sizes >> 4), number(sizes & 15)
            if own == item:
                return (base + offset, length) if in_file and pieces == 1 else None
    return None
