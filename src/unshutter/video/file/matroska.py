"""Colours of films in Matroska: what FFmpeg's muxer states of a stream, and light levels that PyAV cannot give it.

Source: RFC 8794 (EBML), RFC 9559 (Matroska: SeekHead, Void, Tracks, Colour, MasteringMetadata).
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO, NamedTuple

from unshutter.frames.pyav import av

_SEGMENT, _SEEK_HEAD, _SEEK, _TRACKS, _TRACK, _CLUSTER = 0x18538067, 0x114D9B74, 0x4DBB, 0x1654AE6B, 0xAE, 0x1F43B675
_POSITION, _VOID, _CHECKSUM, _VIDEO, _COLOUR = 0x53AC, 0xEC, 0xBF, 0xE0, 0x55B0
_ACROSS, _DOWN = 0x55B7, 0x55B8  # where chroma lies: 1 at pixels, 2 halfway between them
_MAX_CLL, _MAX_FALL, _MASTERING, _RED_X, _BRIGHTEST, _DARKEST = 0x55BC, 0x55BD, 0x55D0, 0x55D1, 0x55D9, 0x55DA
_MOST_HEAD = 1 << 20  # bytes before the first frame
# names in FFmpeg; the usual place is not stated
_CHROMA = {(1, 1): "topleft", (2, 2): "center", (2, 1): "top"}


class _Element(NamedTuple):
    name: int
    head: int  # where it begins
    start: int  # where its content begins
    end: int


def _elements(data: bytes, at: int, end: int) -> Iterator[_Element]:
    """Yields the elements in a part of a file, up to the first frame."""
    end = min(end, len(data))
    while at < end and data[at]:
        size_at = at + 9 - data[at].bit_length()
        name = int.from_bytes(data[at:size_at], "big")
        if size_at >= end or not data[size_at] or name == _CLUSTER:
            return
        start = size_at + 9 - data[size_at].bit_length()
        bits = 7 * (start - size_at)
        size = int.from_bytes(data[size_at:start], "big") & ((1 << bits) - 1)
        is_open = name == _SEGMENT or size == (1 << bits) - 1
        yield _Element(name, at, start, end if is_open else start + size)
        at = start + size


def _first(data: bytes, at: int, end: int, *names: int) -> _Element:
    """Returns the first element in elements with such names; raises KeyError if there is none."""
    for each in _elements(data, at, end):
        if each.name == names[0] and each.end <= end:
            return each if len(names) == 1 else _first(data, each.start, each.end, *names[1:])
    raise KeyError(names[0])


def _encoded(name: int, content: bytes, width: int = 0) -> bytes:
    """Returns an element; the width of its size is the least by default [bytes]."""
    size = len(content)
    width = width or next(width for width in range(1, 9) if size < (1 << 7 * width) - 1)
    return name.to_bytes((name.bit_length() + 7) // 8, "big") + (size | 1 << 7 * width).to_bytes(width, "big") + content


def _changed(data: bytes, of: _Element, change: Callable[[_Element], bytes]) -> bytes:
    """Returns the content of an element whose elements may be changed, with the checksum of the new content."""
    parts = [(each.name, change(each)) for each in _elements(data, of.start, of.end)]
    content = b"".join(part for name, part in parts if name != _CHECKSUM)
    if not parts or parts[0][0] != _CHECKSUM:
        return content
    return _encoded(_CHECKSUM, struct.pack("<I", zlib.crc32(content))) + content


# ---- chroma ------------------------------------------------------------------------------------------------------


def chroma_location(stream: Any) -> str:
    """Returns where the chroma of a stream's frames lies, in FFmpeg's words; empty for the usual place, or unknown.

    PyAV does not tell, but FFmpeg's muxer for Matroska writes it.
    """
    file = io.BytesIO()
    try:
        with av().open(file, "w", format="matroska") as container:
            container.add_stream_from_template(stream)
            container.start_encoding()
        data = file.getvalue()
        colour = _first(data, 0, len(data), _SEGMENT, _TRACKS, _TRACK, _VIDEO, _COLOUR)
        across, down = (_first(data, colour.start, colour.end, each) for each in (_ACROSS, _DOWN))
    except (ValueError, KeyError, av().error.FFmpegError):
        return ""
    return _CHROMA.get((data[across.end - 1], data[down.end - 1]), "")


# ---- light levels ------------------------------------------------------------------------------------------------


def light_elements(mastering: list[float], levels: tuple[int, int] | None) -> bytes:
    """Returns a mastering display and light levels as elements of Colour.

    Args:
        mastering: x and y of red, green, blue and white, then the least and the greatest luminance [cd/m²], or nothing.
        levels: of the brightest pixel, and of the brightest frame on average [cd/m²].
    """
    elements = b""
    if mastering:
        names = (*range(_RED_X, _RED_X + 8), _DARKEST, _BRIGHTEST)
        pairs = zip(names, mastering, strict=True)
        elements = _encoded(_MASTERING, b"".join(_encoded(name, struct.pack(">f", value)) for name, value in pairs))
    for name, level in zip((_MAX_CLL, _MAX_FALL), levels or (), strict=False):
        elements += _encoded(name, struct.pack(">I", level))
    return elements


def state_light(file: BinaryIO, elements: bytes) -> None:
    """Adds elements to Colour of the first film, in the gap that FFmpeg leaves before; nothing if that is too small."""
    file.seek(0)
    data = file.read(_MOST_HEAD)
    try:
        segment = _first(data, 0, len(data), _SEGMENT)
        seeking, gap, tracks = (_first(data, segment.start, segment.end, each) for each in (_SEEK_HEAD, _VOID, _TRACKS))
        film = _first(data, tracks.start, tracks.end, _TRACK, _VIDEO)
    except KeyError:
        return

    def with_light(each: _Element) -> bytes:
        if each.name == _COLOUR:
            return _encoded(_COLOUR, data[each.start : each.end] + elements)
        if each.head <= film.head < each.end:
            has_colour = each != film or any(inner.name == _COLOUR for inner in _elements(data, film.start, film.end))
            return _encoded(
                each.name, _changed(data, each, with_light) + (b"" if has_colour else _encoded(_COLOUR, elements))
            )
        return data[each.head : each.end]

    new_tracks = with_light(tracks)
    growth = len(new_tracks) - (tracks.end - tracks.head)
    left = gap.end - gap.head - growth
    if left < 2 or gap.head != seeking.end or gap.end > tracks.head:
        return

    def moved(each: _Element) -> bytes:
        if each.name == _SEEK:
            return _encoded(_SEEK, _changed(data, each, moved))
        at = int.from_bytes(data[each.start : each.end], "big")
        if each.name != _POSITION or not gap.end <= segment.start + at <= tracks.head:
            return data[each.head : each.end]
        return _encoded(_POSITION, (at - growth).to_bytes(each.end - each.start, "big"))

    width = 1 if left < 100 else 8
    void = _encoded(_VOID, bytes(left - 1 - width), width)
    head = _encoded(_SEEK_HEAD, _changed(data, seeking, moved)) + void + data[gap.end : tracks.head] + new_tracks
    if len(head) == tracks.end - seeking.head:
        file.seek(seeking.head)
        file.write(head)
