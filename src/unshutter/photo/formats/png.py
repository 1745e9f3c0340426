"""PNG: lossless, 8 or 16 bits; all metadata are chunks, before or after the pixels.

libvips reads only the chunks before the pixels and rewrites texts, so they are read here and copied unchanged. Programs
store metadata of other formats in texts: XMP is the text of a keyword. Before PNG had a chunk for EXIF, ImageMagick
wrote it, like all other JPEG metadata, as hexadecimal text under ``Raw profile type ...``; for IPTC this is still the
only way, which other programs support.

Source: W3C, PNG third edition (chunks, texts, eXIf, cICP, acTL); Adobe, XMP specification part 3; exiftool.org, PNG
tags.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.inventory import Fate
from unshutter.orientation import Orientation
from unshutter.photo import chunks, code_points, exif
from unshutter.photo.chunks import COLOURS, TEXTS, Chunk
from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Metadata, Picture, Resolution, WrittenFormat
from unshutter.photo.libvips import Source, field
from unshutter.photo.parts import DAMAGED, OTHER, PICTURES, Found, of_coding

_AFTER_HEADER = 33  # bytes: signature and the chunk IHDR
_CARRIED = TEXTS | COLOURS | {b"pHYs", b"tIME"}
# Chunks that belong to the encoding of the old pixels and mean nothing to a photographer: palettes, Apple's list of
# offsets, frames of a still picture.
_OF_THE_CODING = frozenset({b"IHDR", b"PLTE", b"tRNS", b"hIST", b"sBIT", b"acTL", b"fcTL", b"iDOT"})
_CREDENTIALS = b"caBX"
_ELSEWHERE = frozenset({b"gAMA", b"cHRM", b"sRGB", b"cICP", b"tIME"})  # have no meaning, or are kept in another way
_CODE_POINTS = frozenset({b"cICP", b"mDCV", b"cLLI"})
_WORDS = {"exif": "EXIF", "xmp": "XMP", "resources": "IPTC", "icc": "colour profile"}


@final
class Png(WrittenFormat):
    """PNG: 8 or 16 bits, lossless."""

    loader = "pngload"
    signature = re.compile(rb"\x89PNG\r\n\x1a\n")
    longest_side = 10_000_000
    deep = True
    grey = True
    alpha = True
    holds = frozenset({"exif", "icc", "code_points", "xmp", "resources", "resolution", "chunks"})

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = picture_format.open_image(self, source)
        unread = Metadata(icc=field(image, "icc-profile-data"), resolution=Resolution(image.xres, image.yres))
        with source.stream() as stream:
            metadata = _read_metadata(source, stream, unread)
        coding = Coding(bits=field(image, "bits-per-sample", 8))
        header = picture_format.header(self, source, image, coding, metadata)
        return replace(header, orientation=exif.orientation(metadata.exif) or Orientation.NORMAL)

    def exif_blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """See Format."""
        extent = chunks.extent_of(file, b"eXIf")
        if extent is not None:
            start, end = extent
            file.seek(start + 8)
            yield start + 8, file.read(end - start - 12)

    def hidden_markers(self, file: BinaryIO) -> list[int]:
        """See WrittenFormat. Also texts that might become huge when decompressed, as libvips does with all of them."""
        texts = [
            (at + 4, length) for at, name, length in chunks.heads_before_pixels(file) if name in (b"zTXt", b"iTXt")
        ]
        huge = sum(length for _, length in texts) * _MOST_PACKED > _LONGEST
        return super().hidden_markers(file) + [at for at, _ in texts if huge]

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat. :meth:`embed` adds XMP, because libvips compresses it, against the XMP specification."""
        bits = 16 if picture.image.format == "ushort" else 8
        written = replace(picture, metadata=replace(picture.metadata, exif=None, xmp=None))
        return picture_format.encode(written, "pngsave", path, filter="all", bitdepth=bits, palette=False)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. libvips always writes a resolution (pHYs), even if it is unknown."""
        metadata = picture.metadata
        added = []
        if metadata.exif is not None:
            added.append((b"eXIf", metadata.exif.removeprefix(EXIF_PREFIX)))
        if metadata.xmp is not None:
            added.append((b"iTXt", _XMP + b"\0\0\0\0\0" + metadata.xmp))
        if metadata.resources is not None:
            added.append(_chunk_of_resources(metadata.resources))
        own = {name for name, _ in metadata.chunks}
        if metadata.code_points is not None and b"cICP" not in own:
            added += metadata.code_points.chunks()
        written = chunks.extent_of(file, b"pHYs")
        if written is not None and (b"pHYs" in own or not metadata.resolution.is_known):
            chunks.remove(file, *written)
        chunks.insert(
            file, _AFTER_HEADER, b"".join(chunks.encoded_chunk(*chunk) for chunk in (*added, *metadata.chunks))
        )
        return []


def _read_metadata(source: Source, file: BinaryIO, unread: Metadata) -> Metadata:
    """Reads all metadata except what libvips has read: the profile in iCCP, which is packed, and the resolution."""
    blobs: dict[str, bytes] = {}
    carried: list[Chunk] = []
    found: list[Found] = []
    file.seek(chunks.SIGNATURE_BYTES + 16)
    depth, colour_type = file.read(2).ljust(2, b"\0")
    palette = b""
    for name, data, size in chunks.chunks_of(file, skipped=(b"IDAT",)):
        if data is None:
            found.append(Found(OTHER, size))
        elif name == b"eXIf":
            blobs["exif"] = data  # takes precedence over a text
            found.append(Found("EXIF", size, "exif"))
        elif name in TEXTS and (hidden := _metadata_in(name, data, blobs)) is not None:
            attribute, blob = hidden
            words = _WORDS[attribute]
            found.append(Found(words, size, attribute) if blob else Found(words, size, reason=DAMAGED))
            blobs.setdefault(attribute, blob)
        elif name == b"PLTE":
            palette = data
            found.append(of_coding("coding", size))
        elif name == b"acTL" and data[:4] > struct.pack(">I", 1):
            raise UnshutterError("{photo} is an animation: unshutter takes single photos", photo=source)
        elif (copied := _carried(name, data, (depth, colour_type), palette)) is not None:
            carried.append(Chunk(name, copied, size))
        else:
            found.append(_part(name, size, unread))
    behind = chunks.bytes_behind_chunks(file)
    found += [Found(OTHER, behind)] if behind else []
    return _metadata(source, blobs, carried, found, unread)


def _part(name: bytes, size: int, unread: Metadata) -> Found:
    """Returns the part for a chunk that is not copied."""
    if name == b"iCCP":
        return Found("colour profile", size, "icc" if unread.icc else "")
    if name in _OF_THE_CODING:
        return of_coding("coding", size)
    if name == b"fdAT":
        return Found(PICTURES, size)
    return Found("content credentials" if name == _CREDENTIALS else OTHER, size)


def _carried(name: bytes, data: bytes, coding: tuple[int, int], palette: bytes) -> bytes | None:
    """Returns the data of a chunk for the result; None if it is not copied."""
    if name == b"bKGD":
        return _background(data, *coding, palette)
    return data if name in _CARRIED or chunks.is_safe_to_copy(name) else None


def _carried_part(name: bytes, size: int, has_colours: bool, metadata: Metadata) -> Found:
    """Returns the part for the chunks of a name that are copied to PNG."""
    if name == b"pHYs":
        return picture_format.resolution_part(metadata, size)
    if name in TEXTS:
        return Found("texts", size, "chunks")
    if name in _CODE_POINTS and metadata.code_points is not None:
        return Found("colours", size, "code_points")
    if name in _ELSEWHERE:
        is_lost = has_colours and name in (b"gAMA", b"cHRM")
        return Found("colours", size, "chunks", Fate.LEFT_OUT if is_lost else Fate.REPLACED)
    return Found(OTHER, size, "chunks")


def _metadata(
    source: Source, blobs: dict[str, bytes], carried: list[Chunk], found: list[Found], unread: Metadata
) -> Metadata:
    """Builds the metadata from blobs by attribute, copied chunks, and the parts that are not copied."""
    by_name = {name: data or b"" for name, data, _ in carried}
    profile, stated = None, None
    if len(coded := by_name.get(b"cICP", b"")) == 4:
        profile, stated = code_points.colours(coded[0], coded[1], code_points.light_in_chunks(by_name), source)
        if stated is not None and not coded[3]:
            raise UnshutterError(f"{{photo}} has {stated.title} of limited range: convert it first", photo=source)
    metadata = replace(
        unread,
        exif=blobs.get("exif") or None,
        icc=profile or blobs.get("icc") or unread.icc,
        code_points=stated,
        xmp=blobs.get("xmp") or None,
        resources=blobs.get("resources") or None,
        chunks=tuple((name, data or b"") for name, data, _ in carried),
    )
    has_colours = metadata.icc is stated is None and not chunks.are_usual(by_name)
    found += [_carried_part(name, size, has_colours, metadata) for name, _, size in carried]
    if any(part.held == "resources" for part in found):
        found = [
            picture_format.resources_part(metadata.resources, part.size) if part.held == "resources" else part
            for part in found
        ]
    return replace(metadata, found=tuple(found)).without_exif_loop()


def _background(data: bytes, depth: int, colour_type: int, palette: bytes) -> bytes | None:
    """Converts the chunk bKGD to the decoded pixels: no palette, at least 8 bits; returns None if it is damaged."""
    if colour_type == 3:  # a palette
        colour = palette[3 * data[0] : 3 * data[0] + 3] if data else b""
        return struct.pack(">3H", *colour) if len(colour) == 3 else None
    if len(data) != {0: 2, 2: 6, 4: 2, 6: 6}.get(colour_type):
        return None
    if depth >= 8:
        return data
    return struct.pack(">H", min(struct.unpack(">H", data)[0], (1 << depth) - 1) * 255 // ((1 << depth) - 1))


# ---- metadata in texts -------------------------------------------------------------------------------

_XMP = b"XML:com.adobe.xmp"
_RAW = b"Raw profile type "
_ATTRIBUTES = {
    **{_XMP: "xmp", b"xmp": "xmp", b"exif": "exif", b"app1": "exif"},
    **{b"iptc": "resources", b"8bim": "resources", b"icc": "icc", b"icm": "icc"},
}
_LONGEST = 1 << 26  # maximum size of a decompressed text that is metadata [bytes]
_MOST_PACKED = 1032  # how many times longer than packed data their content can be
_HEX_LINE = 72  # characters


def _metadata_in(name: bytes, data: bytes, known: dict[str, bytes]) -> tuple[str, bytes] | None:
    """Extracts metadata of other formats from a text; returns None for plain texts. What is known is not unpacked.

    Returns an attribute of ``Metadata``, and its value, which is empty if unreadable.
    """
    keyword = data[:80].partition(b"\0")[0]
    kind = _XMP if keyword == _XMP else keyword.removeprefix(_RAW).lower()
    if kind not in _ATTRIBUTES or not keyword.startswith((_RAW, _XMP)):
        return None
    if known.get(_ATTRIBUTES[kind]):
        return _ATTRIBUTES[kind], known[_ATTRIBUTES[kind]]
    content = _content(name, data[len(keyword) + 1 :])
    if content is None:
        return _ATTRIBUTES[kind], b""
    return ("xmp", content) if keyword == _XMP else _meaning(kind, _unpacked_profile(content))


def _content(name: bytes, data: bytes) -> bytes | None:
    """Returns the text after a keyword, as bytes; None if it is damaged or far too long."""
    packed = name == b"zTXt"
    if name == b"iTXt":
        packed = data[:1] == b"\1"
        parts = data[2:].split(b"\0", 2)  # language, translated keyword, text
        data = parts[2] if len(parts) == 3 else b""
    elif packed:
        data = data[1:]
    if not packed:
        return data
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(data, _LONGEST)
    except zlib.error:
        return None
    return content if unpacker.eof else None


def _unpacked_profile(content: bytes) -> bytes:
    """Decodes a raw profile: a line with its name, one with its length, then so many hexadecimal digits."""
    parts = content.split(b"\n", 3)
    try:
        length = int(parts[2])
        digits = b"".join(parts[3].split())[: 2 * max(length, 0)]
        data = bytes.fromhex(digits.decode("ascii"))
        return data if len(data) == length else b""
    except (IndexError, ValueError):
        return b""


def _meaning(kind: bytes, data: bytes) -> tuple[str, bytes]:
    """Identifies the metadata in a raw profile, for the kind ``app1`` by its first bytes."""
    if data.startswith(chunks.XMP_PREFIX):
        return "xmp", data.removeprefix(chunks.XMP_PREFIX)
    attribute = _ATTRIBUTES[kind]
    if attribute == "exif" and not exif.read(data):
        return "exif", b""
    return attribute, chunks.resources_of_blocks(data) if attribute == "resources" and data else data


def _chunk_of_resources(resources: bytes) -> tuple[bytes, bytes]:
    """Returns name and data of the chunk for Photoshop's resources, including IPTC."""
    blocks = resources.removeprefix(chunks.RESOURCES_PREFIX)
    digits = blocks.hex().encode()
    lines = b"\n".join(digits[i : i + _HEX_LINE] for i in range(0, len(digits), _HEX_LINE))
    profile = b"\niptc\n%8d\n%s\n" % (len(blocks), lines)
    return b"zTXt", _RAW + b"iptc\0\0" + zlib.compress(profile)
