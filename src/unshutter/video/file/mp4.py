"""Tracks of MP4 and QuickTime files: locates their samples, and replaces the video, keeping all other tracks and tags.

FFmpeg writes only what it knows; cameras and phones put more into their files: telemetry, timecode, places, names of
their own. So only the video samples are taken from FFmpeg's output and inserted into the original file.

Sources: ISO/IEC 14496-12; QuickTime File Format Specification. Numbers are big-endian.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.photo.boxes import inside, top_level_extents

_OWN_ENTRY = {  # boxes of a sample entry that belong to the encoded data rather than the video
    *(b"avcC", b"hvcC", b"av1C", b"vpcC", b"lhvC", b"dvcC", b"dvvC", b"dvwC", b"hvcE", b"vexu"),
    *(b"btrt", b"glbl", b"esds", b"fiel", b"clap"),
}
_VISUAL = 78  # bytes of a visual sample entry before its boxes
_FULL = 4  # bytes of version and flags


class NotPlainError(ValueError):
    """A file whose tracks cannot be separated: fragmented, damaged, or with samples stored elsewhere."""


DAMAGE = (OSError, KeyError, struct.error, IndexError, ValueError)  # what reading a damaged file raises


def box(name: bytes, content: bytes) -> bytes:
    """Returns a box with its header."""
    return struct.pack(">I4s", len(content) + 8, name) + content


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples of a track."""

    at_s: float  # time of the first sample [s]
    start: int  # position in the file [bytes]
    size: int  # length [bytes]


@dataclass(frozen=True)
class Track:
    """A track as described in a file."""

    content: bytes  # content of its ``trak`` box

    def part(self, *names: bytes) -> bytes:
        """Returns the content of a nested box; raises KeyError if there is none."""
        content = self.content
        for name in names:
            content = dict(inside(content))[name]
        return content

    @property
    def handler(self) -> bytes:
        """The type of the track: ``vide``, ``soun`` ..."""
        return self.part(b"mdia", b"hdlr")[8:12]

    @property
    def timescale(self) -> int:
        """Time units per second."""
        header = self.part(b"mdia", b"mdhd")
        return struct.unpack_from(">I", header, 20 if header[0] else 12)[0]

    @property
    def number(self) -> int:
        """ID of the track."""
        header = self.part(b"tkhd")
        return struct.unpack_from(">I", header, 20 if header[0] else 12)[0]

    @property
    def sample_kind(self) -> bytes:
        """The type of the samples: ``avc1``, ``gpmd`` ..."""
        return self.part(b"mdia", b"minf", b"stbl", b"stsd")[12:16]

    def packets(self) -> list[Chunk]:
        """Returns the samples of the track in order, as chunks of one sample; raises like :meth:`chunks`."""
        sizes, _, _, times = self._tables()
        return [Chunk(*each) for each in zip(times.tolist(), self.samples(), sizes.tolist(), strict=False)]

    def chunks(self) -> list[Chunk]:
        """Returns the chunks of the track in order."""
        sizes, per_chunk, offsets, times = self._tables()
        first = np.concatenate([[0], np.cumsum(per_chunk)])
        ends = np.concatenate([[0], np.cumsum(sizes)])
        return [
            Chunk(float(times[first[k]]), int(offsets[k]), int(ends[first[k + 1]] - ends[first[k]]))
            for k in range(len(offsets))
        ]

    def samples(self) -> list[int]:
        """Returns the position of each sample in the file [bytes]; raises like :meth:`chunks`."""
        sizes, per_chunk, offsets, _ = self._tables()
        ends = np.concatenate([[0], np.cumsum(sizes)])
        before = ends[np.concatenate([[0], np.cumsum(per_chunk)])[:-1]]  # each chunk
        return (np.repeat(offsets - before, per_chunk) + ends[:-1]).tolist()

    def _tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Returns sizes of samples, samples per chunk, offsets of chunks [bytes] and times of samples [s]."""
        try:
            table = dict(inside(self.part(b"mdia", b"minf", b"stbl")))
            wide = b"co64" in table
            offsets = _numbers(table[b"co64" if wide else b"stco"], ">u8" if wide else ">u4")
            per_chunk = _per_chunk(_numbers(table[b"stsc"], ">u4", 3), len(offsets))
            durations = _numbers(table[b"stts"], ">u4", 2).astype(np.int64)
            (count,) = struct.unpack_from(">I", table[b"stsz"], _FULL + 4)
            if per_chunk.sum() != count or durations[:, 0].sum() != count:  # before a false count takes memory
                raise NotPlainError("its tables contradict each other")
            sizes = _sizes(table).astype(np.int64)
        except (KeyError, struct.error, ValueError, IndexError) as error:
            raise NotPlainError(str(error)) from None
        times = np.concatenate([[0], np.cumsum(np.repeat(durations[:, 1], durations[:, 0]))])
        return sizes, per_chunk, offsets.astype(np.int64), times / max(self.timescale, 1)

    def moved(self, starts: list[int]) -> bytes:
        """Returns its ``trak`` content with new chunk offsets."""
        offsets = _offsets(starts)

        def change(content: bytes, path: tuple[bytes, ...]) -> bytes:
            out = b""
            for name, inner in inside(content):
                if name in (b"stco", b"co64"):
                    name = b"co64"
                    inner = offsets
                elif path and name == path[0]:
                    inner = change(inner, path[1:])
                out += box(name, inner)
            return out

        return change(self.content, (b"mdia", b"minf", b"stbl"))

    def with_video(self, video: Track, movie_scale: int, video_movie_scale: int) -> Track:
        """Returns this track with the samples of another, but its own names, times, rotation and tags.

        Args:
            video: the track that provides the samples.
            movie_scale: time units per second of this track's file.
            video_movie_scale: time units per second of the other file.
        """
        header = bytearray(self.part(b"tkhd"))
        theirs = video.part(b"tkhd")
        length = _duration(theirs, 20) * movie_scale // video_movie_scale
        _set_duration(header, 20, length)
        if theirs[-8:] != bytes(header[-8:]) and _size(video) != _size(self):
            header[-8:] = theirs[-8:]
        out = b""
        for name, content in inside(self.content):
            if name == b"edts":
                continue
            if name == b"tkhd":
                out += box(name, bytes(header))
                if edits := dict(inside(video.content)).get(b"edts"):
                    out += box(b"edts", _rescaled_edits(edits, movie_scale, video_movie_scale))
            elif name == b"mdia":
                out += box(name, self._media_with(video))
            else:
                out += box(name, content)
        return Track(out)

    def _media_with(self, video: Track) -> bytes:
        """Returns the ``mdia`` content, taking the boxes that describe samples from the new video."""
        header = bytearray(self.part(b"mdia", b"mdhd"))
        theirs = video.part(b"mdia", b"mdhd")
        struct.pack_into(">I", header, 20 if header[0] else 12, video.timescale)
        _set_duration(header, 16, _duration(theirs, 16))
        table = b""
        for name, content in inside(video.part(b"mdia", b"minf", b"stbl")):
            if name == b"stsd":
                content = _entry_with(content, self.part(b"mdia", b"minf", b"stbl", b"stsd"))
            elif name == b"stsc":  # one sample per chunk, so that sound can be interleaved
                content = struct.pack(">IIIII", 0, 1, 1, 1, 1)
            elif name in (b"stco", b"co64"):
                name = b"co64"
                content = _offsets(video.samples())
            table += box(name, content)
        out = b""
        for name, content in inside(self.part(b"mdia")):
            if name == b"mdhd":
                content = bytes(header)
            elif name == b"minf":
                content = b"".join(box(n, table if n == b"stbl" else c) for n, c in inside(content))
            out += box(name, content)
        return out


def _offsets(starts: list[int]) -> bytes:
    return struct.pack(">II", 0, len(starts)) + np.array(starts, ">u8").tobytes()


def _numbers(content: bytes, kind: str, columns: int = 1) -> np.ndarray:
    (count,) = struct.unpack_from(">I", content, _FULL)
    values = np.frombuffer(content, kind, count * columns, _FULL + 4)
    return values.reshape(count, columns) if columns > 1 else values


def _sizes(table: dict[bytes, bytes]) -> np.ndarray:
    content = table[b"stsz"]
    each, count = struct.unpack_from(">II", content, _FULL)
    return np.full(count, each, ">u4") if each else np.frombuffer(content, ">u4", count, _FULL + 8)


def _per_chunk(runs: np.ndarray, chunks: int) -> np.ndarray:
    """[chunks] number of samples in each."""
    first = runs[:, 0].astype(np.int64) - 1
    return np.repeat(runs[:, 1].astype(np.int64), np.diff(np.append(first, chunks)))


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


def _size(track: Track) -> bytes:
    return track.part(b"mdia", b"minf", b"stbl", b"stsd")[8 + 8 + 24 : 8 + 8 + 28]


def _rescaled_edits(edits: bytes, scale: int, theirs: int) -> bytes:
    """Returns the ``edts`` content with its lengths in other units."""
    content = dict(inside(edits))[b"elst"]
    (count,) = struct.unpack_from(">I", content, _FULL)
    kind = ">Qqi" if content[0] else ">Iii"
    out = content[: _FULL + 4]
    for k in range(count):
        length, start, rate = struct.unpack_from(kind, content, _FULL + 4 + k * struct.calcsize(kind))
        out += struct.pack(kind, length * scale // theirs, start, rate)
    return box(b"elst", out)


def _entry_with(theirs: bytes, ours: bytes) -> bytes:
    """Returns the new video's ``stsd`` content, its first entry extended by our boxes about colours and light."""
    entries = list(inside(theirs[8:]))
    own = list(inside(ours[8:]))
    name, content = entries[0]
    kinds = {n for n, _ in inside(content[_VISUAL:])}
    for kind, extra in inside(own[0][1][_VISUAL:]):
        if kind not in kinds | _OWN_ENTRY:
            content += box(kind, extra)
    return theirs[:8] + box(name, content) + b"".join(box(n, c) for n, c in entries[1:])


_LONGEST_MOOV = 1 << 30  # bytes
_BLOCK = 1 << 20  # bytes copied at a time
_LONG_HEAD = 16


@dataclass(frozen=True)
class Movie:
    """The boxes of a file."""

    stream: BinaryIO  # the open file
    others: list[tuple[bytes, bytes]]  # (type, content) of the boxes in ``moov`` that are not tracks
    tracks: list[Track]
    early: bool  # whether ``moov`` comes before the samples, as players on the network prefer
    brands: bytes  # content of ``ftyp``; empty if there is none
    loose: list[tuple[bytes, int, int]]  # (type, start, end) of other top-level boxes that do not hold samples

    @classmethod
    def read(cls, stream: BinaryIO) -> Movie:
        """Reads the boxes of a file, but not its samples."""
        extents = list(top_level_extents(stream))
        length = stream.seek(0, io.SEEK_END)
        names = [name for name, _, _ in extents]
        if names.count(b"moov") != 1 or {b"moof", b"sidx", b"mfra"} & set(names) or extents[-1][2] > length:
            raise NotPlainError("not in one piece")
        place = names.index(b"moov")
        _, start, end = extents[place]
        if end - start > _LONGEST_MOOV:
            raise NotPlainError("its tables are too long")
        content = list(inside(_read(stream, start, end)))
        kinds = {name for name, _ in content}
        if kinds & {b"mvex", b"cmov"} or b"mvhd" not in kinds:
            raise NotPlainError("in fragments, or compressed")
        brands = next((_read(stream, a, b) for name, a, b in extents if name == b"ftyp"), b"")
        dull = (b"moov", b"mdat", b"ftyp", b"free", b"skip", b"wide")
        return cls(
            stream,
            [each for each in content if each[0] != b"trak"],
            [Track(inner) for name, inner in content if name == b"trak"],
            b"mdat" not in names or place < names.index(b"mdat"),
            brands,
            [each for each in extents if each[0] not in dull],
        )

    @property
    def timescale(self) -> int:
        """Time units per second."""
        header = dict(self.others)[b"mvhd"]
        return struct.unpack_from(">I", header, 20 if header[0] else 12)[0]

    def place_of(self, number: int) -> int:
        """Returns the index of the track with an ID; raises NotPlainError if there is none."""
        for k, track in enumerate(self.tracks):
            if track.number == number:
                return k
        raise NotPlainError("no such track")


def _read(stream: BinaryIO, start: int, end: int) -> bytes:
    stream.seek(start)
    return stream.read(end - start)


def _by_time(tracks: list[list[Chunk]]) -> Iterator[tuple[int, int]]:
    """Yields (track, chunk) of all chunks in order of time; those of a track stay in order."""
    order = [(chunk.at_s, t, k) for t, chunks in enumerate(tracks) for k, chunk in enumerate(chunks)]
    return ((t, k) for _, t, k in sorted(order))


# ---- replacing the video ----------------------------------------------------------------------------------


def can_take(movie: Movie, number: int) -> bool:
    """Whether a file can be reassembled with other frames in the track with an ID."""
    try:
        movie.place_of(number)
        for track in movie.tracks:
            track.chunks()
    except DAMAGE:
        return False
    return True


def write_with_video(original: BinaryIO, number: int, video: BinaryIO, out: BinaryIO) -> None:
    """Writes the original file with the only track of another file in place of its track with an ID."""
    movie = Movie.read(original)
    new = Movie.read(video)
    place = movie.place_of(number)
    tracks = list(movie.tracks)
    sources = [original] * len(movie.tracks)
    (own,) = new.tracks
    tracks[place], sources[place] = tracks[place].with_video(own, movie.timescale, new.timescale), video
    _write(movie, tracks, sources, out)


def write_with_covers(video: BinaryIO, covers: list[bytes], out: BinaryIO) -> None:
    """Writes a video of FFmpeg, with cover pictures, which FFmpeg drops if there are tags of all kinds."""
    movie = Movie.read(video)
    pictures = b"".join(box(b"data", struct.pack(">II", _picture_kind(each), 0) + each) for each in covers)
    handler = box(b"hdlr", bytes(8) + b"mdirappl" + bytes(9))
    meta = box(b"meta", bytes(4) + handler + box(b"ilst", box(b"covr", pictures)))
    others = dict(movie.others)
    others[b"udta"] = others.get(b"udta", b"") + meta
    _write(replace(movie, others=list(others.items()), early=True), movie.tracks, [video] * len(movie.tracks), out)


def _picture_kind(picture: bytes) -> int:
    """Returns the number of a picture's format in tags of QuickTime: JPEG, PNG or BMP."""
    return 14 if picture.startswith(b"\x89PNG") else 27 if picture.startswith(b"BM") else 13


def _write(movie: Movie, tracks: list[Track], sources: list[BinaryIO], out: BinaryIO) -> None:
    original = movie.stream
    chunks = [track.chunks() for track in tracks]
    order = list(_by_time(chunks))
    total = sum(chunks[t][k].size for t, k in order)

    before = b"".join([box(b"ftyp", movie.brands)] if movie.brands else [])
    before += b"".join(box(name, _read(original, start, end)) for name, start, end in movie.loose)
    moov_size = len(_moov(movie, tracks, [[0] * len(each) for each in chunks]))
    at = len(before) + _LONG_HEAD + (moov_size if movie.early else 0)
    starts: list[list[int]] = [[0] * len(each) for each in chunks]
    for t, k in order:
        starts[t][k], at = at, at + chunks[t][k].size
    moov = _moov(movie, tracks, starts)
    out.write(before + (moov if movie.early else b""))
    out.write(struct.pack(">I4sQ", 1, b"mdat", total + _LONG_HEAD))
    for t, k in order:
        _copy(sources[t], chunks[t][k].start, chunks[t][k].size, out)
    if not movie.early:
        out.write(moov)


def _moov(movie: Movie, tracks: list, starts: list[list[int]]) -> bytes:
    """Builds the ``moov`` box; boxes other than tracks keep their place before or after them."""
    others = [box(name, content) for name, content in movie.others]
    inner = [box(b"trak", track.moved(each)) for track, each in zip(tracks, starts, strict=True)]
    return box(b"moov", b"".join([others[0], *inner, *others[1:]]))


def _copy(source: BinaryIO, start: int, size: int, out: BinaryIO) -> None:
    source.seek(start)
    while size:
        block = source.read(min(size, _BLOCK))
        if not block:
            raise UnshutterError("the clip changed or ended while it was copied")
        out.write(block)
        size -= len(block)
