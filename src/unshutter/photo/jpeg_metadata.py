"""What a JPEG's segments say beside the picture: libvips does not hand all of it on, nor all of it whole.

Source: ITU-T T.871 (JFIF); CIPA DC-008 (EXIF in APP1), DC-007 (several pictures in APP2); Adobe, XMP specification
part 3 (XMP in APP1, Photoshop's resources in APP13).
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import BinaryIO

from unshutter.photo.containers.motion_photo import film_of
from unshutter.photo.containers.segments import APP0, APP1, APP2, APP13, APP14, COMMENT, before_the_scan, bytes_behind
from unshutter.photo.metadata import Metadata
from unshutter.photo.tags import exif, iptc, xmp

JFIF, XMP = b"JFIF\0", b"http://ns.adobe.com/xap/1.0/\0"
_MORE_XMP, _PICTURES = b"http://ns.adobe.com/xmp/extension/\0", b"MPF\0"
_WANTED = (*range(APP0, APP0 + 16), COMMENT)
# Segments that libvips reads, or that only say how this file is coded.
_READ: dict[int, tuple[bytes, ...]] = {
    APP0: (JFIF, b"JFXX\0", b"AVI1"),
    APP1: (exif.PREFIX, XMP),
    APP2: (b"ICC_PROFILE\0",),
    APP13: (iptc.PREFIX,),
    APP14: (b"Adobe",),
}


def with_segments(metadata: Metadata, file: BinaryIO) -> Metadata:
    """The metadata that libvips found in a JPEG with those that it did not hand on, or not well.

    Args:
        metadata: as libvips sees them.
        file: the JPEG.

    Returns:
        EXIF (libvips takes it apart, and may be caught in it), density, comments, Photoshop's resources of several
        segments, and the film of a motion photo; with the names of what else there is, and no result gets.
    """
    segments = list(before_the_scan(file, _WANTED))
    first_exif = next(iter(_beginning(segments, APP1, exif.PREFIX)), None)
    blob = None if first_exif is None else exif.untangled(first_exif)
    resources = _beginning(segments, APP13, iptc.PREFIX)
    left_behind = [name for marker, content in segments if (name := _lost(marker, content, metadata.xmp))]
    if blob is not first_exif:
        left_behind.append("EXIF (damaged)")
    film = film_of(file, xmp.film_bytes(metadata.xmp))
    if film is not None:
        left_behind += film.left_behind
    for prefix, name in ((exif.PREFIX, "a second EXIF"), (XMP, "a second XMP")):
        if len(_beginning(segments, APP1, prefix)) > 1:
            left_behind.append(name)
    has_pictures = _beginning(segments, APP2, _PICTURES) or xmp.has_gain_map(metadata.xmp)  # which have names
    if not has_pictures and bytes_behind(file) > (film.taken_from if film else 0):
        left_behind.append("data behind the picture")
    return replace(
        metadata,
        exif=blob,
        density=_density(segments),
        resources=iptc.joined(resources) if resources else None,
        segments=tuple(segment for segment in segments if segment[0] == COMMENT),
        film=film,
        left_behind=tuple(dict.fromkeys(left_behind)),
    )


def _beginning(segments: list[tuple[int, bytes]], wanted: int, prefix: bytes) -> list[bytes]:
    return [content for marker, content in segments if marker == wanted and content.startswith(prefix)]


def _density(segments: list[tuple[int, bytes]]) -> tuple[int, int, int] | None:
    header = next((content for content in _beginning(segments, APP0, JFIF) if len(content) >= 12), None)
    return None if header is None else struct.unpack_from(">BHH", header, 7)


def _lost(marker: int, content: bytes, packet: bytes | None) -> str:
    """The name of what no result gets; empty for segments that go along or are only about this file."""
    if marker == COMMENT or content.startswith(_READ.get(marker, b"\0nothing")):
        return ""
    if marker == APP1 and content.startswith(_MORE_XMP):
        return "XMP beyond the first 64 kB"
    if marker == APP2 and content.startswith(_PICTURES):
        return "" if xmp.has_gain_map(packet) else "previews or further pictures"  # a gain map is named as such
    return f"data of other programs (APP{marker - APP0})"
