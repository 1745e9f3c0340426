"""Boxes, the building blocks of AVIF, HEIC and Canon's newest raw files, and the items of AVIF and HEIC.

Results contain the primary picture and its metadata; a JPEG also its auxiliary pictures (gain map, depth map, mattes),
an AVIF its gain map. Everything else (further pictures, videos) is only reported by name.

Source: ISO/IEC 14496-12 (boxes; iinf, iloc), ISO/IEC 23008-12 (HEIF: items, properties, references, auxiliary images),
ISO 21496-1 (gain maps).
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.inventory import Fate
from unshutter.orientation import Orientation
from unshutter.photo.code_points import HDR_TRANSFERS, light_in_boxes
from unshutter.photo.libvips import Source
from unshutter.photo.parts import GAIN_MAP, OTHER, PICTURES, Found, further_picture, of_coding, purpose

_HEAD, _LONG_HEAD = 8, 16  # bytes of size and type, and with a 64-bit size
_ANIMATION = re.compile(rb"....ftyp(avis|hevc|hevx|msf1)", re.DOTALL)


# ---- boxes ---------------------------------------------------------------------------------------------


def top_level(file: BinaryIO, kind: bytes) -> bytes:
    """Returns the content of a top-level box, leaving the file just after it; raises KeyError if there is none."""
    for name, start, end in top_level_extents(file):
        if name == kind:
            file.seek(start)
            return file.read(min(end - start, 1 << 24))  # bytes: headers of pictures take a few thousand
    raise KeyError(kind)


def top_level_extents(file: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
    """Yields (type, first byte of the content, byte after it) of the top-level boxes.

    The last one may claim to end beyond the end of the file.
    """
    length = file.seek(0, io.SEEK_END)
    at = 0
    for _ in range(10_000):  # at the top level of a file: pictures have a handful
        if at + _HEAD > length:
            return
        file.seek(at)
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


def in_meta(file: BinaryIO) -> dict[bytes, bytes]:
    """Returns the contents of the boxes in the box meta by type; raises KeyError if there is none."""
    return dict(inside(top_level(file, b"meta")[4:]))


def _head(data: bytes, left: int) -> tuple[int, int, bytes]:
    """Parses the header of a box with at least 8 bytes into (bytes of the header, of the whole box, type).

    A size of 0 means everything that is ``left``, and 1 a 64-bit size after the type.
    """
    size, name = struct.unpack_from(">I4s", data)
    if size == 1 and len(data) >= _LONG_HEAD:
        return _LONG_HEAD, struct.unpack_from(">Q", data, _HEAD)[0], name
    return _HEAD, size or left, name


def inspect_boxes(source: Source) -> tuple[BoxCoding, tuple[Found, ...]]:
    """Returns the coding of the primary picture, and the parts of the file; rejects sequences of pictures."""
    with source.stream() as stream:
        if _ANIMATION.match(stream.read(12)):
            raise UnshutterError("{photo} is an animation: unshutter takes single photos", photo=source)
        coding, parts = read_coding(stream), parts_of(stream)
    if coding.is_hdr:  # without its gain map, too
        parts = tuple(part._replace(reason="") for part in parts)
    return coding, parts


# ---- properties of the primary picture -----------------------------------------------------------------


class BoxCoding(NamedTuple):
    """Coding of the primary picture of an AVIF or HEIC.

    ``grey`` and ``subsampled`` are valid for AVIF only.
    """

    # transformation that decoders apply to the stored pixels (boxes irot, imir)
    orientation: Orientation = Orientation.NORMAL
    grey: bool = False  # whether there is no chroma
    subsampled: bool = True  # whether chroma has half the resolution in both directions (4:2:0)
    # primaries and transfer function of the colours; (2, 2) if the file does not specify them
    code_points: tuple[int, int] = (2, 2)
    light: tuple[tuple[bytes, bytes], ...] = ()  # boxes with light levels

    @property
    def is_hdr(self) -> bool:
        """Whether its own colours are HDR's (PQ, HLG)."""
        return self.code_points[1] in HDR_TRANSFERS


_MIRRORS = (Orientation.FLIP_TOP_BOTTOM, Orientation.FLIP_LEFT_RIGHT)  # by the value in imir


def bits_agree(file: BinaryIO) -> bool:
    """Whether the bits per sample of the primary picture of a HEIC are what the header of its coding says."""
    try:
        own = dict(_properties(file))
        return own[b"hvcC"][17] & 7 == own[b"pixi"][5] - 8
    except (KeyError, IndexError, struct.error):
        return True  # one of them is not stated


def _properties(file: BinaryIO) -> list[tuple[bytes, bytes]]:
    """Returns the properties of the primary picture; raises KeyError, IndexError or struct.error."""
    meta = in_meta(file)
    iprp = dict(inside(meta[b"iprp"]))
    properties = list(inside(iprp[b"ipco"]))
    return [properties[i - 1] for i in _associations(iprp[b"ipma"], _primary(meta)) if i]


def read_coding(file: BinaryIO) -> BoxCoding:
    """Reads the properties of the primary picture (boxes pitm, ipco, ipma); defaults if damaged."""
    try:
        listed = _properties(file)
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
        light=light_in_boxes(listed),
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


def _primary(meta: dict[bytes, bytes]) -> int:
    return struct.unpack_from(">I" if meta[b"pitm"][0] else ">H", meta[b"pitm"], 4)[0]


def _associations(ipma: bytes, item: int) -> list[int]:
    """Returns the numbers, from 1, of the properties associated with an item."""
    version = ipma[0]
    wide_index = ipma[3] & 1
    (entries,) = struct.unpack_from(">I", ipma, 4)
    at = 8
    for _ in range(entries):
        (name,) = struct.unpack_from(">I" if version else ">H", ipma, at)
        at += 4 if version else 2
        count = ipma[at]
        at += 1
        form, mask = (">H", 0x7FFF) if wide_index else (">B", 0x7F)
        numbers = [struct.unpack_from(form, ipma, at + i * (1 + wide_index))[0] & mask for i in range(count)]
        if name == item:
            return numbers
        at += count * (1 + wide_index)
    return []


# ---- items ---------------------------------------------------------------------------------------------

_MOST_ITEMS = 10_000
_LONGEST_ITEM = 60_000  # bytes of metadata about an auxiliary picture, which must fit a segment of a JPEG
_XMP = b"application/rdf+xml"
_SUPPORTED = bytes(3)  # versions of the item tmap that readers of this version understand
_BASE_COLOURS = 0x40  # flag of a gain map that is applied in the primary picture's primaries
_ISO_KIND = "urn:iso:std:iso:ts:21496"
_OTHER_ITEMS = {b"tmap": GAIN_MAP, b"iptc": "IPTC", b"rgan": "regions", b"uri ": OTHER, b"mime": OTHER}
_VIDEOS = (b"moov", b"mpvd")
_STRUCTURE = frozenset({b"ftyp", b"meta", b"mdat", b"free", b"skip", b"wide"})
_CREDENTIALS = bytes.fromhex("d8fec3d61b0e483c92975828877ec481")  # identifier of a box (C2PA)


def parts_of(file: BinaryIO) -> tuple[Found, ...]:
    """Lists the items and boxes of a file; none if it is damaged."""
    try:
        meta = in_meta(file)
        found = [*_auxiliaries(meta), *_items(meta)]
    except (KeyError, IndexError, struct.error):
        return ()
    for name, start, end in top_level_extents(file):
        if name in _STRUCTURE:
            found.append(of_coding("structure", end - start))
            continue
        file.seek(start)
        is_signature = name == b"uuid" and file.read(16) == _CREDENTIALS
        words = "film" if name in _VIDEOS else "content credentials" if is_signature else OTHER
        found.append(Found(words, end - start))
    return tuple(found)


def _auxiliaries(meta: dict[bytes, bytes]) -> Iterator[Found]:
    """Yields a part for each type of auxiliary picture (property auxC)."""
    properties = dict(inside(meta[b"iprp"]))[b"ipco"]
    for name, data in inside(properties):
        if name == b"auxC":
            words = purpose(data[4:].partition(b"\0")[0])
            yield of_coding("transparency") if words == "" else further_picture(words or OTHER)


def _items(meta: dict[bytes, bytes]) -> Iterator[Found]:
    """Yields a part for each item but auxiliary pictures."""
    references = list(_references(meta.get(b"iref", bytes(4))))
    primary = _primary(meta)
    parts = {primary, *(part for kind, _, to in references if kind == b"dimg" for part in to)}
    thumbnails = {item for kind, item, _ in references if kind == b"thmb"}
    auxiliaries = {item for kind, item, _ in references if kind == b"auxl"}
    for data in islice(item_entries(meta[b"iinf"]), _MOST_ITEMS):
        if data[0] < 2:
            continue
        number, at = _number_of(data)
        kind = data[at : at + 4]
        if kind == b"Exif":
            yield Found("EXIF", 0, "exif", Fate.REPLACED)  # that of a further picture goes with it
        elif kind == b"mime" and data[at + 4 :].split(b"\0")[1:2] == [_XMP]:
            yield Found("XMP", 0, "xmp", Fate.REPLACED)
        elif kind in _OTHER_ITEMS:
            yield further_picture(_OTHER_ITEMS[kind])
        elif number in parts or data[3] & 1:
            yield of_coding("picture")
        elif number in thumbnails:
            yield of_coding("thumbnail")
        elif number not in auxiliaries:
            yield Found(PICTURES)


class AuxiliaryItem(NamedTuple):
    """An auxiliary picture of the primary picture."""

    number: int
    kind: str  # its type (property auxC), or ISO's name of gain maps
    orientation: Orientation  # transformation that decoders apply to it
    xmp: bytes | None  # XMP about it
    iso: bytes | None  # what a gain map means, as ISO 21496-1 says it (content of the item tmap)
    alternate: tuple[tuple[bytes, bytes], ...]  # properties (name, content) of the picture that a gain map makes
    has_other_colours: bool  # whether that picture is computed in other primaries than the primary one has


def auxiliary_items(file: BinaryIO) -> list[AuxiliaryItem]:
    """Lists the auxiliary pictures of the primary picture; none if the file is damaged.

    A gain map is one that is listed as such, or one of ISO 21496-1 that readers of this version understand.
    """
    try:
        makes_another = b"tmap" in top_level(file, b"ftyp")
        meta = in_meta(file)
        iprp = dict(inside(meta[b"iprp"]))
        properties = list(inside(iprp[b"ipco"]))
        references = list(_references(meta.get(b"iref", bytes(4))))
        entries = [(entry, *_number_of(entry)) for entry in islice(item_entries(meta[b"iinf"]), _MOST_ITEMS)]
        kinds = {number: entry[at : at + 4] for entry, number, at in entries}
        primary = _primary(meta)
        tones = {
            to[1]: item
            for kind, item, to in references
            if kind == b"dimg" and kinds.get(item) == b"tmap" and len(to) == 2 and to[0] == primary
        }
        listed = [item for kind, item, to in references if kind == b"auxl" and primary in to]
        colours = _nclx(_properties(file))
        found = []
        for number in dict.fromkeys([*listed, *(tones if makes_another else ())]):
            own, alternate = (
                [properties[i - 1] for i in _associations(iprp[b"ipma"], item) if i]
                for item in (number, tones.get(number, 0))
            )
            about = {kinds.get(item): item for kind, item, to in references if kind == b"cdsc" and number in to}
            xmp, iso = (
                None if item is None else _content(file, meta, item) for item in (about.get(b"mime"), tones.get(number))
            )
            kind = dict(own).get(b"auxC", bytes(4))[4:].partition(b"\0")[0].decode(errors="replace")
            if iso is not None and not iso.startswith(_SUPPORTED):
                iso = None
            if kind or iso is not None:
                stated = _nclx(alternate)
                others = (
                    iso is not None and not iso[5] & _BASE_COLOURS and bool(stated and colours) and stated != colours
                )
                kind = kind or _ISO_KIND
                found.append(AuxiliaryItem(number, kind, _orientation(dict(own)), xmp, iso, tuple(alternate), others))
    except (KeyError, IndexError, struct.error):
        return []
    return found


def _nclx(properties: list[tuple[bytes, bytes]]) -> list[bytes]:
    """Returns the primaries that a picture's properties state as code points."""
    return [data[4:6] for name, data in properties if name == b"colr" and data[:4] == b"nclx"]


def with_primary(data: bytes, item: int) -> bytes:
    """Returns a copy of a file in which another item is the primary one, and not hidden; raises KeyError or IndexError.

    Decoders then decode that item, such as a gain map, which they do not list as a picture. No item is auxiliary there.
    """
    stream = io.BytesIO(data)
    content = top_level(stream, b"meta")
    content_at = stream.tell() - len(content)
    meta = dict(inside(content[4:]))
    copy = bytearray(data)
    entry = next((each for each in item_entries(meta[b"iinf"]) if _number_of(each)[0] == item), None)
    if entry is None:
        raise KeyError(item)
    copy[content_at + content.index(b"infe" + entry) + 7] &= 0xFE
    is_wide = meta[b"pitm"][0] > 0
    struct.pack_into(">I" if is_wide else ">H", copy, content_at + content.index(b"pitm" + meta[b"pitm"]) + 8, item)
    iref = meta.get(b"iref", b"")
    iref_at = content_at + content.index(iref)
    copy[iref_at : iref_at + len(iref)] = iref.replace(b"auxl", b"free")
    return bytes(copy)


def has_gain_map(file: BinaryIO) -> bool:
    """Whether the primary picture has a gain map that makes it HDR, and that a JPEG can hold."""
    return not read_coding(file).is_hdr and any(
        purpose(each.kind.encode()) == GAIN_MAP and not each.has_other_colours for each in auxiliary_items(file)
    )


def _content(file: BinaryIO, meta: dict[bytes, bytes], item: int) -> bytes | None:
    """Returns the content of an item of metadata; None if it is fragmented or long."""
    in_file = _extent_of(meta[b"iloc"], item, 0)
    if in_file is not None:
        file.seek(in_file.at)
        return file.read(in_file.length) if in_file.length <= _LONGEST_ITEM else None
    in_box = _extent_of(meta[b"iloc"], item, 0, method=1)
    return None if in_box is None else meta[b"idat"][in_box.at : in_box.at + in_box.length]


def item_entries(iinf: bytes) -> Iterator[bytes]:
    """Yields the contents of the boxes infe, one for each item."""
    return (data for name, data in inside(iinf[6 if iinf[0] == 0 else 8 :]) if name == b"infe")


def _number_of(entry: bytes) -> tuple[int, int]:
    """Parses (number of an item, position of its kind) in its box infe."""
    is_wide = entry[0] > 2
    return struct.unpack_from(">I" if is_wide else ">H", entry, 4)[0], 10 if is_wide else 8


def _references(iref: bytes) -> Iterator[tuple[bytes, int, tuple[int, ...]]]:
    """Yields (kind, item, the items that it refers to) of the references between items."""
    form = "I" if iref[0] else "H"
    size = struct.calcsize(form)
    for kind, data in islice(inside(iref[4:]), _MOST_ITEMS):
        number, count = struct.unpack_from(f">{form}H", data)
        yield kind, number, struct.unpack_from(f">{count}{form}", data, size + 2)


# ---- positions -----------------------------------------------------------------------------------------


class Extent(NamedTuple):
    """Position of an item in a file."""

    at: int
    length: int
    base: int  # position that the offset of ``at`` in the file's table is relative to
    numbers_at: int  # position of that offset and the length in the table
    are_32_bits: bool  # whether both numbers have 32 bits


def extent(file: BinaryIO, kind: bytes) -> Extent | None:
    """Returns the position of the first item of a kind; None if there is none, or it is fragmented."""
    try:
        content = top_level(file, b"meta")
        content_at = file.tell() - len(content)
        meta = dict(inside(content[4:]))
        entries = ((entry, *_number_of(entry)) for entry in item_entries(meta[b"iinf"]))
        item = next(number for entry, number, at in entries if entry[at : at + 4] == kind)
        return _extent_of(meta[b"iloc"], item, content_at + content.index(meta[b"iloc"]))
    except (KeyError, IndexError, StopIteration, struct.error):
        return None


def _extent_of(iloc: bytes, item: int, iloc_at: int, method: int = 0) -> Extent | None:
    """Finds the position of an item in the box iloc; raises IndexError if that is damaged.

    It is counted from the start of the file (method 0) or of the box idat (1).
    """
    version = iloc[0]
    sizes = iloc[4]
    more_sizes = iloc[5]
    stream = io.BytesIO(iloc)
    stream.seek(6)

    def number(size: int) -> int:
        data = stream.read(size)
        if len(data) < size:
            raise IndexError
        return int.from_bytes(data, "big")

    for _ in range(min(number(4 if version == 2 else 2), _MOST_ITEMS)):
        own = number(4 if version == 2 else 2)
        is_there = (number(2) & 15 if version else 0) == method
        number(2)  # number of the file that contains it: this one
        base = number(more_sizes >> 4)
        pieces = number(2)
        for _ in range(pieces):
            number(more_sizes & 15 if version else 0)
            numbers_at = iloc_at + stream.tell()
            offset = number(sizes >> 4)
            length = number(sizes & 15)
            if own == item and is_there and pieces == 1:
                return Extent(base + offset, length, base, numbers_at, sizes == 0x44)
            if own == item:
                return None
    return None
