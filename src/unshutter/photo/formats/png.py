"""PNG: lossless, 8 or 16 bits; all metadata are chunks, before the pixels or behind them.

libvips reads only the chunks before the pixels, and spells texts anew. So they are read here, and written as they were.

Source: W3C, PNG third edition (chunks, eXIf, cICP, acTL).
"""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.geometry.orientation import Orientation
from unshutter.photo import by_libvips
from unshutter.photo.containers import chunks, insertion
from unshutter.photo.containers.chunks import COLOURS, TEXTS
from unshutter.photo.format import Coding, Header, WrittenFormat
from unshutter.photo.libvips import field
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import colours, exif, png_texts

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_AFTER_HEADER = 33  # bytes: signature and the chunk IHDR
_PIXELS = (b"IDAT", b"fdAT")
_CARRIED = TEXTS | COLOURS | {b"pHYs", b"tIME"}
# What belongs to the coding of the old pixels, and says nothing to a photographer: palettes, Apple's list of offsets,
# frames of a still picture.
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
_DAMAGED_EXIF = "EXIF (damaged)"
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
        image = by_libvips.opened(_without_tangles(source, own), "pngload")
        coding = Coding(bits=field(image, "bits-per-sample", 8))
        metadata = replace(own, icc=own.icc or field(image, "icc-profile-data"), resolution=(image.xres, image.yres))
        header = by_libvips.header(self, source, image, coding, metadata)
        return replace(header, orientation=exif.orientation(metadata.exif) or Orientation.NORMAL)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        return by_libvips.decoded(_without_tangles(source, header.metadata), "pngload")

    def encode(self, image: pyvips.Image, coding: Coding, quality: int | None, path: Path | None) -> bytes | None:
        """See WrittenFormat. XMP comes later: libvips packs it, which the XMP specification forbids."""
        image = image.copy()
        for name in ("xmp-data", "iptc-data"):
            image.remove(name)
        bits = 16 if image.format == "ushort" else 8
        return by_libvips.encoded(image, "pngsave", path, filter="all", bitdepth=bits, palette=False)

    def embed(self, file: BinaryIO, image: pyvips.Image) -> list[str]:
        """See WrittenFormat. libvips tells a resolution even if nobody knows it."""
        blob, packet, resources = (field(image, name) for name in ("exif-data", "xmp-data", "iptc-data"))
        added, carried = b"", field(image, "png-chunks", b"")
        if blob is not None:
            added += chunks.encoded(b"eXIf", blob.removeprefix(exif.PREFIX))
        if packet is not None:
            added += chunks.encoded(*png_texts.of_xmp(packet))
        if resources is not None:
            added += chunks.encoded(*png_texts.of_resources(resources))
        resolution = chunks.place_of(file, b"pHYs")
        if resolution is not None and (b"\0\0\0\x09pHYs" in carried or not field(image, "resolution-told")):
            insertion.replace(file, *resolution, b"")
        insertion.insert(file, _AFTER_HEADER, added + carried)
        return []


def _without_tangles(source: Source, metadata: Metadata) -> Source:
    """The data, with EXIF that libvips would be caught in made unreadable for it."""
    if _DAMAGED_EXIF not in metadata.left_behind:
        return source
    with suppress(OSError), source.stream() as stream:  # a file that is gone, libvips tells of
        if (place := chunks.place_of(stream, b"eXIf")) is not None:
            return source.patched([place[0] + 8], b"none")
    return source


def _read_metadata(source: Source, file: BinaryIO) -> Metadata:
    """All but the profile in the chunk iCCP, which libvips unpacks, and the resolution.

    Raises:
        UnshutterError: an animation, or colours of HDR or video.
    """
    found: dict[str, bytes] = {}
    carried: list[tuple[bytes, bytes]] = []
    lost: list[str] = []
    coding, palette = _coding(file), b""
    for name, data in chunks.of_file(file, skipped=_PIXELS):
        if data is None:
            lost.append("damaged chunks")
        elif name == b"eXIf":
            found["exif"] = data  # rather than what a text says
        elif name in TEXTS and (meant := png_texts.metadata_in(name, data)) is not None:
            if not meant.data:
                lost.append(f"{meant.attribute.upper()} (damaged)")
            found.setdefault(meant.attribute, meant.data)
        elif name == b"PLTE":
            palette = data
        elif name == b"acTL" and data[:4] > _ONE_FRAME:
            raise UnshutterError("{photo} is an animation: unshutter takes single photos", photo=source)
        elif (kept := _carried(name, data, coding, palette)) is not None:
            carried.append((name, kept))
        elif name not in _OF_THE_CODING:
            lost.append(_IN_WORDS.get(name, f"chunk {name.decode('latin-1')}"))
    return _metadata(source, found, carried, lost + ["data behind the picture"] * chunks.has_data_behind(file))


def _carried(name: bytes, data: bytes, coding: tuple[int, int], palette: bytes) -> bytes | None:
    """The data of a chunk for the result; None where it does not go along."""
    if name == b"bKGD":
        return _background(data, *coding, palette)
    return data if name in _CARRIED or chunks.is_safe_to_copy(name) else None


def _metadata(source: Source, found: dict[str, bytes], carried: list[tuple[bytes, bytes]], lost: list[str]) -> Metadata:
    """The metadata of what was found, by attribute, of chunks that go along, and of names of what does not."""
    blob = found.get("exif", b"")
    if exif.is_tangled(blob):
        lost.append(_DAMAGED_EXIF)
    return Metadata(
        exif=exif.untangled(blob) or None,
        icc=_profile_told(source, carried) or found.get("icc") or None,
        xmp=found.get("xmp") or None,
        resources=found.get("resources") or None,
        chunks=tuple(carried),
        left_behind=tuple(dict.fromkeys(lost)),
    )


def _profile_told(source: Source, carried: list[tuple[bytes, bytes]]) -> bytes | None:
    """The profile of the colours that the chunk cICP tells by numbers; None where it does not, or tells sRGB.

    Raises:
        UnshutterError: those of HDR or video.
    """
    told = dict(carried).get(b"cICP", b"")
    return colours.profile_of(told[0], told[1], source) if len(told) == 4 else None


def _coding(file: BinaryIO) -> tuple[int, int]:
    """Bits of a sample and colour type."""
    file.seek(chunks.SIGNATURE_BYTES + 16)
    depth, colour_type = file.read(2).ljust(2, b"\0")
    return depth, colour_type


def _background(data: bytes, depth: int, colour_type: int, palette: bytes) -> bytes | None:
    """The chunk bKGD for the pixels as they are decoded: no palette, no less than 8 bits; None where it is damaged."""
    if colour_type == _PALETTE:
        colour = palette[3 * data[0] : 3 * data[0] + 3] if data else b""
        return struct.pack(">3H", *colour) if len(colour) == 3 else None
    if len(data) != _BACKGROUND_BYTES.get(colour_type):
        return None
    if depth >= 8:
        return data
    return struct.pack(">H", min(struct.unpack(">H", data)[0], (1 << depth) - 1) * 255 // ((1 << depth) - 1))
