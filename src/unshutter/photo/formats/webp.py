"""WebP: lossy or lossless like the original; EXIF is a chunk.

Source: RFC 9649 (the container's chunks).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, final

from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Metadata, Picture, WrittenFormat
from unshutter.photo.libvips import Source
from unshutter.photo.parts import OTHER, Found, of_coding

_METADATA = {b"EXIF": "exif", b"XMP ": "xmp", b"XMP\0": "xmp"}  # the last is a misspelling by some programs
_OF_THE_CODING = frozenset({b"VP8X", b"VP8 ", b"VP8L", b"ALPH", b"ANIM", b"ANMF"})
_LONGEST = 1 << 28  # maximum size of a chunk to read [bytes]


@final
class Webp(WrittenFormat):
    """WebP: 8 bits, RGB."""

    loader = "webpload"
    signature = re.compile(rb"RIFF....WEBP", re.DOTALL)
    longest_side = 16_383
    deep = False
    grey = False
    alpha = True
    holds = frozenset({"exif", "icc", "xmp"})

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = picture_format.open_image(self, source)
        with source.stream() as stream:
            lossless = next((name == b"VP8L" for name, _, _ in _chunks(stream) if name in (b"VP8L", b"VP8 ")), False)
            metadata = _with_chunks(picture_format.metadata_of(image), stream).without_exif_loop()
        coding = Coding(subsampled=not lossless, lossless=lossless)
        return picture_format.header(self, source, image, coding, metadata)

    def exif_blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """See Format."""
        for name, at, size in _chunks(file):
            if name == b"EXIF":
                blob = _data(file, at, size)
                yield at + len(blob) - len(blob.removeprefix(EXIF_PREFIX)), blob

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        lossless = picture.coding.lossless and picture.quality is None
        options = {"lossless": True, "exact": True} if lossless else {"Q": picture.quality or self.row.usual_quality}
        return picture_format.encode(picture, "webpsave", path, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. EXIF replaces the content of the placeholder's chunk."""
        blob = picture.metadata.exif
        if blob is None:
            return []
        tiff = blob.removeprefix(EXIF_PREFIX)
        file.seek(12)
        chunks = b""
        while len(head := file.read(8)) == 8:
            (size,) = struct.unpack("<I", head[4:])
            content = file.read(size + size % 2)
            if head[:4] == b"EXIF":
                head = b"EXIF" + struct.pack("<I", len(tiff))
                content = tiff + bytes(len(tiff) % 2)
            chunks += head + content
        file.seek(0)
        file.write(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks)
        file.truncate()
        return []


# ---- chunks --------------------------------------------------------------------------------------------


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
    """Yields (name, start of the data, their length) of the chunks of a file, up to the length stated in its header."""
    file.seek(4)
    at = 12
    end = 8 + int.from_bytes(file.read(4), "little")
    while at + 8 <= end:
        file.seek(at)
        head = file.read(8)
        if len(head) < 8:
            return
        name, size = struct.unpack("<4sI", head)
        yield name, at + 8, size
        at += 8 + size + size % 2


def _data(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(at)
    return file.read(min(size, _LONGEST))


def _with_chunks(metadata: Metadata, file: BinaryIO) -> Metadata:
    """Completes the metadata that libvips found, which misses chunks not announced in the header, and misspelt XMP.

    Lists the parts of the file, too.
    """
    blobs: dict[str, bytes] = {}
    found: list[Found] = []
    for name, at, size in _chunks(file):
        whole = 8 + size + size % 2
        attribute = _METADATA.get(name)
        if attribute is not None and attribute not in blobs:
            blobs[attribute] = _data(file, at, size)
            found.append(Found(attribute.upper(), whole, attribute))
        elif name == b"ICCP":
            found.append(Found("colour profile", whole, "icc"))
        else:
            found.append(of_coding("coding", whole) if name in _OF_THE_CODING else Found(OTHER, whole))
    file.seek(4)
    file.seek(8 + int.from_bytes(file.read(4), "little"))  # to the end that the header states
    behind = len(file.read(_LONGEST).strip(b"\0"))
    return replace(
        metadata,
        exif=blobs.get("exif") or None,
        xmp=metadata.xmp or blobs.get("xmp") or None,
        found=(*found, Found(OTHER, behind)) if behind else tuple(found),
    )
