"""JPEG: its tables contain quality and subsampling; its metadata are segments, some of which libvips loses or cuts.

Source: ITU-T T.81 (segments, quantisation); ITU-T T.871 (JFIF); CIPA DC-008 (EXIF in APP1), DC-007 (several pictures in
APP2); Adobe, XMP specification part 3 (XMP in APP1, Photoshop's resources in APP13).
"""

from __future__ import annotations

import io
import re
import struct
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter.errors import UnshutterError
from unshutter.inventory import Fate
from unshutter.photo import chunks, exif, extended_xmp, xmp
from unshutter.photo.auxiliary_pictures import LIST_PREFIX, Auxiliaries, AuxiliaryPicture, StoredInXmp, StoredJpeg
from unshutter.photo.chunks import (
    APP0,
    APP1,
    APP2,
    APP11,
    APP13,
    APP14,
    COMMENT,
    XMP_PREFIX,
    before_the_scan,
    insert,
)
from unshutter.photo.directories import EXIF_PREFIX, read_tree
from unshutter.photo.embedded_video import appended_video
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Header, Metadata, Picture, WrittenFormat
from unshutter.photo.gain_map_metadata import ISO_PREFIX
from unshutter.photo.libvips import Source
from unshutter.photo.parts import (
    AUXILIARY,
    CONFIDENCE_MAP,
    DEPTH_MAP,
    EXTENDED_XMP,
    GAIN_MAP,
    OTHER,
    PICTURES,
    Found,
    further_picture,
    of_coding,
    purpose,
)

if TYPE_CHECKING:
    import numpy as np
    import pyvips


# Warnings about JPEGs in which no pixels are missing and which all viewers display.
_HARMLESS = re.compile(r"Invalid SOS parameters|Unknown Adobe color transform|extraneous bytes before marker 0x[de]")
_TABLES, _FRAMES = 0xDB, (0xC0, 0xC1, 0xC2)  # markers
# Luminance quantisation of quality 50, in any order (ITU-T T.81, table K.1).
_LUMINANCE = (
    *(16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29),
    *(51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121),
    *(120, 101, 72, 92, 95, 98, 112, 100, 103, 99),
)

_JFIF = b"JFIF\0"
_LONGEST_XMP_BY_LIBVIPS = 60_000  # bytes; it leaves out longer ones
_FIRST_ONLY = ("exif", "xmp")  # attributes that hold one segment
# Segments whose content is known: marker, first bytes, name, attribute of ``Metadata`` that holds it, fate otherwise.
_SEGMENTS = (
    (APP0, _JFIF, "resolution", "resolution", Fate.REPLACED),
    (APP0, b"JFXX\0", "thumbnail", "", Fate.REPLACED),
    (APP0, b"AVI1", "coding", "", Fate.REPLACED),
    (APP1, EXIF_PREFIX, "EXIF", "exif", Fate.LEFT_OUT),
    (APP1, XMP_PREFIX, "XMP", "xmp", Fate.LEFT_OUT),
    (APP1, extended_xmp.PREFIX, EXTENDED_XMP, "", Fate.LEFT_OUT),
    (APP2, b"ICC_PROFILE\0", "colour profile", "icc", Fate.LEFT_OUT),
    (APP2, LIST_PREFIX, "list of pictures", "", Fate.REPLACED),
    (APP2, ISO_PREFIX, GAIN_MAP, "auxiliaries", Fate.LEFT_OUT),
    (APP11, b"JP", "content credentials", "", Fate.LEFT_OUT),
    (APP13, chunks.RESOURCES_PREFIX, "IPTC", "resources", Fate.LEFT_OUT),
    (APP14, b"Adobe", "coding", "", Fate.REPLACED),
    (COMMENT, b"", "comment", "comments", Fate.LEFT_OUT),
)
_APPLICATION = range(APP0, APP0 + 16)
_MP_ENTRIES = 0xB002  # tag with kind, length and start of each picture
_MP_KINDS = {0x010001: "preview", 0x010002: "preview", 0x020002: DEPTH_MAP, 0x050000: GAIN_MAP}
_NEED_NO_METADATA = (DEPTH_MAP, CONFIDENCE_MAP)
_LONGEST_HEAD = 1 << 20  # bytes in which the kind of a further picture is looked for


@final
class Jpeg(WrittenFormat):
    """JPEG: 8 bits, grey or RGB, no alpha; the only format that can be decoded at a reduced size for less work."""

    loader = "jpegload"
    signature = re.compile(rb"\xff\xd8\xff")
    shrinks = (8, 4, 2)
    longest_side = 65_500
    deep = False
    grey = True
    alpha = False
    holds = frozenset({"exif", "icc", "xmp", "resources", "resolution", "comments", "video", "auxiliaries"})
    appends_pictures = True

    def read_header(self, source: Source) -> Header:
        """See Format."""
        image = picture_format.open_image(self, source)
        with source.stream() as stream:
            coding = read_coding(stream)
            metadata = _with_segments(image, source, stream).without_exif_loop()
        return picture_format.header(self, source, image, coding, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format. libjpeg only warns of damaged data."""
        try:
            return picture_format.decode_pixels(self, source, "warning", shrink=shrink)
        except UnshutterError as error:
            if not _HARMLESS.search(getattr(error.__cause__, "detail", "")):
                raise
            return picture_format.decode_pixels(self, source, shrink=shrink)

    def held_auxiliaries(self, auxiliaries: Auxiliaries) -> Auxiliaries | None:
        """See WrittenFormat. Not gain maps that are applied in other colours, which only a profile could state."""
        if not auxiliaries.alternate_has_other_colours:
            return auxiliaries
        left = tuple(each for each in auxiliaries.pictures if each.name != GAIN_MAP)
        return replace(auxiliaries, pictures=left, segments=()) if left else None

    def exif_blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """See Format."""
        for _, content in before_the_scan(file, (APP1,)):
            if content.startswith(EXIF_PREFIX):
                yield file.tell() - len(content), content

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        metadata = picture.metadata
        coding = picture.coding
        packet = metadata.xmp if len(metadata.xmp or b"") <= _LONGEST_XMP_BY_LIBVIPS else None
        written = replace(picture, metadata=replace(metadata, exif=None, xmp=packet))
        options = {
            "Q": picture.quality or coding.quality or self.row.usual_quality,
            "subsample_mode": "on" if coding.subsampled else "off",
        }
        return picture_format.encode(written, "jpegsave", path, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. If EXIF is too long, its longest tags are left out."""
        metadata = picture.metadata
        left_out = []
        added = b""
        if metadata.exif is not None:
            blob, left_out = exif.shortened(EXIF_PREFIX + metadata.exif.removeprefix(EXIF_PREFIX), chunks.LONGEST)
            added += b"" if blob is None else chunks.encoded_segment(APP1, blob)
        packet = XMP_PREFIX + (metadata.xmp or b"")
        if len(packet) > chunks.LONGEST:
            left_out.append("XMP (too long for a JPEG)")
        elif len(metadata.xmp or b"") > _LONGEST_XMP_BY_LIBVIPS:
            added += chunks.encoded_segment(APP1, packet)
        added += b"".join(chunks.encoded_segment(APP13, part) for part in chunks.split_resources(metadata.resources))
        added += b"".join(chunks.encoded_segment(COMMENT, comment) for comment in metadata.comments)
        file.seek(2)
        at = 2
        head = file.read(4)
        if head[:2] == bytes([0xFF, APP0]):  # JFIF must remain first
            at += 2 + struct.unpack(">H", head[2:])[0]
        elif metadata.jfif_density is not None:
            density = struct.pack(">BHH", *metadata.jfif_density)
            added = chunks.encoded_segment(APP0, _JFIF + b"\1\1" + density + bytes(2)) + added
        if metadata.auxiliaries is not None:
            added += metadata.auxiliaries.in_front(at + len(added), file.seek(0, io.SEEK_END) + len(added))
        if added:
            insert(file, at, added)
        file.seek(0, io.SEEK_END)
        for each in metadata.auxiliaries.behind if metadata.auxiliaries is not None else ():
            file.write(each.file)
        if metadata.video is not None:
            file.write(metadata.video.data)
        return left_out


# ---- metadata ------------------------------------------------------------------------------------------


def _with_segments(image: pyvips.Image, source: Source, file: BinaryIO) -> Metadata:
    """Completes the metadata that libvips found in a JPEG with those that it loses or truncates, and lists its parts.

    These are EXIF (which libvips takes apart), XMP (of which it may take the extension), density, comments, Photoshop's
    resources in several segments, and the video and the auxiliary pictures behind the picture.
    """
    listed: list[tuple[int, bytes, int]] = []  # marker, content, bytes of the segment
    at = 2
    for marker, content in before_the_scan(file):
        listed.append((marker, content, file.tell() - at))
        at = file.tell()
    jfif = next((content for content in _beginning(listed, APP0, _JFIF) if len(content) >= 12), None)
    prefix = chunks.RESOURCES_PREFIX  # of each segment; a block may be split between two
    parts = [part.removeprefix(prefix) for part in _beginning(listed, APP13, prefix)]
    packet = next((content.removeprefix(XMP_PREFIX) for content in _beginning(listed, APP1, XMP_PREFIX)), None)
    video = appended_video(file, xmp.video_bytes(packet))
    metadata = replace(
        picture_format.metadata_of(image),
        exif=next(iter(_beginning(listed, APP1, EXIF_PREFIX)), None),
        xmp=packet,
        density=None if jfif is None else struct.unpack_from(">BHH", jfif, 7),
        resources=prefix + b"".join(parts) if parts else None,
        comments=tuple(content for marker, content, _ in listed if marker == COMMENT),
        video=video,
    )
    behind = list(_pictures_behind(file, listed, metadata))
    size = image.height, image.width
    pictures = [
        AuxiliaryPicture(part.name, StoredJpeg(source, at, part.size, size)) for part, at in behind if part.held
    ]
    extension = extended_xmp.assembled(_beginning(listed, APP1, extended_xmp.PREFIX))
    inside = None if extension is None else extended_xmp.pictures_in(extension)
    for name, data in (inside or {}).items():
        part = further_picture(extended_xmp.PICTURES[name], len(data), "auxiliaries")
        behind.append((part, 0))
        pictures.append(AuxiliaryPicture(part.name, StoredInXmp(data, size), in_xmp=name))
    auxiliaries = _auxiliaries(pictures, listed)
    if auxiliaries is not None and inside is not None and any(each.is_nearest for each in pictures):
        auxiliaries = replace(auxiliaries, extension=extension)
    metadata = replace(metadata, auxiliaries=auxiliaries)
    found = [*_segments(listed, metadata), *(part for part, _ in behind)]
    if video is not None:
        found += [Found("film", video.taken_from, "video"), *map(Found, video.left_behind)]
    return replace(metadata, found=tuple(found))


def _auxiliaries(pictures: list[AuxiliaryPicture], listed: list[tuple[int, bytes, int]]) -> Auxiliaries | None:
    """Returns the auxiliary pictures of a JPEG, with what its segments say about them; None if there are none."""
    if not pictures:
        return None
    lists = _beginning(listed, APP2, LIST_PREFIX)
    order = "" if not lists else "<" if lists[0].startswith(LIST_PREFIX + b"II") else ">"
    blob = next(iter(_beginning(listed, APP1, EXIF_PREFIX)), None)
    auxiliaries = Auxiliaries(tuple(pictures), tuple(_beginning(listed, APP2, ISO_PREFIX)), order, exif=blob)
    return auxiliaries if auxiliaries.gain_map is not None else replace(auxiliaries, segments=())


def _beginning(listed: list[tuple[int, bytes, int]], marker: int, prefix: bytes) -> list[bytes]:
    """Returns the contents of segments with a marker that begin with a prefix."""
    return [content for own, content, _ in listed if own == marker and content.startswith(prefix)]


def _segments(listed: list[tuple[int, bytes, int]], metadata: Metadata) -> Iterator[Found]:
    """Yields a part for each segment."""
    seen: set[str] = set()
    for marker, content, size in listed:
        row = next((row for row in _SEGMENTS if row[0] == marker and content.startswith(row[1])), None)
        if row is None:
            yield Found(OTHER, size) if marker in _APPLICATION else of_coding("coding", size)
            continue
        _, _, name, held, otherwise = row
        if held in _FIRST_ONLY and held in seen:
            yield Found(OTHER, size)
        elif held == "resolution":
            yield picture_format.resolution_part(metadata, size)
        elif held == "auxiliaries":
            is_kept = metadata.auxiliaries is not None and bool(metadata.auxiliaries.segments)
            yield further_picture(name, size, held if is_kept else "")
        elif name == EXTENDED_XMP and metadata.auxiliaries is not None and metadata.auxiliaries.extension is not None:
            yield Found(name, size, "auxiliaries")
        elif held == "resources":
            yield picture_format.resources_part(metadata.resources, size)
        else:
            yield Found(name, size, held, otherwise)
        seen.add(held)


def _pictures_behind(
    file: BinaryIO, listed: list[tuple[int, bytes, int]], metadata: Metadata
) -> Iterator[tuple[Found, int]]:
    """Yields a part for each further picture, and one for other data behind the picture, with their positions.

    Auxiliary pictures are those whose own metadata say what they show, and depth maps that the photo's list.
    """
    named = xmp.names_by_length(metadata.xmp)
    kinds = _kinds_by_size(listed)
    is_listed = bool(_beginning(listed, APP2, LIST_PREFIX))
    usual = GAIN_MAP if xmp.has_gain_map(metadata.xmp) else PICTURES if is_listed else None
    end = file.seek(0, io.SEEK_END) - (metadata.video.taken_from if metadata.video else 0)
    pieces = list(chunks.pieces_behind(file, end))
    for at, size in pieces:
        in_list = named[size].pop(0) if named.get(size) else None
        file.seek(at)
        if file.read(3) == b"\xff\xd8\xff":
            head = (content for _, content in before_the_scan(file, (APP1, APP2), at))
            own = purpose(b"".join(head)[:_LONGEST_HEAD]) or (in_list if in_list in _NEED_NO_METADATA else None)
            name = own or in_list or kinds.get(size) or usual or PICTURES
            yield further_picture(name, size, "auxiliaries" if own in AUXILIARY else ""), at
        else:
            yield further_picture(in_list or kinds.get(size) or usual or OTHER, size), at
    if not pieces and usual:
        yield further_picture(usual), 0


def _kinds_by_size(listed: list[tuple[int, bytes, int]]) -> dict[int, str]:
    """Names the further pictures in the list of pictures, by their length."""
    kinds = {}
    for content in _beginning(listed, APP2, LIST_PREFIX):
        tree = read_tree(io.BytesIO(content.removeprefix(LIST_PREFIX)), most_pages=1)
        entries = tree.data(_MP_ENTRIES) or b"" if tree else b""
        for at in range(0, len(entries) - 15, 16):
            kind, size = struct.unpack_from((tree.order if tree else "<") + "II", entries, at)
            kinds[size] = _MP_KINDS.get(kind & 0xFFFFFF, PICTURES)
    return kinds


# ---- encoding ------------------------------------------------------------------------------------------


def read_coding(file: BinaryIO) -> Coding:
    """Reads the quantisation tables and the frame header; uses defaults for missing or damaged ones.

    The quality is that on libjpeg's scale whose luminance table has the sum closest to the file's, because cameras and
    Adobe programs use their own tables. Chroma with half the resolution in both directions (4:2:0), or less, counts as
    subsampled; libvips also reports that for 4:2:2.
    """
    total = None
    factors = b""
    for marker, content in before_the_scan(file, (_TABLES, *_FRAMES)):
        if marker == _TABLES:
            total = _luminance_sum(content) or total
        else:
            factors = content[7::3]  # per component, horizontal << 4 | vertical
    quality = None if total is None else _nearest_quality(total)
    return Coding(quality, subsampled=len(factors) == 3 and factors[0] >> 4 >= 2 and factors[0] & 15 >= 2)


def _nearest_quality(total: int) -> int:
    qualities = range(1, 101)  # the higher the quality, the smaller the sum
    first_below = bisect_left(qualities, -total, key=lambda quality: -_scaled_sum(quality))
    return min(qualities[max(first_below - 1, 0) : first_below + 1], key=lambda q: abs(_scaled_sum(q) - total))


def _scaled_sum(quality: int) -> int:
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    return sum(min(max((value * scale + 50) // 100, 1), 255) for value in _LUMINANCE)


def _luminance_sum(tables: bytes) -> int | None:
    """Returns the sum of quantisation table 0, if it is among these."""
    while tables:
        wide = tables[0] >> 4
        name = tables[0] & 15
        values = tables[1 : 65 + 64 * wide]
        if name == 0 and wide < 2 and len(values) == 64 * (1 + wide):
            return sum(struct.unpack(">64H", values) if wide else values)
        tables = tables[65 + 64 * wide :]
    return None
