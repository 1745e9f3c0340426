"""What files say about how they were encoded, where libvips does not pass it on: read, never written."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

# Luminance quantisation of quality 50, in any order (ITU-T T.81, table K.1).
_JPEG_LUMINANCE = (
    *(16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29),
    *(51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121),
    *(120, 101, 72, 92, 95, 98, 112, 100, 103, 99),
)
_TABLES, _FRAMES, _APP1 = 0xDB, (0xC0, 0xC1, 0xC2), 0xE1


class JpegCoding(NamedTuple):
    """Coding of a JPEG.

    Attributes:
        quality: 1 ... 100, the one of libjpeg's scale whose luminance table is nearest in sum to the file's; None
            without a table. Cameras and Adobe programs use tables of their own: for them it is the equivalent.
        subsampled: chroma at half the resolution in both directions (4:2:0) or less.
    """

    quality: int | None = None
    subsampled: bool = False


def jpeg_coding(file: BinaryIO) -> JpegCoding:
    """Reads the tables and the frame header; defaults for what is missing or damaged."""
    total, factors = None, b""
    for marker, content in _jpeg_segments(file, (_TABLES, *_FRAMES)):
        if marker == _TABLES:
            total = _luminance_sum(content) or total
        else:
            factors = content[7::3]  # of each component, horizontal << 4 | vertical
    quality = None
    if total is not None:
        quality = min(range(1, 101), key=lambda quality: abs(_scaled_sum(quality) - total))
    return JpegCoding(quality, subsampled=len(factors) == 3 and factors[0] >> 4 >= 2 and factors[0] & 15 >= 2)


def _scaled_sum(quality: int) -> int:
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    return sum(min(max((value * scale + 50) // 100, 1), 255) for value in _JPEG_LUMINANCE)


def jpeg_exif(file: BinaryIO) -> bytes | None:
    """The EXIF blob of a JPEG."""
    return next((content for _, content in _jpeg_segments(file, (_APP1,)) if content.startswith(b"Exif\0\0")), None)


def _jpeg_segments(file: BinaryIO, wanted: tuple[int, ...]) -> Iterator[tuple[int, bytes]]:
    """(marker, content) of segments before the first scan."""
    file.seek(2)
    while len(head := file.read(4)) == 4:
        mark, marker, length = struct.unpack(">BBH", head)
        if mark != 0xFF or marker == 0xDA or length < 2:
            return
        if marker in wanted:
            yield marker, file.read(length - 2)
        else:
            file.seek(length - 2, 1)


def _luminance_sum(tables: bytes) -> int | None:
    """Sum of quantisation table 0, if it is among these."""
    while tables:
        wide, name = tables[0] >> 4, tables[0] & 15
        values = tables[1 : 65 + 64 * wide]
        if name == 0 and wide < 2 and len(values) == 64 * (1 + wide):
            return sum(struct.unpack(">64H", values) if wide else values)
        tables = tables[65 + 64 * wide :]
    return None


def webp_is_lossless(file: BinaryIO) -> bool:
    """Whether the picture of a WebP file is in its lossless coding (chunk VP8L)."""
    file.seek(12)
    while len(head := file.read(8)) == 8:
        name, size = struct.unpack("<4sI", head)
        if name in (b"VP8L", b"VP8 "):
            return name == b"VP8L"
        file.seek(size + size % 2, 1)
    return False


class BoxCoding(NamedTuple):
    """Coding of the primary picture of an AVIF or HEIC.

    Attributes:
        orientation: EXIF number of the turn and mirroring that decoders apply (boxes irot, imir).
        grey: no chroma at all.
        subsampled: chroma at half the resolution in both directions (4:2:0).
        code_points: primaries and transfer of the colours, (2, 2) where they are not told.

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


def box_coding(file: BinaryIO) -> BoxCoding:
    """Reads the properties of the primary picture (ISO/IEC 23008-12, boxes pitm, ipco, ipma); defaults if damaged."""
    try:
        meta = dict(boxes(top_level_box(file, b"meta")[4:]))
        pitm, iprp = meta[b"pitm"], dict(boxes(meta[b"iprp"]))
        (primary,) = struct.unpack_from(">I" if pitm[0] else ">H", pitm, 4)
        properties = list(boxes(iprp[b"ipco"]))
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


def top_level_box(file: BinaryIO, wanted: bytes) -> bytes:
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


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(type, content) of the boxes in the content of another one."""
    at = 0
    while at + 8 <= len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        if size < 8:
            return
        yield name, data[at + 8 : at + size]
        at += size


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


def item_names_are_text(file: BinaryIO) -> bool:
    """Whether the types of all items of a HEIC file are ASCII; where not, pi-heif crashes (1.4)."""
    try:
        iinf = dict(boxes(top_level_box(file, b"meta")[4:]))[b"iinf"]
    except KeyError:
        return True  # told by others
    entries = (content for name, content in boxes(iinf[6 if iinf[:1] == b"\0" else 8 :]) if name == b"infe")
    return all(byte < 128 for entry in entries for byte in entry[8:])


class Extent(NamedTuple):
    """Where an item of a box file is.

    Attributes:
        numbers_at: place of two 32-bit numbers: offset, counted from ``base``, and length.
        base, offset, length: as they are there.
    """

    numbers_at: int
    base: int
    offset: int
    length: int


def exif_extent(file: BinaryIO) -> Extent | None:
    """Where an AVIF says that its EXIF is; None without EXIF, or where it is not told as libheif does it."""
    try:
        meta = top_level_box(file, b"meta")
        iinf, iloc = (dict(boxes(meta[4:]))[name] for name in (b"iinf", b"iloc"))
        entries = (content for name, content in boxes(iinf[6:]) if name == b"infe")
        (item,) = [struct.unpack_from(">H", infe, 4)[0] for infe in entries if infe[8:12] == b"Exif"]
        if iinf[0] != 0 or iloc[0] != 0 or iloc[4:6] != b"\x44\x40":  # versions; offset, length and base of 32 bits
            return None
        (count,), at = struct.unpack_from(">H", iloc, 6), 8
        for _ in range(count):
            name, place, base, extents = struct.unpack_from(">HHIH", iloc, at)
            if name == item and (place, extents) == (0, 1):
                numbers_at = file.tell() - len(meta) + meta.index(iloc) + at + 10
                return Extent(numbers_at, base, *struct.unpack_from(">II", iloc, at + 10))
            at += 10 + 8 * extents
    except (KeyError, IndexError, ValueError, struct.error):
        pass
    return None
