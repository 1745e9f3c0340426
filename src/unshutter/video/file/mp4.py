"""MP4 and QuickTime files: their boxes, their tracks, and where the samples of these lie.

Sources: ISO/IEC 14496-12; QuickTime File Format Specification. Numbers are big-endian.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import BinaryIO, NamedTuple

import numpy as np

from unshutter.photo.boxes import inside, top_level_extents

STBL = (b"mdia", b"minf", b"stbl")  # boxes in a track around its tables of samples
FULL = 4  # bytes of version and flags
VISUAL = 78  # bytes of a visual sample entry before its boxes
LONG_HEAD = 16  # bytes of a box's header with a 64-bit size
_HEAD = 8
_LONGEST_MOOV = 1 << 30  # bytes
_ELSEWHERE = (b"moof", b"sidx", b"mfra")  # boxes of files in fragments


class NotPlainError(ValueError):
    """A file whose tracks cannot be taken apart: fragmented, damaged, or with samples stored elsewhere."""


DAMAGE = (OSError, KeyError, struct.error, IndexError, ValueError)  # what reading a damaged file raises


def box(name: bytes, content: bytes) -> bytes:
    """Returns a box with its header."""
    return struct.pack(">I4s", len(content) + _HEAD, name) + content


def rebuilt(content: bytes, change: Callable[[bytes, bytes], bytes | None], *path: bytes) -> bytes:
    """Returns the content of a box with some of the boxes inside replaced, and all else as it was.

    Args:
        change: receives the type and content of each box, and returns boxes that take its place, or None.
        path: types of the nested boxes whose boxes are changed instead.
    """
    if path:
        outer, *deeper = path
        return rebuilt(
            content, lambda name, inner: box(name, rebuilt(inner, change, *deeper)) if name == outer else None
        )
    out = []
    at = 0
    for name, inner in inside(content):
        end = at + (LONG_HEAD if content[at : at + 4] == b"\0\0\0\1" else _HEAD) + len(inner)
        new = change(name, inner)
        out.append(content[at:end] if new is None else new)
        at = end
    return b"".join([*out, content[at:]])


class Chunk(NamedTuple):
    """Consecutive samples of a track."""

    at_s: float  # time of the first sample [s]
    start: int  # position in the file [bytes]
    size: int  # length [bytes]


class Edit(NamedTuple):
    """A part of a track that is shown, or a time in which nothing is."""

    length: int  # [time units of the file]
    start: int  # time of the media that is shown first [time units of the track]; -1 if nothing is shown
    rate: float  # of the media's time


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
    def entry(self) -> tuple[bytes, bytes]:
        """The type and content of its first sample entry, which says how samples are coded."""
        return next(inside(self.part(*STBL, b"stsd")[FULL + 4 :]), (b"", b""))

    @property
    def descriptions(self) -> list[tuple[bytes, bytes]]:
        """The types and contents of the boxes in the first sample entry of a film."""
        return list(inside(self.entry[1][VISUAL:]))

    @property
    def sample_kind(self) -> bytes:
        """The type of the samples: ``avc1``, ``gpmd`` ..."""
        return self.part(*STBL, b"stsd")[12:16]

    @property
    def edits(self) -> list[Edit]:
        """Which parts of the track are shown, one after another; empty if all of it is."""
        try:
            content = self.part(b"edts", b"elst")
        except KeyError:
            return []
        (count,) = struct.unpack_from(">I", content, FULL)
        kind = ">Qqi" if content[0] else ">Iii"
        size = struct.calcsize(kind)
        count = min(count, (len(content) - FULL - 4) // size)
        entries = [struct.unpack_from(kind, content, FULL + 4 + k * size) for k in range(count)]
        return [Edit(length, start, rate / 65_536) for length, start, rate in entries]

    def begin_s(self, movie_scale: int) -> float:
        """Returns when its first sample would be shown, by its edits [s]: below 0 if they cut off the beginning.

        Args:
            movie_scale: time units per second of the file.
        """
        waits = 0
        for edit in self.edits:
            if edit.start >= 0:
                return waits / max(movie_scale, 1) - edit.start / max(self.timescale, 1)
            waits += edit.length
        return waits / max(movie_scale, 1)

    def packets(self) -> list[Chunk]:
        """Returns the samples of the track in order, as chunks of one sample; raises like :meth:`chunks`."""
        sizes, per_chunk, offsets, times = self._tables
        ends = np.concatenate([[0], np.cumsum(sizes)])
        before = ends[np.concatenate([[0], np.cumsum(per_chunk)])[:-1]]  # each chunk
        starts = np.repeat(offsets - before, per_chunk) + ends[:-1]
        return [Chunk(*each) for each in zip(times.tolist(), starts.tolist(), sizes.tolist(), strict=False)]

    def chunks(self) -> list[Chunk]:
        """Returns the chunks of the track in order; raises NotPlainError if its tables are damaged."""
        _, per_chunk, _, times = self._tables
        starts, ends = self.places
        first = np.concatenate([[0], np.cumsum(per_chunk)])[:-1]
        return [
            Chunk(*each) for each in zip(times[first].tolist(), starts.tolist(), (ends - starts).tolist(), strict=True)
        ]

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Where each chunk begins and ends in the file [bytes]; raises like :meth:`chunks`."""
        sizes, per_chunk, offsets, _ = self._tables
        ends = np.concatenate([[0], np.cumsum(sizes)])
        lengths = np.diff(ends[np.concatenate([[0], np.cumsum(per_chunk)])])
        return offsets, offsets + lengths

    @cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Sizes of samples, samples per chunk, offsets of chunks [bytes] and times of samples [s]."""
        try:
            table = dict(inside(self.part(*STBL)))
            offsets = (
                chunk_offsets(b"co64", table[b"co64"]) if b"co64" in table else chunk_offsets(b"stco", table[b"stco"])
            )
            per_chunk = _per_chunk(_numbers(table[b"stsc"], ">u4", 3), len(offsets))
            durations = _numbers(table[b"stts"], ">u4", 2).astype(np.int64)
            (count,) = struct.unpack_from(">I", table[b"stsz"], FULL + 4)
            if per_chunk.sum() != count or durations[:, 0].sum() != count:  # before a false count takes memory
                raise NotPlainError("its tables contradict each other")
            sizes = _sizes(table).astype(np.int64)
        except (KeyError, struct.error, ValueError, IndexError) as error:
            raise NotPlainError(str(error)) from None
        times = np.concatenate([[0], np.cumsum(np.repeat(durations[:, 1], durations[:, 0]))])
        return sizes, per_chunk, offsets, times / max(self.timescale, 1)


def chunk_offsets(name: bytes, content: bytes) -> np.ndarray:
    """Returns the positions of a track's chunks [bytes], from its box ``stco`` or ``co64``."""
    return _numbers(content, ">u8" if name == b"co64" else ">u4").astype(np.int64)


def offsets_box(starts: np.ndarray, is_wide: bool) -> bytes:
    """Returns the box with the positions of a track's chunks [bytes]; a wide one has 64-bit numbers."""
    numbers = np.asarray(starts).astype(">u8" if is_wide else ">u4").tobytes()
    return box(b"co64" if is_wide else b"stco", struct.pack(">II", 0, len(starts)) + numbers)


def _numbers(content: bytes, kind: str, columns: int = 1) -> np.ndarray:
    (count,) = struct.unpack_from(">I", content, FULL)
    values = np.frombuffer(content, kind, count * columns, FULL + 4)
    return values.reshape(count, columns) if columns > 1 else values


def _sizes(table: dict[bytes, bytes]) -> np.ndarray:
    content = table[b"stsz"]
    each, count = struct.unpack_from(">II", content, FULL)
    return np.full(count, each, ">u4") if each else np.frombuffer(content, ">u4", count, FULL + 8)


def _per_chunk(runs: np.ndarray, chunks: int) -> np.ndarray:
    """[chunks] number of samples in each."""
    first = runs[:, 0].astype(np.int64) - 1
    return np.repeat(runs[:, 1].astype(np.int64), np.diff(np.append(first, chunks)))


# ---- whole files ----------------------------------------------------------------------------------------------------


class TopBox(NamedTuple):
    """A box of a file that is in no other."""

    name: bytes  # its type
    head: int  # position of its header [bytes]
    start: int  # and of its content
    end: int  # and of what follows


@dataclass(frozen=True)
class Movie:
    """The boxes of a file."""

    stream: BinaryIO  # the open file
    length: int  # of the file [bytes]
    boxes: list[TopBox]  # in their order; what follows the last one is a trailer

    @classmethod
    def read(cls, stream: BinaryIO) -> Movie:
        """Reads the boxes of a file, but not its samples; raises NotPlainError if it cannot be taken apart."""
        extents = list(top_level_extents(stream))
        length = stream.seek(0, io.SEEK_END)
        ends = [0, *(end for _, _, end in extents)]
        boxes = [TopBox(name, head, start, end) for (name, start, end), head in zip(extents, ends, strict=False)]
        if boxes and boxes[-1].end > length:  # a file that is cut off, or no box at all but a trailer
            if boxes[-1].name in (b"mdat", b"moov", *_ELSEWHERE):
                raise NotPlainError("cut off")
            boxes.pop()
        names = [each.name for each in boxes]
        if names.count(b"moov") != 1 or set(_ELSEWHERE) & set(names):
            raise NotPlainError("not in one piece")
        movie = cls(stream, length, boxes)
        if movie.moov.end - movie.moov.start > _LONGEST_MOOV:
            raise NotPlainError("its tables are too long")
        kinds = {name for name, _ in inside(movie.content)}
        if kinds & {b"mvex", b"cmov"} or b"mvhd" not in kinds:
            raise NotPlainError("in fragments, or compressed")
        return movie

    def read_at(self, start: int, size: int) -> bytes:
        """Reads bytes of the file."""
        self.stream.seek(start)
        return self.stream.read(size)

    @property
    def moov(self) -> TopBox:
        """The box with its tracks."""
        return next(each for each in self.boxes if each.name == b"moov")

    @cached_property
    def content(self) -> bytes:
        """The content of ``moov``."""
        return self.read_at(self.moov.start, self.moov.end - self.moov.start)

    @property
    def others(self) -> list[tuple[bytes, bytes]]:
        """The types and contents of the boxes in ``moov`` that are not tracks."""
        return [each for each in inside(self.content) if each[0] != b"trak"]

    @cached_property
    def tracks(self) -> list[Track]:
        """The tracks, in their order."""
        return [Track(inner) for name, inner in inside(self.content) if name == b"trak"]

    @property
    def timescale(self) -> int:
        """Time units per second."""
        header = dict(self.others)[b"mvhd"]
        return struct.unpack_from(">I", header, 20 if header[0] else 12)[0]

    def track(self, number: int) -> Track:
        """Returns the track with an ID; raises NotPlainError if there is none."""
        for track in self.tracks:
            if track.number == number:
                return track
        raise NotPlainError("no such track")
