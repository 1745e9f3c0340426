"""Reads readout times that cameras write into their clips.

GoPro: SROT, in the telemetry track [ms]. Apple: a key of the movie or of the film's track [us]. CAMM, the motion
metadata of Android and street-view cameras: packets of type 1, the skew from the first row to the last [ns].

Sources: gopro/gpmf-parser, README (GPMF's keys, lengths and values); QuickTime File Format Specification (metadata
keys); Google, Camera Motion Metadata Specification 1.0; names of keys as exiftool.org lists them (facts only).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from statistics import median

from unshutter.photo.containers.boxes import inside
from unshutter.video.mp4_movie import Movie
from unshutter.video.mp4_tracks import NotPlainError, Track

_MOST_CHUNKS, _LONGEST_CHUNK = 20, 1 << 22  # most chunks of a track that are read; most bytes of one
_SHORTEST_MS, _LONGEST_MS = 0.1, 1000.0  # plausible readout times
_APPLE_KEY = b"com.apple.quicktime.camera.framereadouttimeinmicroseconds"
_NESTED = 0  # type of GPMF entries that hold entries
_GPMF_NUMBERS = {b"f": ">f", b"d": ">d", b"l": ">i", b"L": ">I", b"s": ">h", b"S": ">H"}
_CAMM_BYTES = {0: 12, 1: 8, 2: 12, 3: 12, 4: 12, 5: 24, 6: 56, 7: 12}  # bytes of a packet's content, by its type
_CAMM_EXPOSURE = 1
_KEY_NUMBERS = {(23, 4): ">f", (24, 8): ">d"}  # (well-known type, bytes) of floating-point values
_TEXT, _SIGNED, _UNSIGNED = 1, (21, 65, 66, 67, 74), (22, 75, 76, 77, 78)


@dataclass(frozen=True)
class ReadoutTag:
    """A readout time stated in a clip's file.

    Attributes:
        ms: from the first row to the last [ms].
        writer: maker or format that wrote it.
    """

    ms: float
    writer: str


def readout_tag(path: str) -> ReadoutTag | None:
    """Reads the readout time stored by a clip's camera; returns None if it is missing or implausible.

    Args:
        path: path of an MP4 or QuickTime file; other files have none.
    """
    with suppress(OSError, NotPlainError, KeyError, struct.error, IndexError, ValueError), open(path, "rb") as stream:
        movie = Movie.read(stream)
        for writer, times in (("Apple", _apple(movie)), ("GoPro", _gopro(movie)), ("CAMM", _camm(movie))):
            plausible = [ms for ms in times if _SHORTEST_MS <= ms <= _LONGEST_MS]
            if plausible:
                return ReadoutTag(median(plausible), writer)
    return None


# ---- Apple ---------------------------------------------------------------------------------------------------


def _apple(movie: Movie) -> Iterator[float]:
    """Yields the values of Apple's key in the movie and its tracks [ms]."""
    holders = [movie.others, *(list(inside(track.content)) for track in movie.tracks)]
    for name, content in (box for holder in holders for box in holder):
        if name == b"meta":
            for value in _values(content, _APPLE_KEY):
                yield value / 1000


def _values(meta: bytes, key: bytes) -> Iterator[float]:
    """Yields the numbers under a key of a metadata box, which starts with a version in MP4 but not in QuickTime."""
    boxes = dict(inside(meta if meta[4:8] == b"hdlr" else meta[4:]))
    names, at = [], 8
    keys = boxes.get(b"keys", b"")
    while at + 8 <= len(keys):
        (size,) = struct.unpack_from(">I", keys, at)
        names.append(keys[at + 8 : at + size])
        at += max(size, 8)
    for index, item in inside(boxes.get(b"ilst", b"")):
        number = int.from_bytes(index, "big")
        if 1 <= number <= len(names) and names[number - 1] == key:
            for name, content in inside(item):
                if name == b"data" and (value := _number(content)) is not None:
                    yield value


def _number(data: bytes) -> float | None:
    """Returns the value of a ``data`` box, which holds a type, a language and bytes."""
    kind, value = int.from_bytes(data[:4], "big"), data[8:]
    if (kind, len(value)) in _KEY_NUMBERS:
        return struct.unpack(_KEY_NUMBERS[kind, len(value)], value)[0]
    if kind in (*_SIGNED, *_UNSIGNED) and 0 < len(value) <= 8:
        return float(int.from_bytes(value, "big", signed=kind in _SIGNED))
    if kind == _TEXT:
        with suppress(ValueError):
            return float(value.decode("ascii"))
    return None


# ---- telemetry tracks ----------------------------------------------------------------------------------------


def _gopro(movie: Movie) -> Iterator[float]:
    for chunk in _chunks(movie, b"gpmd"):
        yield from _srot(chunk)


def _srot(data: bytes) -> Iterator[float]:
    """Yields the values of SROT in GPMF, whose entries hold a key, a type, size and number of values, and those."""
    at = 0
    while at + 8 <= len(data):
        key, kind, size, many = data[at : at + 4], data[at + 4 : at + 5], data[at + 5], data[at + 6 : at + 8]
        length = size * int.from_bytes(many, "big")
        content = data[at + 8 : at + 8 + length]
        if kind[0] == _NESTED:
            yield from _srot(content)
        elif key == b"SROT" and kind in _GPMF_NUMBERS:
            yield from (float(value) for (value,) in struct.iter_unpack(_GPMF_NUMBERS[kind], content))
        at += 8 + length + -length % 4


def _camm(movie: Movie) -> Iterator[float]:
    """Yields the skews in CAMM packets, which hold two reserved bytes, a type, and the content."""
    for chunk in _chunks(movie, b"camm"):
        at = 0
        while at + 4 <= len(chunk):
            (kind,) = struct.unpack_from("<H", chunk, at + 2)
            if kind not in _CAMM_BYTES:
                break
            if kind == _CAMM_EXPOSURE:
                _, skew_ns = struct.unpack_from("<2i", chunk, at + 4)
                yield skew_ns / 1e6
            at += 4 + _CAMM_BYTES[kind]


def _chunks(movie: Movie, kind: bytes) -> Iterator[bytes]:
    """Yields the first chunks of the tracks of a kind."""
    for track in movie.tracks:
        if _kind(track) == kind:
            for chunk in track.chunks()[:_MOST_CHUNKS]:
                movie.stream.seek(chunk.start)
                yield movie.stream.read(min(chunk.size, _LONGEST_CHUNK))


def _kind(track: Track) -> bytes:
    """Returns the type of a track's samples."""
    return track.part(b"mdia", b"minf", b"stbl", b"stsd")[12:16]
