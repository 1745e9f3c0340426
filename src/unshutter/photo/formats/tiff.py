"""TIFF: lossless, 8 or 16 bits; EXIF and IPTC are tags among its own.

Source: TIFF 6.0.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.photo import by_libvips
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import field
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif, iptc
from unshutter.photo.tags.directories import SUBFILE_TYPE, Tree, read_tree

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_SIGNATURE = re.compile(rb"II[*+]\0|MM\0[*+]")  # +: BigTIFF
_COMPRESSION = 0x0103
_SMALLER_COPY, _MASK = 1, 4  # bits of a subfile's type
_CLASSIC_BYTES = 3_500_000_000  # more go into a BigTIFF


@final
class Tiff(WrittenFormat):
    """TIFF: 8 or 16 bits, lossless."""

    name = written_as = "tiff"
    suffixes = (".tif", ".tiff")
    longest_side, deep, grey, alpha = 10_000_000, True, True, True
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "description"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return _SIGNATURE.match(head) is not None

    def read_header(self, source: Source) -> Header:
        """See Format."""
        with source.stream() as stream:
            tree = read_tree(stream)
        image = by_libvips.opened(source, "tiffload")
        coding = Coding(bits=field(image, "bits-per-sample", 8))
        metadata = replace(Metadata.of_image(image), resources=None)
        if tree is None:  # a BigTIFF
            return by_libvips.header(self, source, image, coding, metadata)
        coding = replace(coding, compression=tree.number(_COMPRESSION))
        metadata = replace(metadata, exif=exif.of_tiff(tree), resources=iptc.of_tiff(tree))
        return by_libvips.header(self, source, image, coding, metadata, _pictures(tree))

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decoded(source, "tiffload")

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat. Photoshop's resources come later: libvips cuts them to a quarter."""
        image = image.copy()
        image.remove("iptc-data")
        size = image.width * image.height * image.bands * (2 if image.format == "ushort" else 1)
        options = {"compression": {1: "none", 5: "lzw"}.get(coding.compression or 0, "deflate")}
        if options["compression"] != "none":
            options["predictor"] = "horizontal"
        return by_libvips.encoded(image, "tiffsave", path, with_exif=True, bigtiff=size > _CLASSIC_BYTES, **options)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> list[str]:
        """See WrittenFormat."""
        more = iptc.tiff_tags(field(image, "iptc-data", b""))
        exif.add_to_tiff(file, field(image, "exif-data"), image.height, image.width, more)
        return []


def _pictures(tree: Tree) -> int:
    """Pages of a TIFF that are pictures: smaller copies and masks do not count."""
    kinds = [tree.number(SUBFILE_TYPE, page=page) or 0 for page in range(len(tree.pages))]
    return sum(not kind & (_SMALLER_COPY | _MASK) for kind in kinds)
