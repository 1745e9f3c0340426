"""PNG: lossless, 8 or 16 bits; EXIF is a chunk.

Source: W3C, PNG third edition (chunks, eXIf).
"""

from __future__ import annotations

import struct
import zlib
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
        image = by_libvips.opened(source, "pngload")
        coding = Coding(bits=field(image, "bits-per-sample", 8))
        return by_libvips.header(self, source, image, coding, Metadata.of_image(image))

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decoded(source, "pngload")

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


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
