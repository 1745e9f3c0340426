"""Adds to an AVIF from libvips what that does not write: colours, light levels and gain maps.

Source: ISO/IEC 23008-12 (ipco, ipma, iref, altr), ISO/IEC 14496-12 (iloc, iinf), ISO 21496-1 (item tmap), AV1 Bitstream
& Decoding Process Specification (sequence header).
"""

from __future__ import annotations

import io
import struct
from typing import BinaryIO

from unshutter.photo import boxes, chunks
from unshutter.photo.code_points import HDR_TRANSFERS, CodePoints

_MATRIX = 6  # coefficients by which libheif codes colours: BT.601
_AS_CODED = 1 << 24 | 1 << 16 | 13 << 8 | _MATRIX  # that they are stated, and how libheif states them: as sRGB
_AS_CODED_BITS = 25
_NCLX = b"nclx"
_NO_COLOURS = _NCLX + struct.pack(">HHHB", 2, 2, _MATRIX, 0x80)  # of a gain map: its values are not colours
_SRGB = _NCLX + struct.pack(">HHHB", 1, 13, _MATRIX, 0x80)
_MOST_HEADER = 64  # bytes of coded data in which its header is looked for
_TRANSFORMATIONS = (b"irot", b"imir")
_ESSENTIAL = 0x80  # flag of a property that readers must understand


def state_colours(file: BinaryIO, code_points: CodePoints) -> None:
    """States the colours of the primary picture of an AVIF that libheif wrote with sRGB's, and light levels."""
    _state_in_header(file, code_points)
    meta = _Meta(file)
    for at, (name, content) in enumerate(meta.properties):
        if name == b"colr" and content.startswith(_NCLX):  # newer versions of libvips state sRGB
            stated = struct.pack(">HH", code_points.primaries, code_points.transfer)
            meta.properties[at] = name, _NCLX + stated + content[8:]
            break
    else:
        meta.state(meta.primary, *code_points.boxes(_MATRIX)[0])
    for name, content in code_points.light:
        meta.state(meta.primary, name, content)
    meta.write(file)


def add_gain_map(file: BinaryIO, coded: bytes, metadata: bytes, alternate: tuple[tuple[bytes, bytes], ...]) -> bool:
    """Adds a gain map to an AVIF; returns False if other versions of libheif wrote its tables in another form.

    Args:
        coded: the map as an AVIF, also from libvips.
        metadata: GainMapMetadata of ISO 21496-1.
        alternate: properties of the picture that the map makes; by default, colours are those of the primary picture.
    """
    if not _Meta(file).is_usual:
        return False
    brands_end = next(end for name, _, end in boxes.top_level_extents(file) if name == b"ftyp")
    chunks.insert(file, brands_end, b"tmap")
    file.seek(0)
    file.write(struct.pack(">I", brands_end + 4))
    own = _Meta(io.BytesIO(coded))
    meta = _Meta(file)
    gain_map, tone = (max(meta.listed, default=meta.primary) + more for more in (101, 102))  # EXIF's are lower
    properties = own.of(own.primary)
    for name, content, flag in properties:
        if name != b"colr":
            meta.state(gain_map, name, content, flag)
    meta.state(gain_map, b"colr", _NO_COLOURS)
    primary = meta.of(meta.primary)
    stated = [each for each in alternate if each[0] not in (b"ispe", *_TRANSFORMATIONS)]
    if not any(name == b"colr" for name, _ in stated):
        colours = [content for name, content, _ in primary if name == b"colr"]
        stated += [(b"colr", _other_range(each)) for each in colours or [_SRGB]]
    if not any(name == b"pixi" for name, _ in stated):
        stated += [(name, content) for name, content, _ in properties if name == b"pixi"]
    for name, content, flag in primary:
        if name in _TRANSFORMATIONS:
            meta.state(gain_map, name, content, flag)
        if name == b"ispe" or name in _TRANSFORMATIONS:
            meta.state(tone, name, content, flag)
    for name, content in stated:
        meta.state(tone, name, content)
    picture = _data(coded)
    end = file.seek(0, io.SEEK_END)
    file.write(_box(b"mdat", b"\0" + metadata + picture))
    tone_length = 1 + len(metadata)
    meta.add_item(gain_map, b"av01", end + 8 + tone_length, len(picture), hidden=True)
    meta.add_item(tone, b"tmap", end + 8, tone_length)
    references = meta.boxes.get(b"iref", bytes(4))
    meta.boxes[b"iref"] = references + _box(b"dimg", struct.pack(">HHHH", tone, 2, meta.primary, gain_map))
    group = struct.pack(">IIIII", 0, tone + 1, 2, tone, meta.primary)
    meta.boxes[b"grpl"] = _box(b"altr", group)
    meta.write(file, moved=4)
    return True


class _Meta:
    """The box meta of an AVIF from libheif, with its parts as they can be changed."""

    def __init__(self, file: BinaryIO) -> None:
        _, self._start, self._end = next(each for each in boxes.top_level_extents(file) if each[0] == b"meta")
        file.seek(self._start)
        self.boxes = dict(boxes.inside(file.read(self._end - self._start)[4:]))
        iprp = dict(boxes.inside(self.boxes[b"iprp"]))
        self.properties = list(boxes.inside(iprp[b"ipco"]))
        (self.primary,) = struct.unpack_from(">H", self.boxes[b"pitm"], 4)
        self.listed: dict[int, bytes] = {}  # numbers of each item's properties, from 1, with their flags
        table = iprp[b"ipma"]
        at = 8
        while at < len(table):
            item, count = struct.unpack_from(">HB", table, at)
            self.listed[item] = table[at + 3 : at + 3 + count]
            at += 3 + count

    @property
    def is_usual(self) -> bool:
        """Whether its tables have the form that is written here: version 0, 32 bits, short numbers of properties."""
        (flags,) = struct.unpack_from(">I", dict(boxes.inside(self.boxes[b"iprp"]))[b"ipma"])
        versions = {flags, self.boxes[b"pitm"][0], self.boxes[b"iinf"][0], self.boxes.get(b"iref", b"\0")[0]}
        return versions == {0} and self.boxes[b"iloc"].startswith(b"\0\0\0\0\x44\x40")

    def of(self, item: int) -> list[tuple[bytes, bytes, int]]:
        """Returns name, content and flag of an item's properties."""
        return [(*self.properties[(each & 0x7F) - 1], each & _ESSENTIAL) for each in self.listed[item]]

    def state(self, item: int, name: bytes, content: bytes, flag: int = 0) -> None:
        """Adds a property to an item."""
        if (name, content) not in self.properties:
            self.properties.append((name, content))
        number = self.properties.index((name, content)) + 1
        self.listed[item] = self.listed.get(item, b"") + bytes([number | flag])

    def add_item(self, item: int, kind: bytes, at: int, length: int, hidden: bool = False) -> None:
        """Adds an item whose data are at a position in the file, counted as before the box grows."""
        entries, places = self.boxes[b"iinf"], self.boxes[b"iloc"]
        entry = struct.pack(">BBHHH4sB", 2, 0, hidden, item, 0, kind, 0)
        self.boxes[b"iinf"] = _one_more(entries, 4) + _box(b"infe", entry)
        self.boxes[b"iloc"] = _one_more(places, 6) + struct.pack(">HHIHII", item, 0, at - 4, 1, 0, length)

    def write(self, file: BinaryIO, moved: int = 0) -> None:
        """Writes the box, which may have grown, in its place, when everything behind had been moved by some bytes."""
        ipco = b"".join(_box(*each) for each in self.properties)
        ipma = struct.pack(">II", 0, len(self.listed))
        ipma += b"".join(struct.pack(">HB", item, len(own)) + own for item, own in sorted(self.listed.items()))
        self.boxes[b"iprp"] = _box(b"ipco", ipco) + _box(b"ipma", ipma)
        size = 4 + sum(8 + len(content) for content in self.boxes.values())
        growth = size - (self._end - self._start)
        self.boxes[b"iloc"] = _moved(self.boxes[b"iloc"], growth + moved)
        chunks.insert(file, self._end, bytes(growth))
        file.seek(self._start - 8)
        file.write(_box(b"meta", bytes(4) + b"".join(_box(*each) for each in self.boxes.items())))


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), name) + content


def _one_more(table: bytes, count_at: int) -> bytes:
    """Returns a table with its number of entries increased."""
    (count,) = struct.unpack_from(">H", table, count_at)
    return table[:count_at] + struct.pack(">H", count + 1) + table[count_at + 2 :]


def _moved(iloc: bytes, by: int) -> bytes:
    """Moves the places of all items in a box iloc: its base offsets, which libheif writes."""
    table = bytearray(iloc)
    (count,) = struct.unpack_from(">H", table, 6)
    at = 8
    for _ in range(count):
        (base,) = struct.unpack_from(">I", table, at + 4)
        (pieces,) = struct.unpack_from(">H", table, at + 8)
        struct.pack_into(">I", table, at + 4, base + by)
        at += 10 + 8 * pieces
    return bytes(table)


def _other_range(colours: bytes) -> bytes:
    """Returns the same primaries in HDR if the colours are SDR, or in SDR; profiles say nothing of that."""
    if not colours.startswith(_NCLX):
        return colours
    primaries, transfer = struct.unpack_from(">HH", colours, 4)
    return _NCLX + struct.pack(">HHHB", primaries, 13 if transfer in HDR_TRANSFERS else 16, _MATRIX, 0x80)


def _data(coded: bytes) -> bytes:
    """Returns the coded data of the only picture of an AVIF."""
    place = boxes.extent(io.BytesIO(coded), b"av01")
    assert place is not None
    return coded[place.at : place.at + place.length]


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
