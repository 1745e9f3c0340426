"""Boxes, of which AVIF and HEIC files and Canon's newest raw files are made.

Source: ISO/IEC 14496-12 (boxes), ISO/IEC 23008-12 (HEIF: items and their properties).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.photo.source import Source

if TYPE_CHECKING:
    import numpy as np

_ANIMATION = re.compile(rb"....ftyp(avis|hevc|hevx|msf1)", re.DOTALL)


# ---- boxes ---------------------------------------------------------------------------------------------


def top_level(file: BinaryIO, wanted: bytes) -> bytes:
    """Content of a box of the file itself; KeyError where there is none."""
    file.seek(0)
    while len(head := file.read(8)) == 8:
        size, name = struct.unpack(">I4s", head)
        if name == wanted:
            return file.read(size - 8)
        if size < 8:  # to the end of the file, or longer than 4 GiB: the pixels
            break
        file.seek(size - 8, 1)
    raise KeyError(wanted)


def inside(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(type, content) of the boxes in the content of another one."""
    at = 0
    while at + 8 <= len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        if size < 8:
            return
        yield name, data[at + 8 : at + size]
        at += size


def refuse_animation(source: Source) -> None:
    """Refuses a file whose type is that of a sequence of pictures.

    Raises:
        UnshutterError: it is one.
    """
    with source.stream() as stream:
        if _ANIMATION.match(stream.read(12)):
            raise UnshutterError(f"{source} is an animation: unshutter takes single photos")


# ---- properties of the primary picture -----------------------------------------------------------------


class BoxCoding(NamedTuple):
    """Coding of the primary picture of an AVIF or HEIC.

    Attributes:
        orientation: EXIF number of the turn and mirroring that decoders apply (boxes irot, imir).
        grey: no chroma at all.
        subsampled: chroma at half the resolution in both directions (4:2:0).
        code_points: primaries and transfer of the colours, (2, 2) where the file does not say.

    What ``grey`` and ``subsampled`` say holds for AVIF only.
    """

    orientation: int = 1
    grey: bool = False
    subsampled: bool = True
    code_points: tuple[int, int] = (2, 2)


# (quarter turns counter-clockwise, then mirror: None, 0 top-bottom, 1 left-right) -> EXIF orientation
_ORIENTATION = {
    **{(0, None): 1, (1, None): 8, (2, None): 3, (3, None): 6},
    **{(0, 0): 4, (1, 0): 5, (2, 0): 2, (3, 0): 7},
    **{(0, 1): 2, (1, 1): 7, (2, 1): 4, (3, 1): 5},
}


def read_coding(file: BinaryIO) -> BoxCoding:
    """Reads the properties of the primary picture (boxes pitm, ipco, ipma); defaults if damaged."""
    try:
        meta = dict(inside(top_level(file, b"meta")[4:]))
        pitm, iprp = meta[b"pitm"], dict(inside(meta[b"iprp"]))
        (primary,) = struct.unpack_from(">I" if pitm[0] else ">H", pitm, 4)
        properties = list(inside(iprp[b"ipco"]))
        listed = [properties[i - 1] for i in _associations(iprp[b"ipma"], primary) if i]
        own = dict(listed)
        colours = [
            struct.unpack_from(">HH", data, 4) for name, data in listed if (name, data[:4]) == (b"colr", b"nclx")
        ]
        turns = own[b"irot"][0] & 3 if b"irot" in own else 0
        mirror = own[b"imir"][0] & 1 if b"imir" in own else None
        if mirror is not None and list(own).index(b"imir") < [*own, b"irot"].index(b"irot"):
            turns = -turns & 3  # mirrored first, then turned
        coding = own[b"av1C"][2] if b"av1C" in own else 0x0C  # a picture made of tiles has it in the tiles
    except (KeyError, IndexError, struct.error):
        return BoxCoding()
    return BoxCoding(
        _ORIENTATION[turns, mirror],
        grey=bool(coding & 0x10),
        subsampled=coding & 0x0C == 0x0C,
        code_points=colours[0] if colours else (2, 2),
    )


def _associations(ipma: bytes, item: int) -> list[int]:
    """Numbers, from 1, of the properties that belong to an item."""
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


def unturned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """The stored pixels of a picture that its decoder has turned by its orientation."""
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels.swapaxes(0, 1) if orientation >= 5 else pixels
