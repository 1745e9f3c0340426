"""The audit of a new video that FFmpeg wrote: what its clip's file held that it lacks.

FFmpeg keeps what it knows: streams, tags, chapters. So the new file is read again, and compared with the clip's: tags
and chapters as FFmpeg reads them, and the parts of other files that it passes over.

Sources: ISO/IEC 14496-12; RFC 9559 (Matroska); Microsoft, AVI RIFF File Reference.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from unshutter.frames import pyav
from unshutter.inventory import Fate, Part
from unshutter.photo.boxes import inside, top_level_extents
from unshutter.video.file import containers, mp4_film
from unshutter.video.file.mp4 import DAMAGE, Movie, Track
from unshutter.video.file.mp4_film import DOLBY_VISION, words
from unshutter.video.file.mp4_inventory import CREDENTIALS, behind_and_between, is_signature

# FFmpeg's names of frames' side data -> for people; what decoding uses up is not listed as lost
_SIDE_DATA = {
    "A53_CC": Part("closed captions in the frames", Fate.LEFT_OUT),
    "DYNAMIC_HDR_PLUS": Part("HDR10+", Fate.LEFT_OUT, "it describes the old frames"),
    "DYNAMIC_HDR_VIVID": Part("HDR Vivid", Fate.LEFT_OUT, "it describes the old frames"),
    **dict.fromkeys(("DOVI_METADATA", "DOVI_RPU_BUFFER", "DOVI_RPU_BUFFER_T35"), DOLBY_VISION),
    **dict.fromkeys(("S12M_TIMECODE", "GOP_TIMECODE"), Part("timecode in the frames", Fate.LEFT_OUT)),
    "STEREO3D": Part("arrangement of two views", Fate.LEFT_OUT),
    "SEI_UNREGISTERED": Part("data of the camera in the frames", Fate.LEFT_OUT),
}
_USED_UP = ("FILM_GRAIN_PARAMS", "VIDEO_ENC_PARAMS", "MOTION_VECTORS", "QP_TABLE_DATA", "QP_TABLE_PROPERTIES")
_OF_ENCODERS = (bytes.fromhex("dc45e9bde6d948b7962cd820d923eeef"), bytes.fromhex("2ca2de09b51747dbbb55a4fe7fc2fc4e"))
_EMPTY = {"SEI_UNREGISTERED": _OF_ENCODERS, "STEREO3D": (bytes(4),)}  # side data that say nothing, by how they begin
# tags that describe the file or its coding, not what is in it
_OF_FILES = (
    *("encoder", "major_brand", "minor_version", "compatible_brands", "handler_name", "vendor_id", "rotate", "bps"),
    *("duration", "number_of_", "timecode", "wm/", "isvbr", "uid", "generation_uid", "product_", "company_name"),
    *("toolkit_version", "application_platform", "modification_date", "operational_pattern", "file_package", "source_"),
    *("material_package", "_statistics", "audiocodec", "videocodec", "filesize", "metadatacreator", "software"),
    *("variant_bitrate", "filename", "mimetype", containers.ALPHA_MODE),
)
_BOXES = (b"ftyp", b"styp", b"moov", b"mdat", b"moof", b"sidx", b"mfra", b"wide", b"prft", b"pdin", b"ssix")
_MOVIE_BOXES = (b"mvhd", b"trak", b"iods", b"mvex", b"meta")
_TRACK_BOXES = (b"tkhd", b"edts", b"mdia", b"tref", b"meta", b"tapt", b"load")
_OF_PLAYERS = (b"meta", b"chpl", b"name", b"hnti", b"hinf", b"WLOC", b"SelO", b"AllF", b"tagc")
_FFMPEGS = (b"colr", b"pasp", b"clli", b"mdcv", b"gama", b"chrm")  # descriptions of a film that FFmpeg writes, too
_BLANK = (b"free", b"skip", b"JUNK", b"PAD ")
_CHUNKS = (b"avih", b"strh", b"strf", b"strn", b"indx", b"vprp", b"dmlh", b"idx1", b"IDIT")
_MXF_TEXT = re.compile(rb"(?:\0[\x20-\x7e]){6,}")  # in UTF-16
_MOST_CHUNKS = 10_000
_LONGEST = 1 << 20  # bytes read of a part


def parts(source: containers.VideoFile, target: str, carried: Iterable[Any], is_part: bool) -> Iterator[Part]:
    """Yields what became of a clip's tags and chapters in a video that FFmpeg wrote, and what else that lacks.

    Args:
        source: the clip's file, open, and read.
        target: path of the video.
        carried: streams of the clip that the video has.
        is_part: whether it is only a part of the clip.
    """
    with containers.opened(target) as new:
        tags = _tags([new.container, *new.container.streams]) | containers.creation_time(new)
        values = set(tags.values())
        old = _tags([source.container, source.video, *carried]) | containers.creation_time(source)
        chapters = len(source.container.chapters()), len(new.container.chapters())
    old = {name: value for name, value in old.items() if not _is_of_files(name, value)}
    names = [name for name, value in old.items() if value not in values]
    if len(names) < len(old):
        yield Part("tags", Fate.CARRIED)
    if names:
        yield Part(f"tags ({', '.join(names)})", Fate.LEFT_OUT)
    if chapters[0]:
        kept = Fate.TRANSFORMED if is_part else Fate.CARRIED
        yield Part("chapters", kept if is_part or chapters[1] >= chapters[0] else Fate.LEFT_OUT)
    known = {value for each in (source.container, *source.container.streams) for value in pyav.tags(each).values()}
    known = {value.encode() for value in known if len(value) > 1}
    with suppress(*DAMAGE):
        if source.container.format.name == "avi":
            yield from _chunks(source.stream, known)
        elif source.container.format.name == "mxf":
            yield from _mxf_texts(source.stream, Path(target), known)
        elif "matroska" in source.container.format.name:
            yield from _texts_of_matroska(source.stream, source.container.chapters(), known)
        elif "mp4" in source.container.format.name:
            yield from _boxes(source.stream, source.video.id, known)


def _mxf_texts(stream: BinaryIO, target: Path, known: set[bytes]) -> Iterator[Part]:
    """Yields the texts of an MXF header, such as names of tracks, if some are neither tags nor in the new file."""
    stream.seek(0)
    with target.open("rb") as new:
        before, after = (_MXF_TEXT.findall(each.read(_LONGEST)) for each in (stream, new))
    if any(text.decode("utf-16-be").encode() not in known for text in {*before} - {*after}):
        yield Part("texts of the MXF header", Fate.LEFT_OUT)


def lost_of_frames(before: dict[str, bytes], after: dict[str, bytes]) -> Iterator[Part]:
    """Yields what frames of the clip hold next to their pixels, and those of the new video lack."""
    for name, data in before.items():
        if name in after or name in _USED_UP or data.startswith(_EMPTY.get(name, ())):
            continue
        yield _SIDE_DATA.get(name, Part(f"{name.lower().replace('_', ' ')} in the frames", Fate.LEFT_OUT))


def _tags(holders: Iterable[Any]) -> dict[str, str]:
    return {name: value for holder in holders for name, value in pyav.tags(holder).items()}


def _is_of_files(name: str, value: str) -> bool:
    return name.lower().startswith(_OF_FILES) or (name == "language" and value == "und")


# ---- MP4 and QuickTime ----------------------------------------------------------------------------------------------


def _boxes(stream: BinaryIO, number: int, known: set[bytes]) -> Iterator[Part]:
    """Yields what FFmpeg passes over in an MP4 or QuickTime file, but for what contains a tag that it knows."""
    names: list[bytes] = []
    for name, start, end in top_level_extents(stream):
        stream.seek(start)
        content = stream.read(min(end - start, _LONGEST))
        if is_signature(name, content):
            yield CREDENTIALS
        elif name == b"moov":
            stream.seek(start)
            movie = stream.read(end - start)
            names += _unknown(movie, _MOVIE_BOXES, known)
            for track in (Track(inner) for kind, inner in inside(movie) if kind == b"trak"):
                names += _unknown(track.content, _TRACK_BOXES, known)
                if track.number == number:
                    names += [kind for kind in mp4_film.carried(track) if kind not in _FFMPEGS]
        elif not _is_known(name, content, _BOXES, known):
            names.append(name)
    if names:
        yield Part(f"boxes {', '.join(dict.fromkeys(map(words, names)))}", Fate.LEFT_OUT)
    with suppress(*DAMAGE):
        movie = Movie.read(stream)
        for part, ranges in behind_and_between(movie):
            if any(movie.read_at(start, min(end - start, _LONGEST)).strip(b"\0") for start, end in ranges):
                yield Part(part, Fate.LEFT_OUT)


def _unknown(content: bytes, structure: tuple[bytes, ...], known: set[bytes]) -> Iterator[bytes]:
    """Yields the types of the boxes in another that FFmpeg passes over, and of those among the user's data."""
    for name, inner in inside(content):
        if name == b"udta":
            yield from _unknown(inner, _OF_PLAYERS, known)
        elif not _is_known(name, inner, structure, known):
            yield name


def _is_known(name: bytes, content: bytes, structure: tuple[bytes, ...], known: set[bytes]) -> bool:
    """Whether a box or chunk is of a known type, blank, or holds a value that FFmpeg knows as a tag."""
    if name in structure or not content.strip(b"\0 "):
        return True
    return name not in _BLANK and any(value in content for value in known)


# ---- Matroska -------------------------------------------------------------------------------------------------------

# elements that FFmpeg passes over -> for people; of the names and languages of chapters, it takes some
_TEXTS = {
    0x85: "further names of chapters",
    0x437C: "languages of chapters",
    0x437D: "languages of chapters",
    0x437E: "countries of chapters",
    0x22B59D: "regional languages of tracks",
    0x447B: "regional languages of tags",
}
_OF_CHAPTERS = (0x85, 0x437C, 0x437D, 0x437E)
_HOLDERS = (
    *(0x18538067, 0x1043A770, 0x45B9, 0xB6, 0x80),  # segment, chapters, edition, chapter, what is shown of it
    *(0x1654AE6B, 0xAE, 0x1254C367, 0x7373, 0x67C8),  # tracks, a track, tags, those of one thing, a tag
)


def _texts_of_matroska(stream: BinaryIO, chapters: Iterable[Any], known: set[bytes]) -> Iterator[Part]:
    """Yields the names, languages and countries that FFmpeg passes over: of chapters, it takes the first edition's."""
    taken = {value.encode() for chapter in chapters for value in chapter["metadata"].values()} | {b"", b"und"}
    names = dict.fromkeys(
        _TEXTS[kind]
        for kind, value in _texts_in(stream, 0, stream.seek(0, os.SEEK_END))
        if value not in taken and (kind in _OF_CHAPTERS or _is_regional(value, known))
    )
    yield from (Part(name, Fate.LEFT_OUT) for name in names)


def _is_regional(language: bytes, known: set[bytes]) -> bool:
    """Whether a language is another than the one of three letters next to it."""
    return len(language) > 2 and language not in known


def _texts_in(stream: BinaryIO, at: int, end: int) -> Iterator[tuple[int, bytes]]:
    for _ in range(_MOST_CHUNKS):
        if at + 2 > end:
            return
        stream.seek(at)
        head = stream.read(12)
        kind, length = _number(head)
        size, more = _number(head[length:])
        start = at + length + more
        at = start + (size & (1 << 7 * more) - 1)
        if kind in _HOLDERS:
            yield from _texts_in(stream, start, min(at, end))
        elif kind in _TEXTS:
            stream.seek(start)
            yield kind, stream.read(min(at - start, _LONGEST)).rstrip(b"\0")


def _number(data: bytes) -> tuple[int, int]:
    """Returns a number with the bits that say how long it is, and its length [bytes]."""
    length = 9 - data[0].bit_length()
    return int.from_bytes(data[:length], "big"), length


# ---- AVI ------------------------------------------------------------------------------------------------------------


def _chunks(stream: BinaryIO, known: set[bytes]) -> Iterator[Part]:
    """Yields what FFmpeg passes over in an AVI file."""
    names = dict.fromkeys(
        name
        for name, content in _leaves(stream, 0, stream.seek(0, os.SEEK_END))
        if not _is_known(name, content, _CHUNKS, known) and not _is_filler(name, content)
    )
    if names:
        yield Part(f"chunks {', '.join(map(words, names))}", Fate.LEFT_OUT)


def _is_filler(name: bytes, content: bytes) -> bool:
    """Whether a chunk keeps room and holds anything: cameras write a name of theirs where they use such a chunk."""
    return name in _BLANK and (not content[:4].isalnum() or content.startswith(b"odml"))


def _leaves(stream: BinaryIO, at: int, end: int) -> Iterator[tuple[bytes, bytes]]:
    """Yields the types and contents of the chunks between two positions that hold no others, but for the samples."""
    for _ in range(_MOST_CHUNKS):
        if at + 8 > end:
            return
        stream.seek(at)
        name, size = struct.unpack("<4sI", stream.read(8))
        kind = stream.read(4) if name in (b"RIFF", b"LIST") else b""
        if kind and kind != b"movi":
            yield from _leaves(stream, at + 12, min(at + 8 + size, end))
        elif not kind:
            yield name, stream.read(min(size, _LONGEST))
        at += 8 + size + size % 2
