"""The film's track of MP4 and QuickTime files, with the samples of another one: its tables, and what describes it.

FFmpeg writes only what it knows of a track. So the tables of samples are taken from what it wrote, and all else from
the original, unless it describes the old samples.

Sources: ISO/IEC 14496-12 (clap, pasp, colr); QuickTime File Format Specification (tapt); Dolby Vision Streams Within
the ISO Base Media File Format; Apple, Stereo Video: ISOBMFF Extensions (vexu, hfov).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from unshutter.inventory import Fate, Part
from unshutter.photo.boxes import inside
from unshutter.video.file.dynamic_hdr import DOLBY_BOXES
from unshutter.video.file.mp4 import FULL, STBL, VISUAL, Track, box, offsets_box, rebuilt

_SIZE_AT = 24  # of width and height in a visual sample entry
_REWRITTEN = (b"tkhd", b"edts", b"tapt", b"mdia")  # boxes of the film's track
_LONGEST = 0xFFFFFFFF >> 1  # time units of an edit with 32 bits
DOLBY_VISION = Part("Dolby Vision", Fate.LEFT_OUT, "it describes the old frames")
_LAYERS = (b"lhvC", b"mvcC")  # boxes of a sample entry: the coding of a layer for the other eye
# what becomes of boxes of a sample entry that say how the samples are coded; any other is carried
_CODING = {
    **dict.fromkeys(
        (
            *(b"avcC", b"hvcC", b"vvcC", b"av1C", b"vpcC", b"esds", b"glbl", b"d263", b"strf", b"SMI ", b"jp2h"),
            *(b"ACLR", b"APRG", b"ARES", b"AVIN", b"alpC", b"btrt", b"bitr", b"fiel"),
        ),
        Part("configuration of the codec", Fate.REPLACED),
    ),
    **dict.fromkeys(
        (*DOLBY_BOXES, b"hvcE", b"avcE"),
        DOLBY_VISION,
    ),
    **dict.fromkeys(_LAYERS, Part("the other eye's view", Fate.LEFT_OUT, "the encoder writes one view")),
}
_REMADE = (b"colr", b"pasp", b"clli", b"mdcv", b"clap")  # FFmpeg writes these, too, or they follow the frames' size
# boxes with tables of the samples
_TABLES = {
    *(b"stsd", b"stts", b"ctts", b"cslg", b"stss", b"stps", b"stsh", b"stsz", b"stz2", b"stsc", b"stco", b"co64"),
    *(b"sdtp", b"sbgp", b"sgpd", b"csgp", b"padb", b"stdp", b"subs", b"saiz", b"saio", b"stsl"),
}


class Window(NamedTuple):
    """The part of each frame that is kept."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True)
class Replacement:
    """A film's track, and that which provides its new samples."""

    film: Track
    video: Track
    scales: tuple[int, int]  # time units per second of the film's file, and of the other
    corner: tuple[int, int]  # left and top side of the part of each frame that is kept [px]
    dolby_vision: bool = False  # whether the new samples have that of the old ones
    light: Sequence[tuple[bytes, bytes]] = ()  # further descriptions, unless the film has such

    def track(self, starts: np.ndarray, is_wide: bool) -> bytes:
        """Returns the content of the new track, with the film's own names, times and tags.

        Args:
            starts: positions of the samples in the new file [bytes].
            is_wide: whether these have 64 bits.
        """

        def table(name: bytes, content: bytes) -> bytes | None:
            if name == b"stsd":
                return box(name, self._described(content))
            if name == b"stsc":  # one sample per chunk, so that sound can be interleaved
                return box(name, struct.pack(">IIIII", 0, 1, 1, 1, 1))
            return offsets_box(starts, is_wide) if name in (b"stco", b"co64") else None

        tables = box(b"stbl", rebuilt(self.video.part(*STBL), table))
        with_tables = rebuilt(self.film.content, lambda name, _: tables if name == b"stbl" else None, *STBL[:-1])
        with_header = rebuilt(rebuilt(with_tables, self._media, b"mdia"), self._header)
        return with_descriptions(with_header, self.light)

    @property
    def _window(self) -> Window:
        return Window(*self.corner, *_size(self.video))

    def _described(self, theirs: bytes) -> bytes:
        """Returns the new ``stsd`` content, its first entry with what the film's said of it but not of its coding."""
        (kind, content), *more = inside(theirs[FULL + 4 :])
        known = {_kind_of(*each) for each in inside(content[VISUAL:])}
        added = b""
        for name, extra in self.film.descriptions:
            is_carried = _part_of(name, self.film, self.dolby_vision).fate is Fate.CARRIED
            if name == b"clap" and self._window[2:] != _size(self.film):
                added += _clap(self.film, self._window)
            elif is_carried and _kind_of(name, extra) not in known:
                added += box(name, extra)
        return theirs[: FULL + 4] + box(kind, _extended(content, added)) + b"".join(box(*each) for each in more)

    def _header(self, name: bytes, content: bytes) -> bytes | None:
        """Returns what replaces a box of the track outside its media; None if nothing does."""
        movie_scale, video_scale = self.scales
        theirs = self.video.part(b"tkhd")
        is_cut = self._window[2:] != _size(self.film)
        if name == b"edts":
            return b""
        if name == b"tkhd":
            header = bytearray(content)
            _set_duration(header, 20, _duration(theirs, 20) * movie_scale // video_scale)
            if is_cut:
                header[-8:] = theirs[-8:]
            return box(name, bytes(header)) + _edits(self.video, movie_scale, video_scale)
        return box(name, _apertures(content, self.film, self._window)) if name == b"tapt" and is_cut else None

    def _media(self, name: bytes, content: bytes) -> bytes | None:
        """Returns what replaces a box of the track's media; None if nothing does."""
        if name != b"mdhd":
            return None
        header = bytearray(content)
        struct.pack_into(">I", header, 20 if header[0] else 12, self.video.timescale)
        _set_duration(header, 16, _duration(self.video.part(b"mdia", b"mdhd"), 16))
        return box(name, bytes(header))


def parts(film: Track, dolby_vision: bool = False) -> Iterator[Part]:
    """Yields what becomes of the boxes of the film's track that its new samples might contradict.

    Args:
        dolby_vision: whether the new samples have that of the old ones.
    """
    for name, content in inside(film.part(*STBL)):
        if name not in _TABLES:
            reason = "it describes the old frames one by one"
            yield Part(f"table {words(name)} of the film", Fate.LEFT_OUT, reason, len(content))
    for name, content in film.descriptions:
        yield replace(_part_of(name, film, dolby_vision), size=len(content))
    if any(edit.start >= 0 and edit.rate != 1 for edit in film.edits):
        yield Part("speed of the film's edits", Fate.LEFT_OUT, "it plays as fast as it was recorded")


def _part_of(name: bytes, film: Track, dolby_vision: bool = False) -> Part:
    """Returns what becomes of a box of the film's sample entry."""
    if name in DOLBY_BOXES and dolby_vision:
        return Part(DOLBY_VISION.name, Fate.CARRIED)
    if name == b"vexu" and any(each in _LAYERS for each, _ in film.descriptions):
        return _CODING[_LAYERS[0]]
    return _CODING.get(name, Part(f"description {words(name)} of the film", Fate.CARRIED))


def carried(film: Track) -> list[bytes]:
    """Returns the types of the boxes of the film's sample entry that do not depend on its coding."""
    return [name for name, _ in film.descriptions if _part_of(name, film).fate is Fate.CARRIED]


def kept(film: Track) -> set[bytes]:
    """Returns the boxes of the film's track that are kept whatever its samples."""
    levels = (((), _REWRITTEN), ((b"mdia",), (b"mdhd", b"minf")), ((b"mdia", b"minf"), (b"stbl",)))
    found = {box(*each) for path, but in levels for each in inside(film.part(*path)) if each[0] not in but}
    descriptions = set(carried(film)) - set(_REMADE)
    return found | {box(*each) for each in film.descriptions if each[0] in descriptions}


def with_descriptions(track: bytes, added: Sequence[tuple[bytes, bytes]]) -> bytes:
    """Returns the content of a film's track with further boxes in its first sample entry, unless it has such."""

    def described(name: bytes, content: bytes) -> bytes | None:
        if name != b"stsd":
            return None
        (kind, entry), *more = inside(content[FULL + 4 :])
        known = {each for each, _ in inside(entry[VISUAL:])}
        entry = _extended(entry, b"".join(box(*each) for each in added if each[0] not in known))
        return box(name, content[: FULL + 4] + box(kind, entry) + b"".join(box(*each) for each in more))

    return rebuilt(track, described, *STBL) if added else track


def _extended(entry: bytes, added: bytes) -> bytes:
    """Returns a sample entry with further boxes, before the zeros that end the list in QuickTime."""
    end = VISUAL + sum(8 + len(content) for _, content in inside(entry[VISUAL:]))
    return entry[:end] + added + entry[end:]


def words(name: bytes) -> str:
    """Returns the type of a box for people."""
    return "'" + "".join(each if each.isprintable() else "?" for each in name.decode("latin-1")) + "'"


def _kind_of(name: bytes, content: bytes) -> bytes:
    """Returns what tells a box from others in an entry: colours are given as codes and as a profile."""
    return name + (content[:4].replace(b"nclc", b"nclx") if name == b"colr" else b"")


class _Span(NamedTuple):
    """What is shown of a side of the frames."""

    length: Fraction  # [px]
    offset: Fraction  # of its middle from the middle of the side [px]

    def within(self, full: int, begin: int, kept: int) -> _Span:
        """Returns what is shown of a part of a side that begins somewhere on the full one [px]."""
        first = max(self.offset + (full - self.length) / 2 - begin, Fraction(0))
        last = min(self.offset + (full + self.length) / 2 - begin, Fraction(kept))
        return _Span(last - first, (first + last - kept) / 2)


def _clean_aperture(film: Track) -> tuple[_Span, _Span]:
    """Returns what is shown of the width and height of the film's frames."""
    clap = dict(film.descriptions).get(b"clap", b"")
    if len(clap) < 32:
        width, height = (Fraction(side) for side in _size(film))
        return _Span(width, Fraction(0)), _Span(height, Fraction(0))
    numbers = struct.unpack(">IIIIiIiI", clap[:32])
    across, down, right, below = (Fraction(n, d or 1) for n, d in zip(numbers[::2], numbers[1::2], strict=True))
    return _Span(across, right), _Span(down, below)


def _aperture_of(film: Track, window: Window) -> tuple[_Span, _Span]:
    """Returns what is shown of the width and height of a part of the film's frames."""
    width, height = _size(film)
    across, down = _clean_aperture(film)
    return across.within(width, window.left, window.width), down.within(height, window.top, window.height)


def _clap(film: Track, window: Window) -> bytes:
    """Returns the box that says what is shown of a part of the frames; empty if that is all of it, or nothing."""
    across, down = _aperture_of(film, window)
    if (across.length, down.length) == window[2:] or min(across.length, down.length) <= 0:
        return b""
    numbers = (across.length, down.length, across.offset, down.offset)
    return box(b"clap", struct.pack(">IIIIiIiI", *(n for number in numbers for n in number.as_integer_ratio())))


def _apertures(tapt: bytes, film: Track, window: Window) -> bytes:
    """Returns the sizes of the track's apertures for a part of the frames: of what is shown (``clef``), and of all."""
    before, after = _clean_aperture(film), _aperture_of(film, window)
    clean = [new.length / (old.length or 1) for old, new in zip(before, after, strict=True)]
    whole = [Fraction(new, old or 1) for old, new in zip(_size(film), window[2:], strict=True)]

    def change(name: bytes, content: bytes) -> bytes:
        sides = struct.unpack(">II", content[FULL : FULL + 8])
        scales = clean if name == b"clef" and min(clean) > 0 else whole
        return box(
            name, content[:FULL] + struct.pack(">II", *(round(a * b) for a, b in zip(sides, scales, strict=True)))
        )

    return rebuilt(tapt, change)


def _size(track: Track) -> tuple[int, int]:
    """Returns width and height of the frames [px]."""
    width, height = struct.unpack_from(">HH", track.entry[1], _SIZE_AT)
    return width, height


def _edits(video: Track, scale: int, theirs: int) -> bytes:
    """Returns the edit list of a track with lengths in the units of another file; empty if it has none."""
    edits = video.edits
    if not edits:
        return b""
    wide = any(edit.length * scale // theirs > _LONGEST for edit in edits)
    form = ">Qqi" if wide else ">Iii"
    content = struct.pack(">B3xI", wide, len(edits))
    content += b"".join(struct.pack(form, edit.length * scale // theirs, edit.start, 1 << 16) for edit in edits)
    return box(b"edts", box(b"elst", content))


def _duration(header: bytes, at: int) -> int:
    """Returns the duration in tkhd (at 20) or mdhd (at 16), whose fields are longer in version 1."""
    if header[0]:
        return struct.unpack_from(">Q", header, at + 8)[0]
    return struct.unpack_from(">I", header, at)[0]


def _set_duration(header: bytearray, at: int, value: int) -> None:
    if header[0]:
        struct.pack_into(">Q", header, at + 8, value)
    else:
        struct.pack_into(">I", header, at, min(value, 0xFFFFFFFF))
