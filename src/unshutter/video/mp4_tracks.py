"""Tracks of MP4 and QuickTime files: locates their samples, and moves a track to another file.

Source: ISO/IEC 14496-12; QuickTime File Format Specification. Numbers are big-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from unshutter.photo.containers.boxes import inside

_OWN_ENTRY = {  # boxes of a sample entry that belong to the encoded data rather than the film
    *(b"avcC", b"hvcC", b"av1C", b"vpcC", b"lhvC", b"dvcC", b"dvvC", b"dvwC", b"hvcE", b"vexu"),
    *(b"btrt", b"glbl", b"esds", b"fiel", b"clap"),
}
_VISUAL = 78  # bytes of a visual sample entry before its boxes
_FULL = 4  # bytes of version and flags


class NotPlainError(ValueError):
    """A file whose tracks cannot be taken apart: fragmented, damaged, or with samples stored elsewhere."""


def box(name: bytes, content: bytes) -> bytes:
    """Returns a box with its header."""
    return struct.pack(">I4s", len(content) + 8, name) + content


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples of a track.

    Attributes:
        at_s: time of the first sample [s].
        start, size: position and length in the file [bytes].
    """

    at_s: float
    start: int
    size: int


@dataclass(frozen=True)
class Track:
    """A track as described in a file.

    Attributes:
        content: content of its ``trak`` box.
    """

    content: bytes

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

    def chunks(self) -> list[Chunk]:
        """Returns the chunks of the track in order.

        Raises:
            NotPlainError: its tables contradict each other.
        """
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
            sizes = _sizes(table).astype(np.int64)
            per_chunk = _per_chunk(_numbers(table[b"stsc"], ">u4", 3), len(offsets))
            durations = _numbers(table[b"stts"], ">u4", 2).astype(np.int64)
            if per_chunk.sum() != len(sizes) or durations[:, 0].sum() != len(sizes):
                raise NotPlainError("its tables contradict each other")
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
                    name, inner = b"co64", offsets
                elif path and name == path[0]:
                    inner = change(inner, path[1:])
                out += box(name, inner)
            return out

        return change(self.content, (b"mdia", b"minf", b"stbl"))

    def with_film(self, film: Track, movie_scale: int, film_movie_scale: int) -> Track:
        """Returns this track with the samples of another, but its own names, times, rotation and tags.

        Args:
            film: the track that provides the samples.
            movie_scale: time units per second of this track's file.
            film_movie_scale: time units per second of the other file.
        """
        header = bytearray(self.part(b"tkhd"))
        theirs = film.part(b"tkhd")
        length = _duration(theirs, 20) * movie_scale // film_movie_scale
        _set_duration(header, 20, length)
        if theirs[-8:] != bytes(header[-8:]) and _size(film) != _size(self):
            header[-8:] = theirs[-8:]
        out = b""
        for name, content in inside(self.content):
            if name == b"edts":
                continue
            if name == b"tkhd":
                out += box(name, bytes(header))
                if edits := dict(inside(film.content)).get(b"edts"):
                    out += box(b"edts", _rescaled_edits(edits, movie_scale, film_movie_scale))
            elif name == b"mdia":
                out += box(name, self._media_with(film))
            else:
                out += box(name, content)
        return Track(out)

    def _media_with(self, film: Track) -> bytes:
        """Returns the ``mdia`` content, taking the boxes that describe samples from the new film."""
        header, theirs = bytearray(self.part(b"mdia", b"mdhd")), film.part(b"mdia", b"mdhd")
        struct.pack_into(">I", header, 20 if header[0] else 12, film.timescale)
        _set_duration(header, 16, _duration(theirs, 16))
        table = b""
        for name, content in inside(film.part(b"mdia", b"minf", b"stbl")):
            if name == b"stsd":
                content = _entry_with(content, self.part(b"mdia", b"minf", b"stbl", b"stsd"))
            elif name == b"stsc":  # one sample per chunk, so that sound can be interleaved
                content = struct.pack(">IIIII", 0, 1, 1, 1, 1)
            elif name in (b"stco", b"co64"):
                name, content = b"co64", _offsets(film.samples())
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
    """Returns the content of a ``co64`` box."""
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
    """Returns width and height of the first sample entry."""
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
    """Returns the new film's ``stsd`` content, its first entry extended by our boxes about colours and light."""
    entries, own = list(inside(theirs[8:])), list(inside(ours[8:]))
    name, content = entries[0]
    kinds = {n for n, _ in inside(content[_VISUAL:])}
    for kind, extra in inside(own[0][1][_VISUAL:]):
        if kind not in kinds | _OWN_ENTRY:
            content += box(kind, extra)
    return theirs[:8] + box(name, content) + b"".join(box(n, c) for n, c in entries[1:])
