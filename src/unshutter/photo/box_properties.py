"""Writes colours into an AVIF from libvips, as properties of its picture and in its coded data: libvips takes none.

Source: ISO/IEC 23008-12 (ipco, ipma), ISO/IEC 14496-12 (iloc), AV1 Bitstream & Decoding Process Specification
(sequence header).
"""

from __future__ import annotations

import struct
from typing import BinaryIO

from unshutter.photo import boxes, chunks
from unshutter.photo.code_points import CodePoints

_MATRIX = 6  # coefficients by which libheif codes colours: BT.601
_AS_CODED = 1 << 24 | 1 << 16 | 13 << 8 | _MATRIX  # that they are stated, and how libheif states them: as sRGB
_AS_CODED_BITS = 25
_NCLX = b"colrnclx"
_MOST_HEADER = 64  # bytes of coded data in which its header is looked for


def state_colours(file: BinaryIO, code_points: CodePoints) -> None:
    """States the colours of the primary picture of an AVIF that libheif wrote with sRGB's, and light levels."""
    _state_in_header(file, code_points)
    _, start, end = next(each for each in boxes.top_level_extents(file) if each[0] == b"meta")
    file.seek(start)
    meta = file.read(end - start)
    if _NCLX in meta:  # newer versions of libvips state sRGB
        at = meta.index(_NCLX) + len(_NCLX)
        meta = meta[:at] + struct.pack(">HH", code_points.primaries, code_points.transfer) + meta[at + 4 :]
    properties = code_points.light if _NCLX in meta else code_points.boxes(_MATRIX)
    added = b"".join(struct.pack(">I4s", 8 + len(content), name) + content for name, content in properties)
    ipma_at = meta.index(b"ipma") - 4
    first = sum(1 for _ in boxes.inside(meta[meta.index(b"ipco") + 4 : ipma_at])) + 1
    count_at = ipma_at + 18  # after the size, type and version, the number of items, and the first one's number
    own_end = count_at + 1 + meta[count_at]
    numbers = bytes(range(first, first + len(properties)))
    growth = len(added) + len(numbers)
    ipma = bytearray(meta[ipma_at:own_end] + numbers)
    ipma[count_at - ipma_at] += len(numbers)
    new = bytearray(meta[:ipma_at] + added + ipma + meta[own_end:])
    for box, by in ((b"iprp", growth), (b"ipco", len(added)), (b"ipma", len(numbers))):
        size_at = new.index(box) - 4
        struct.pack_into(">I", new, size_at, struct.unpack_from(">I", new, size_at)[0] + by)
    _move(new, new.index(b"iloc") + 4, growth)
    chunks.insert(file, end, bytes(growth))
    file.seek(start - 8)
    file.write(struct.pack(">I4s", len(new) + 8, b"meta") + new)


def _move(meta: bytearray, iloc_at: int, by: int) -> None:
    """Moves the places of all items in a box iloc: its base offsets, which libheif writes."""
    (count,) = struct.unpack_from(">H", meta, iloc_at + 6)
    at = iloc_at + 8
    for _ in range(count):
        (base,) = struct.unpack_from(">I", meta, at + 4)
        (pieces,) = struct.unpack_from(">H", meta, at + 8)
        struct.pack_into(">I", meta, at + 4, base + by)
        at += 10 + 8 * pieces


def _state_in_header(file: BinaryIO, code_points: CodePoints) -> None:
    """Replaces the code points in the header of the coded picture, where they may begin at any bit."""
    place = boxes.extent(file, b"av01")
    assert place is not None
    file.seek(place.at)
    head = file.read(_MOST_HEADER)
    bits = int.from_bytes(head, "big")
    for shift in range(8 * len(head) - _AS_CODED_BITS, -1, -1):
        if bits >> shift & ((1 << _AS_CODED_BITS) - 1) == _AS_CODED:
            stated = 1 << 24 | code_points.primaries << 16 | code_points.transfer << 8 | _MATRIX
            bits += (stated - _AS_CODED) << shift
            file.seek(place.at)
            file.write(bits.to_bytes(len(head), "big"))
            return
