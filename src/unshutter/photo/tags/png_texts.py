"""PNG's texts, and metadata of other formats that programs store in them.

XMP is the text of a keyword. Before PNG had a chunk for EXIF, ImageMagick wrote it, like all other JPEG metadata, as
hexadecimal text under ``Raw profile type ...``; for IPTC this is still the only way, which other programs support.

Source: W3C, PNG third edition, section 11.3.3 (texts); Adobe, XMP specification part 3; exiftool.org, PNG tags.
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

from unshutter.photo.tags import exif, iptc

_XMP = b"XML:com.adobe.xmp"
_RAW = b"Raw profile type "
_ATTRIBUTES = {
    **{_XMP: "xmp", b"xmp": "xmp", b"exif": "exif", b"app1": "exif"},
    **{b"iptc": "resources", b"8bim": "resources", b"icc": "icc", b"icm": "icc"},
}
_XMP_OF_JPEG = b"http://ns.adobe.com/xap/1.0/\0"
_LONGEST = 1 << 26  # maximum size of a decompressed text that is metadata [bytes]
_HEX_LINE = 72  # characters


class TextMetadata(NamedTuple):
    """Metadata in a text: an attribute of ``Metadata``, and its value, which is empty if unreadable."""

    attribute: str
    data: bytes


def metadata_in(name: bytes, data: bytes) -> TextMetadata | None:
    """Extracts metadata of other formats from a text; returns None for plain texts.

    Args:
        name: name of the chunk.
        data: data of the chunk.
    """
    keyword = data[:80].partition(b"\0")[0]
    kind = _XMP if keyword == _XMP else keyword.removeprefix(_RAW).lower()
    if kind not in _ATTRIBUTES or not keyword.startswith((_RAW, _XMP)):
        return None
    content = _content(name, data[len(keyword) + 1 :])
    if content is None:
        return TextMetadata(_ATTRIBUTES[kind], b"")
    return TextMetadata("xmp", content) if keyword == _XMP else _meaning(kind, _unpacked_profile(content))


def _content(name: bytes, data: bytes) -> bytes | None:
    """Returns the text after a keyword, as bytes; None if it is damaged or far too long."""
    packed = name == b"zTXt"
    if name == b"iTXt":
        packed, parts = data[:1] == b"\1", data[2:].split(b"\0", 2)  # language, translated keyword, text
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
    """Decodes a raw profile: a line with its name, one with its length, then hexadecimal digits."""
    parts = content.split(b"\n", 3)
    try:
        data = bytes.fromhex(parts[3].decode("ascii"))
        return data if len(data) == int(parts[2]) else b""
    except (IndexError, ValueError):
        return b""


def _meaning(kind: bytes, data: bytes) -> TextMetadata:
    """Identifies the metadata in a raw profile, for the kind ``app1`` by its first bytes."""
    if data.startswith(_XMP_OF_JPEG):
        return TextMetadata("xmp", data.removeprefix(_XMP_OF_JPEG))
    attribute = _ATTRIBUTES[kind]
    if attribute == "exif" and exif.read(data) is None:
        return TextMetadata("exif", b"")
    return TextMetadata(attribute, iptc.of_blocks(data) if attribute == "resources" and data else data)


# ---- writing -------------------------------------------------------------------------------------------


def of_xmp(packet: bytes) -> tuple[bytes, bytes]:
    """Returns name and data of the chunk for an XMP packet."""
    return b"iTXt", _XMP + b"\0\0\0\0\0" + packet


def of_resources(resources: bytes) -> tuple[bytes, bytes]:
    """Returns name and data of the chunk for Photoshop's resources, including IPTC."""
    blocks = resources.removeprefix(iptc.PREFIX)
    digits = blocks.hex().encode()
    lines = b"\n".join(digits[i : i + _HEX_LINE] for i in range(0, len(digits), _HEX_LINE))
    profile = b"\niptc\n%8d\n%s\n" % (len(blocks), lines)
    return b"zTXt", _RAW + b"iptc\0\0" + zlib.compress(profile)
