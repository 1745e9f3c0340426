"""Boxes, the building blocks of AVIF, HEIC and Canon's newest raw files.

Source: ISO/IEC 14496-12 (boxes), ISO/IEC 23008-12 (HEIF: items and their properties).
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Orientation
from unshutter.photo.source import Source

_HEAD, _LONG_HEAD = 8, 16  # bytes of size and type, and with a 64-bit size
_LONGEST_READ = 1 << 24  # bytes: headers of pictures take a few thousand
_MOST_BOXES = 10_000  # at the top level of a file: pictures have a handful
_ANIMATION = re.compile(rb"....ftyp(avis|hevc|hevx|msf1)", re.DOTALL)


# ---- boxes ---------------------------------------------------------------------------------------------


def top_level(file: BinaryIO, kind: bytes) -> bytes:
    """Returns the content of a top-level box, leaving the file just after it; raises KeyError if there is none."""
    for name, start, end in top_level_extents(file):
        if name == kind:
            file.seek(start)
            return file.read(min(end - start, _LONGEST_READ))
    raise KeyError(kind)


def top_level_extents(file: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
    """Yields (type, first byte of the content, byte after it) of the top-level boxes.

    The last one may claim to end beyond the end of the file.
    """
    length, at = file.seek(0, io.SEEK_END), 0
    for _ in range(_MOST_BOXES):
        file.seek(at)
        if at + _HEAD > length:
            return
        head, size, name = _head(file.read(_LONG_HEAD), length - at)
        if size < head:
            return
        yield name, at + head, at + size
        at += size


def inside(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yields (type, content) of the boxes inside the content of another box."""
    at = 0
    while at + _HEAD <= len(data):
        head, size, name = _head(data[at : at + _LONG_HEAD], len(data) - at)
        if size < head:
            return
        yield name, data[at + head : at + size]
        at += size


def _head(data: bytes, left: int) -> tuple[int, int, bytes]:
    """Parses the header of a box with at least 8 bytes into (bytes of the header, of the whole box, type).

    A size of 0 means everything that is ``left``, and 1 a 64-bit size after the type.
    """
    size, name = struct.unpack_from(">I4s", data)
    if size == 1 and len(data) >= _LONG_HEAD:
        return _LONG_HEAD, struct.unpack_from(">Q", data, _HEAD)[0], name
    return _HEAD, size or left, name


def refuse_animation(source: Source) -> None:
    """Rejects a file whose type is that of a sequence of pictures.

    Raises:
        UnshutterError: the file is a sequence.
    """
    with source.stream() as stream:
        if _ANIMATION.match(stream.read(12)):
            raise UnshutterError("{photo} is an animation: unshutter takes single photos", photo=source)


# ---- properties of the primary picture -----------------------------------------------------------------


class BoxCoding(NamedTuple):
    """Coding of the primary picture of an AVIF or HEIC.

    Attributes:
        orientation: transformation that decoders apply to the stored pixels (boxes irot, imir).
        grey: whether there is no chroma.
        subsampled: whether chroma has half the resolution in both directions (4:2:0).
        code_points: primaries and transfer function of the colours; (2, 2) if the file does not specify them.

    ``grey`` and ``subsampled`` are valid for AVIF only.
    """

    orientation: Orientation = Orientation.NORMAL
    grey: bool = False
    subsampled: bool = True
    code_points: tuple[int, int] = (2, 2)


_MIRRORS = (Orientation.FLIP_TOP_BOTTOM, Orientation.FLIP_LEFT_RIGHT)  # by the value in imir


def read_coding(file: BinaryIO) -> BoxCoding:
    """Reads the properties of the primary picture (boxes pitm, ipco, ipma); defaults if damaged."""
    try:
        meta = dict(inside(top_level(file, b"meta")[4:]))
        (primary,) = struct.unpack_from(">I" if meta[b"pitm"][0] else ">H", meta[b"pitm"], 4)
        listed = properties(meta, primary)
        own = dict(listed)
        colours = [
            struct.unpack_from(">HH", data, 4) for name, data in listed if (name, data[:4]) == (b"colr", b"nclx")
        ]
        orientation = _orientation(own)
        coding = own[b"av1C"][2] if b"av1C" in own else 0x0C  # for a picture made of tiles, it is in the tiles
    except (KeyError, IndexError, struct.error):
        return BoxCoding()
    return BoxCoding(
        orientation,
        grey=bool(coding & 0x10),
        subsampled=coding & 0x0C == 0x0C,
        code_points=colours[0] if colours else (2, 2),
    )


def _orientation(own: dict[bytes, bytes]) -> Orientation:
    """Combines the transformations among the properties of a picture, in their order."""
    orientation = Orientation.NORMAL
    for name, data in own.items():
        if name == b"irot":  # quarter turns, counter-clockwise
            orientation = orientation.then(Orientation.of_steps(-(data[0] & 3)))
        elif name == b"imir":
            orientation = orientation.then(_MIRRORS[data[0] & 1])
    return orientation


def properties(meta: dict[bytes, bytes], item: int) -> list[tuple[bytes, bytes]]:
    """Returns (type, content) of an item's properties; raises KeyError, IndexError or struct.error if damaged.

    Args:
        meta: contents of the boxes in ``meta``, by type.
        item: number of the item.
    """
    iprp = dict(inside(meta[b"iprp"]))
    listed = list(inside(iprp[b"ipco"]))
    return [listed[i - 1] for i in _associations(iprp[b"ipma"], item) if i]


def _associations(ipma: bytes, item: int) -> list[int]:
    """Returns the numbers, from 1, of the properties associated with an item."""
    version, wide_index = ipma[0], ipma[3] & 1
    (entries,) = struct.unpack_from(">I", ipma, 4)
    at = 8
    for _ in range(entries):
        (name,) = struct.unpack_from(">I" if version else ">H", ipma, at)
        at += 4 if version else 2
        count, at = ipma[at], at + 1
        form, mask = (">H", 0x7FFF) if wide_index else (">B", 0x7F)
        numbers = [struct.unpack_from(form, ipma, at + i * (1 + wide_index))[0] & mask for i in range(count)]
        if name == item:
            return numbers
        at += count * (1 + wide_index)
    return []
