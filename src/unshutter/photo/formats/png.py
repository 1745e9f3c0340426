"""PNG: lossless, 8 or 16 bits; EXIF is a chunk.

Source: W3C, PNG third edition (chunks, eXIf).
"""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.photo import by_libvips
from unshutter.photo.containers.insertion import insert
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import field
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_AFTER_HEADER = 33  # bytes: signature and the chunk IHDR


@final
class Png(WrittenFormat):
    """PNG: 8 or 16 bits, lossless."""

    name = written_as = "png"
    suffixes = (".png",)
    longest_side, deep, grey, alpha = 10_000_000, True, True, True
    holds = frozenset({"exif", "icc", "xmp", "resolution", "texts"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return head.startswith(b"\x89PNG\r\n\x1a\n")

    def read_header(self, source: Source) -> Header:
        """See Format."""
        readable = _without_tangles(source)
        image = by_libvips.opened(readable, "pngload")
        coding, metadata = Coding(bits=field(image, "bits-per-sample", 8)), Metadata.of_image(image)
        if readable is not source:
            metadata = replace(metadata, left_behind=("EXIF (damaged)",))
        return by_libvips.header(self, source, image, coding, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decoded(_without_tangles(source), "pngload")

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        bits = 16 if image.format == "ushort" else 8
        return by_libvips.encoded(image, "pngsave", path, filter="all", bitdepth=bits, palette=False)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> list[str]:
        """See WrittenFormat."""
        blob = field(image, "exif-data")
        if blob is not None:
            insert(file, _AFTER_HEADER, _chunk(b"eXIf", blob.removeprefix(exif.PREFIX)))
        return []


def _without_tangles(source: Source) -> Source:
    """The data, with EXIF that libvips would be caught in made unreadable for it."""
    places = []
    with suppress(OSError), source.stream() as stream:
        stream.seek(8)
        while len(head := stream.read(8)) == 8:
            size, at = int.from_bytes(head[:4], "big"), stream.tell()
            if head[4:] == b"eXIf" and exif.is_tangled(stream.read(size)):
                places.append(at)
            stream.seek(at + size + 4)  # the chunk's check sum
    return source.patched(places, b"none") if places else source


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
