"""Statements of a clip's camera in its file: the readout time, the rate at which it took frames, and its settings.

Cameras write readout times into MP4 and QuickTime files. GoPro: SROT [ms], among the settings of the file from HERO8
on, before that in the telemetry track. Apple: a key of the movie or of the video's track [us]. CAMM, the motion
metadata of Android and street-view cameras: packets of type 1, the skew from the first row to the last [ns]. Sony: tag
0xe40e of the real-time metadata of each frame [us]. DJI: the first packet of its own metadata [ns], in which the
sensor's rate and the video's are stated, too. Canon: tag 0xe209 of the metadata of each frame [ns]. Insta360: field 25
of a record behind the last box [ms].

Slow motion is taken at a higher rate than the file's. Android states it in a key, Sony in an XML document.

Sources: gopro/gpmf-parser, README (the key); QuickTime File Format Specification (metadata keys); Google, Camera Motion
Metadata Specification 1.0; Android's MediaRecorder.setCaptureRate; names and units of keys as exiftool.org and
AdrianEddy/telemetry-parser list them (facts only).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from statistics import median

from unshutter.photo.boxes import inside, top_level_extents
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.video.file import gpmf
from unshutter.video.file.mp4 import DAMAGE, Movie

_MOST_CHUNKS = 20  # most chunks of a track that are read
_SAME_RATE = 0.05  # share: rates that differ by less are one
_LONGEST_XML = 1 << 20  # bytes
_SONY_RATE = re.compile(rb'captureFps="([0-9.]{1,12})[pi]?"')
_SONY_HEAD = 0x1C
_DJI_READOUT, _DJI_SENSOR, _DJI_VIDEO = (1, 4, 1), (1, 11, 1), (2, 3, 3)  # numbers of nested fields
_APPLE_KEY = b"com.apple.quicktime.camera.framereadouttimeinmicroseconds"
_CAMM_BYTES = {0: 12, 1: 8, 2: 12, 3: 12, 4: 12, 5: 24, 6: 56, 7: 12}  # bytes of a packet's content, by its type
_KEY_NUMBERS = {(23, 4): ">f", (24, 8): ">d"}  # (well-known type, bytes) of floating-point values
_TEXT = 1
_SET = b"\x06\x0e\x2b\x34"  # how the name of a set of tags begins
_INSTA360 = b"8db42d694ccc418790edff439fe026bf"  # how its files end
_INSTA360_TAIL = 72  # bytes behind its records
_SIGNED = (21, 65, 66, 67, 74)
_UNSIGNED = (22, 75, 76, 77, 78)


@dataclass(frozen=True)
class CameraTags:
    """What a clip's camera states in its file."""

    readout_time: ReadoutTime | None = None  # readout time; None if it is missing or implausible
    settings: dict[bytes, bytes] = field(default_factory=dict)  # of a GoPro, by their keys
    capture_fps: float | None = None  # rate at which a Sony took frames; None if it does not state it

    @classmethod
    def of(cls, movie: Movie) -> CameraTags:
        """Reads the tags of a file; what is damaged counts as missing."""
        readout_time = None
        settings = {}
        capture_fps = None
        with suppress(*DAMAGE):
            readout_time = _readout_time(movie)
        with suppress(*DAMAGE):
            settings = gpmf.settings(movie)
        with suppress(*DAMAGE):
            capture_fps = _sony_rate(movie)
        return cls(readout_time, settings, capture_fps)

    def slowed(self, tags: Mapping[str, str], interval_s: float) -> float:
        """Returns how much more slowly a clip is shown than it was taken, for its tags and frame interval [s].

        Android states the highest rate, below which phones fall where it is dark: only slow motion counts there.
        """
        if self.capture_fps is not None and abs(self.capture_fps * interval_s - 1) > _SAME_RATE:
            return self.capture_fps * interval_s
        stated = next((value for key, value in tags.items() if key.lower() == "com.android.capture.fps"), "")
        with suppress(ValueError):
            rate = float(stated)
            if 48.0 <= rate < 1e5 and rate * interval_s >= 1.5:
                return rate * interval_s
        return 1.0

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
    makers = {
        "Apple": _apple,
        "GoPro": _gopro,
        "CAMM": _camm,
        "Sony": _sony,
        "DJI": _dji,
        "Canon": _canon,
        "Insta360": _insta360,
    }
    for writer, times_of in makers.items():
        times = _before_damage(times_of(movie))
        plausible = [ms for ms in times if 0.1 <= ms <= 1000.0]
        if plausible:
            return ReadoutTime.of_ms(median(plausible), ReadoutSource.TAG, writer)
    return None


def _before_damage(times: Iterator[float]) -> Iterator[float]:
    with suppress(*DAMAGE):
        yield from times


def _metas(movie: Movie) -> Iterator[dict[bytes, bytes]]:
    """Yields the boxes in each ``meta`` box: of the movie, its tracks and their user data, and of the file."""
    for holder in (movie.others, *(list(inside(track.content)) for track in movie.tracks)):
        for name, content in holder:
            metas = [content] if name == b"meta" else []
            if name == b"udta":
                metas = [inner for kind, inner in inside(content) if kind == b"meta"]
            yield from map(_in_meta, metas)
    for name, start, end in top_level_extents(movie.stream):
        if name == b"meta":
            movie.stream.seek(start)
            yield _in_meta(movie.stream.read(min(end - start, _LONGEST_XML)))


def _in_meta(meta: bytes) -> dict[bytes, bytes]:
    return dict(inside(meta if meta[4:8] == b"hdlr" else meta[4:]))  # it starts with a version in MP4 only


def _sony_rate(movie: Movie) -> float | None:
    for boxes in _metas(movie):
        found = _SONY_RATE.search(boxes.get(b"xml ", b"")[:_LONGEST_XML])
        if found is not None and 0 < float(found[1]) < 1e5:
            return float(found[1])
    return None


def _apple(movie: Movie) -> Iterator[float]:
    for boxes in _metas(movie):
        yield from (value / 1000 for value in _apple_values(boxes))


def _apple_values(boxes: dict[bytes, bytes]) -> Iterator[float]:
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


def _sony(movie: Movie) -> Iterator[float]:
    """Yields the times in real-time metadata: each packet has a head, then tags (number, length, content)."""
    for packet in _chunks(movie, b"rtmd", packets=True):
        if packet[:2] == _SONY_HEAD.to_bytes(2, "big"):
            tags = _tags(packet[_SONY_HEAD:], 0xE40E)
            yield from (int.from_bytes(value, "big", signed=True) / 1000 for value in tags)


def _tags(tags: bytes, wanted: int) -> Iterator[bytes]:
    """Yields the values of four bytes of a tag among others."""
    at = 0
    while at + 4 <= len(tags):
        if tags[at : at + 4] == _SET:  # name of the set that follows
            at += 16
            continue
        number, length = struct.unpack_from(">HH", tags, at)
        value = tags[at + 4 : at + 4 + length]
        if number in (0, 0xFFFF) or len(value) < length:
            return
        if number == wanted and length == 4:
            yield value
        elif number == 0x8300:  # which holds others
            yield from _tags(value, wanted)
        at += 4 + length


def _canon(movie: Movie) -> Iterator[float]:
    """Yields the times in metadata of frames: each packet has parts (number, length), the second of which has sets."""
    for kind in {track.sample_kind for track in movie.tracks if track.handler == b"meta"}:
        for packet in _chunks(movie, kind, packets=True):
            at = 0
            while at + 8 <= len(packet):
                number, length = struct.unpack_from("<II", packet, at)
                if number not in (1, 2):
                    break
                part = packet[at + 8 : at + 8 + length]
                yield from (int.from_bytes(value, "big") / 1e6 for value in _tags_of_sets(part, 0xE209))
                at += 8 + length


def _tags_of_sets(sets: bytes, wanted: int) -> Iterator[bytes]:
    """Yields the values of a tag in sets, each a name of 16 bytes, a length as in ASN.1, and tags."""
    at = 0
    while sets[at : at + 4] == _SET:
        length = sets[at + 16]
        at += 17
        if length & 0x80:
            more = length & 0x7F
            length = int.from_bytes(sets[at : at + more], "big")
            at += more
        yield from _tags(sets[at : at + length], wanted)
        at += length


def _insta360(movie: Movie) -> Iterator[float]:
    """Yields the time in the records behind the last box, each of which ends with its format, kind and length."""
    tail = movie.read_at(movie.length - _INSTA360_TAIL, _INSTA360_TAIL)
    if not tail.endswith(_INSTA360):
        return
    at = movie.length - _INSTA360_TAIL
    first = movie.length - int.from_bytes(tail[32:36], "little")
    while at - 6 >= first:
        _, kind, length = struct.unpack("<BBI", movie.read_at(at - 6, 6))
        at -= 6 + length
        if kind == 1:
            value = _field(movie.read_at(at, length), (25,))
            if isinstance(value, bytes) and len(value) == 8:
                yield struct.unpack("<d", value)[0]
            return


def _dji(movie: Movie) -> Iterator[float]:
    """Yields the time of a frame at the sensor's rate, for the video's: both are stated with it."""
    for packet in islice(_chunks(movie, b"djmd", packets=True), 1):
        readout_ns, sensor_fps, video_fps = (_field(packet, path) for path in (_DJI_READOUT, _DJI_SENSOR, _DJI_VIDEO))
        if isinstance(readout_ns, int) and readout_ns:
            rates = [struct.unpack("<f", each)[0] for each in (sensor_fps, video_fps) if isinstance(each, bytes)]
            yield readout_ns / 1e6 * (rates[0] / rates[1] if len(rates) == 2 and min(rates) > 0 else 1.0)


def _field(message: bytes, path: tuple[int, ...]) -> int | bytes | None:
    """Returns a field of a message of Protocol Buffers by its path of numbers; None if there is none."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        value, at = _varint(message, at) if kind in (0, 2) else (0, at)
        held = message[at : at + (value if kind == 2 else {1: 8, 5: 4}.get(kind, 0))]
        at += len(held)
        if key >> 3 == path[0]:
            inner = value if kind == 0 else held
            return inner if len(path) == 1 else _field(held, path[1:])
        if kind not in (0, 1, 2, 5):
            return None
    return None


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """Returns a number of seven bits a byte, the lowest first, and the position after it."""
    value = 0
    for shift in range(0, 70, 7):
        value |= (message[at] & 0x7F) << shift
        at += 1
        if message[at - 1] < 0x80:
            break
    return value, at


def _chunks(movie: Movie, kind: bytes, packets: bool = False) -> Iterator[bytes]:
    for track in movie.tracks:
        if track.sample_kind == kind:
            for chunk in (track.packets() if packets else track.chunks())[:_MOST_CHUNKS]:
                movie.stream.seek(chunk.start)
                yield movie.stream.read(min(chunk.size, 1 << 22))
