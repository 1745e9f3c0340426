"""WebP: lossy or lossless, which stays so; EXIF is a chunk.

Source: RFC 9649 (the container's chunks).
"""

from __future__ import annotations

import re
import struct
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.photo import by_libvips
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import field
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_SIGNATURE = re.compile(rb"RIFF....WEBP", re.DOTALL)


@final
class Webp(WrittenFormat):
    """WebP: 8 bits, RGB."""

    name = written_as = "webp"
    suffixes = (".webp",)
    longest_side, deep, grey, alpha = 16_383, False, False, True
    holds = frozenset({"exif", "icc", "xmp"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return _SIGNATURE.match(head) is not None

    def read_header(self, source: Source) -> Header:
        """See Format."""
        readable = _without_tangles(source)
        image = by_libvips.opened(readable, "webpload")
        with source.stream() as stream:
            lossless = _is_lossless(stream)
        coding, metadata = Coding(subsampled=not lossless, lossless=lossless), Metadata.of_image(image)
        if readable is not source:
            metadata = replace(metadata, exif=None, left_behind=("EXIF (damaged)",))
        return by_libvips.header(self, source, image, coding, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decoded(_without_tangles(source), "webpload")

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat. libvips writes EXIF, too: :meth:`embed` takes its place."""
        lossless = coding.lossless and quality is None
        options = {"lossless": True, "exact": True} if lossless else {"Q": quality or 90}
        return by_libvips.encoded(image, "webpsave", path, with_exif=True, **options)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> list[str]:
        """See WrittenFormat."""
        blob = field(image, "exif-data")
        if blob is None:
            return []
        tiff = blob.removeprefix(exif.PREFIX)
        file.seek(12)
        chunks = b""
        while len(head := file.read(8)) == 8:
            (size,) = struct.unpack("<I", head[4:])
            content = file.read(size + size % 2)
            if head[:4] == b"EXIF":
                head, content = b"EXIF" + struct.pack("<I", len(tiff)), tiff + bytes(len(tiff) % 2)
            chunks += head + content
        file.seek(0)
        file.write(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks)
        file.truncate()
        return []


def _without_tangles(source: Source) -> Source:
    """The data, with EXIF that libvips would be caught in made unreadable for it."""
    places = []
    with suppress(OSError), source.stream() as stream:
        stream.seek(12)
        while len(head := stream.read(8)) == 8:
            size, at = int.from_bytes(head[4:], "little"), stream.tell()
            if head[:4] == b"EXIF" and exif.is_tangled(blob := stream.read(size)):
                places.append(at + len(blob) - len(blob.removeprefix(exif.PREFIX)))
            stream.seek(at + size + size % 2)
        if places:
            return source.patched(places, b"none")
    return source


def _is_lossless(file: BinaryIO) -> bool:
    """Whether the picture is in WebP's lossless coding (chunk VP8L)."""
    file.seek(12)
    while len(head := file.read(8)) == 8:
        name, size = struct.unpack("<4sI", head)
        if name in (b"VP8L", b"VP8 "):
            return name == b"VP8L"
        file.seek(size + size % 2, 1)
    return False
