"""Statements of a clip's camera in its file: the readout time, and its settings.

Cameras write readout times into MP4 and QuickTime files. GoPro: SROT [ms], among the settings of the file from HERO8
on, before that in the telemetry track. Apple: a key of the movie or of the video's track [us]. CAMM, the motion
metadata of Android and street-view cameras: packets of type 1, the skew from the first row to the last [ns].

Sources: gopro/gpmf-parser, README (the key); QuickTime File Format Specification (metadata keys); Google, Camera Motion
Metadata Specification 1.0; names of keys as exiftool.org lists them (facts only).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from statistics import median

from unshutter.photo.boxes import inside
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.video.file import gpmf
from unshutter.video.file.mp4 import DAMAGE, Movie

_MOST_CHUNKS = 20  # most chunks of a track that are read
_APPLE_KEY = b"com.apple.quicktime.camera.framereadouttimeinmicroseconds"
_CAMM_BYTES = {0: 12, 1: 8, 2: 12, 3: 12, 4: 12, 5: 24, 6: 56, 7: 12}  # bytes of a packet's content, by its type
_KEY_NUMBERS = {(23, 4): ">f", (24, 8): ">d"}  # (well-known type, bytes) of floating-point values
_TEXT = 1
_SIGNED = (21, 65, 66, 67, 74)
_UNSIGNED = (22, 75, 76, 77, 78)


@dataclass(frozen=True)
class CameraTags:
    """What a clip's camera states in its file."""

    readout_time: ReadoutTime | None = None  # readout time; None if it is missing or implausible
    settings: dict[bytes, bytes] = field(default_factory=dict)  # of a GoPro, by their keys

    @classmethod
    def of(cls, movie: Movie) -> CameraTags:
        """Reads the tags of a file; what is damaged counts as missing."""
        readout_time = None
        settings = {}
        with suppress(*DAMAGE):
            readout_time = _readout_time(movie)
        with suppress(*DAMAGE):
            settings = gpmf.settings(movie)
        return cls(readout_time, settings)

    @property
    def is_stabilised(self) -> bool:
        """Whether the camera states that it stabilised the clip: EISE in GoPro's settings, listed by exiftool.org."""
        return self.settings.get(b"EISE", b"")[:1] == b"Y"

    @property
    def view_degrees(self) -> float | None:
        """Field of view from corner to corner [degrees]: ZFOV in GoPro's settings; None if it is not stated."""
        stated = self.settings.get(b"ZFOV", b"")
        return struct.unpack(">f", stated)[0] if len(stated) == 4 else None


def _readout_time(movie: Movie) -> ReadoutTime | None:
    for writer, times in (("Apple", _apple(movie)), ("GoPro", _gopro(movie)), ("CAMM", _camm(movie))):
        plausible = [ms for ms in times if 0.1 <= ms <= 1000.0]
        if plausible:
            return ReadoutTime.of_ms(median(plausible), ReadoutSource.TAG, writer)
    return None


def _apple(movie: Movie) -> Iterator[float]:
    holders = [movie.others, *(list(inside(track.content)) for track in movie.tracks)]
    for name, content in (box for holder in holders for box in holder):
        if name == b"meta":
            yield from (value / 1000 for value in _apple_values(content))


def _apple_values(meta: bytes) -> Iterator[float]:
    boxes = dict(inside(meta if meta[4:8] == b"hdlr" else meta[4:]))  # it starts with a version in MP4 only
    names = []
    at = 8
    keys = boxes.get(b"keys", b"")
    while at + 8 <= len(keys):
        (size,) = struct.unpack_from(">I", keys, at)
        names.append(keys[at + 8 : at + size])
        at += max(size, 8)
    for index, item in inside(boxes.get(b"ilst", b"")):
        number = int.from_bytes(index, "big")
        if 1 <= number <= len(names) and names[number - 1] == _APPLE_KEY:
            for name, content in inside(item):
                if name == b"data" and (value := _number(content)) is not None:
                    yield value


def _number(data: bytes) -> float | None:
    """Returns the value of a ``data`` box, which holds a type, a language and bytes."""
    kind = int.from_bytes(data[:4], "big")
    value = data[8:]
    if (kind, len(value)) in _KEY_NUMBERS:
        return struct.unpack(_KEY_NUMBERS[kind, len(value)], value)[0]
    if kind in (*_SIGNED, *_UNSIGNED) and 0 < len(value) <= 8:
        return float(int.from_bytes(value, "big", signed=kind in _SIGNED))
    if kind == _TEXT:
        with suppress(ValueError):
            return float(value.decode("ascii"))
    return None


def _gopro(movie: Movie) -> Iterator[float]:
    stated = gpmf.settings(movie).get(b"SROT", b"")
    if len(stated) == 4:
        yield struct.unpack(">f", stated)[0]
        return
    for _, packet in islice(gpmf.packets(movie), _MOST_CHUNKS):
        for entry in gpmf.entries(packet):
            if entry.key == b"SROT":
                yield from entry.numbers.ravel().tolist()


def _camm(movie: Movie) -> Iterator[float]:
    """Yields the skews in CAMM packets, which hold two reserved bytes, a type, and the content."""
    for chunk in _chunks(movie, b"camm"):
        at = 0
        while at + 4 <= len(chunk):
            (kind,) = struct.unpack_from("<H", chunk, at + 2)
            if kind not in _CAMM_BYTES:
                break
            if kind == 1:
                _, skew_ns = struct.unpack_from("<2i", chunk, at + 4)
                yield skew_ns / 1e6
            at += 4 + _CAMM_BYTES[kind]


def _chunks(movie: Movie, kind: bytes) -> Iterator[bytes]:
    for track in movie.tracks:
        if track.sample_kind == kind:
            for chunk in track.chunks()[:_MOST_CHUNKS]:
                movie.stream.seek(chunk.start)
                yield movie.stream.read(min(chunk.size, 1 << 22))
