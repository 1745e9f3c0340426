"""PNG: lossless, 8 or 16 bits; all metadata are chunks, before or after the pixels.

libvips reads only the chunks before the pixels and rewrites texts, so they are read here and copied unchanged.

Source: W3C, PNG third edition (chunks, eXIf, cICP, acTL).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Orientation
from unshutter.photo import by_libvips
from unshutter.photo.by_libvips import ExifBlock, without_exif_loops
from unshutter.photo.containers import chunks, insertion
from unshutter.photo.containers.chunks import COLOURS, TEXTS
from unshutter.photo.format import Coding, Header, Picture, WrittenFormat
from unshutter.photo.libvips import field, profile_of
from unshutter.photo.metadata import Metadata, Resolution
from unshutter.photo.source import Source
from unshutter.photo.tags import exif, png_texts

if TYPE_CHECKING:
    import numpy as np

_AFTER_HEADER = 33  # bytes: signature and the chunk IHDR
_PIXELS = (b"IDAT", b"fdAT")
_CARRIED = TEXTS | COLOURS | {b"pHYs", b"tIME"}
# Chunks that belong to the encoding of the old pixels and mean nothing to a photographer: palettes, Apple's list of
# offsets, frames of a still picture.
_OF_THE_CODING = frozenset({b"IHDR", b"PLTE", b"tRNS", b"hIST", b"iCCP", b"acTL", b"fcTL", b"iDOT"})
_IN_WORDS = {
    b"caBX": "content credentials",
    b"prVW": "a preview",
    b"sBIT": "significant bits (sBIT)",
    b"sPLT": "a suggested palette (sPLT)",
    b"bKGD": "background colour (bKGD)",
    b"dSIG": "digital signature (dSIG)",
}
_PALETTE, _BACKGROUND_BYTES = 3, {0: 2, 2: 6, 4: 2, 6: 6}  # by colour type
_ONE_FRAME = struct.pack(">I", 1)


@final
class Png(WrittenFormat):
    """PNG: 8 or 16 bits, lossless."""

    name = written_as = "png"
    suffixes = (".png",)
    longest_side, deep, grey, alpha = 10_000_000, True, True, True
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "chunks"})

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return head.startswith(b"\x89PNG\r\n\x1a\n")

    def read_header(self, source: Source) -> Header:
        """See Format."""
        with source.stream() as stream:
            own = _read_metadata(source, stream)
        image = by_libvips.open_image(without_exif_loops(source, _exif_blocks), "pngload")
        coding = Coding(bits=field(image, "bits-per-sample", 8))
        resolution = Resolution(image.xres, image.yres)
        metadata = replace(own, icc=own.icc or field(image, "icc-profile-data"), resolution=resolution)
        header = by_libvips.header(self, source, image, coding, metadata)
        return replace(header, orientation=exif.orientation(metadata.exif) or Orientation.NORMAL)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decode(without_exif_loops(source, _exif_blocks), "pngload")

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat. :meth:`embed` adds XMP, because libvips compresses it, against the XMP specification."""
        bits = 16 if picture.image.format == "ushort" else 8
        written = replace(picture, metadata=replace(picture.metadata, exif=None, xmp=None))
        return by_libvips.encode(written, "pngsave", path, filter="all", bitdepth=bits, palette=False)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. libvips always writes a resolution (pHYs), even if it is unknown."""
        metadata, added = picture.metadata, []
        if metadata.exif is not None:
            added.append((b"eXIf", metadata.exif.removeprefix(exif.PREFIX)))
        if metadata.xmp is not None:
            added.append(png_texts.of_xmp(metadata.xmp))
        if metadata.resources is not None:
            added.append(png_texts.of_resources(metadata.resources))
        written = chunks.place_of(file, b"pHYs")
        has_own = any(name == b"pHYs" for name, _ in metadata.chunks)
        if written is not None and (has_own or not metadata.resolution.is_known):
            insertion.replace(file, *written, b"")
        insertion.insert(file, _AFTER_HEADER, b"".join(chunks.encoded(*chunk) for chunk in (*added, *metadata.chunks)))
        return []


def _exif_blocks(file: BinaryIO) -> Iterator[ExifBlock]:
    extent = chunks.place_of(file, b"eXIf")
    if extent is not None:
        start, end = extent
        file.seek(start + 8)
        yield ExifBlock(start + 8, file.read(end - start - 12))


def _read_metadata(source: Source, file: BinaryIO) -> Metadata:
    """Reads all metadata except the profile in the chunk iCCP, which libvips decompresses, and the resolution.

    Raises:
        UnshutterError: the file is an animation, or has colours of HDR or video.
    """
    blobs: dict[str, bytes] = {}
    carried: list[tuple[bytes, bytes]] = []
    lost: list[str] = []
    coding, palette = _coding(file), b""
    for name, data in chunks.of_file(file, skipped=_PIXELS):
        if data is None:
            lost.append("damaged chunks")
        elif name == b"eXIf":
            blobs["exif"] = data  # takes precedence over a text
        elif name in TEXTS and (hidden := png_texts.metadata_in(name, data)) is not None:
            if not hidden.data:
                lost.append(f"{hidden.attribute.upper()} (damaged)")
            blobs.setdefault(hidden.attribute, hidden.data)
        elif name == b"PLTE":
            palette = data
        elif name == b"acTL" and data[:4] > _ONE_FRAME:
            raise UnshutterError("{photo} is an animation: unshutter takes single photos", photo=source)
        elif (copied := _carried(name, data, coding, palette)) is not None:
            carried.append((name, copied))
        elif name not in _OF_THE_CODING:
            lost.append(_IN_WORDS.get(name, f"chunk {name.decode('latin-1')}"))
    return _metadata(source, blobs, carried, lost + ["data behind the picture"] * chunks.has_data_behind(file))


def _carried(name: bytes, data: bytes, coding: tuple[int, int], palette: bytes) -> bytes | None:
    """Returns the data of a chunk for the result; None if it is not copied."""
    if name == b"bKGD":
        return _background(data, *coding, palette)
    return data if name in _CARRIED or chunks.is_safe_to_copy(name) else None


def _metadata(source: Source, blobs: dict[str, bytes], carried: list[tuple[bytes, bytes]], lost: list[str]) -> Metadata:
    """Builds the metadata from blobs by attribute, copied chunks, and names of what is lost."""
    blob = blobs.get("exif", b"")
    if exif.has_loop(blob):
        lost.append("EXIF (damaged)")
    return Metadata(
        exif=exif.without_loop(blob) or None,
        icc=_cicp_profile(source, carried) or blobs.get("icc") or None,
        xmp=blobs.get("xmp") or None,
        resources=blobs.get("resources") or None,
        chunks=tuple(carried),
        left_behind=tuple(dict.fromkeys(lost)),
    )


def _cicp_profile(source: Source, carried: list[tuple[bytes, bytes]]) -> bytes | None:
    """Returns the ICC profile for the colours in the chunk cICP; None if there is none, or it means sRGB.

    Raises:
        UnshutterError: the colours are HDR or video.
    """
    code_points = dict(carried).get(b"cICP", b"")
    return profile_of(code_points[0], code_points[1], source) if len(code_points) == 4 else None


def _coding(file: BinaryIO) -> tuple[int, int]:
    """Returns bits per sample and colour type."""
    file.seek(chunks.SIGNATURE_BYTES + 16)
    depth, colour_type = file.read(2).ljust(2, b"\0")
    return depth, colour_type


def _background(data: bytes, depth: int, colour_type: int, palette: bytes) -> bytes | None:
    """Converts the chunk bKGD to the decoded pixels: no palette, at least 8 bits; returns None if it is damaged."""
    if colour_type == _PALETTE:
        colour = palette[3 * data[0] : 3 * data[0] + 3] if data else b""
        return struct.pack(">3H", *colour) if len(colour) == 3 else None
    if len(data) != _BACKGROUND_BYTES.get(colour_type):
        return None
    if depth >= 8:
        return data
    return struct.pack(">H", min(struct.unpack(">H", data)[0], (1 << depth) - 1) * 255 // ((1 << depth) - 1))
