"""Replaces the video track in MP4 and QuickTime files, keeping all other tracks, tags and tables.

FFmpeg writes only what it knows; cameras and phones put more into their files: telemetry, timecode, places, names of
their own. So only the video samples are taken from FFmpeg's output and inserted into the original file.

Source: ISO/IEC 14496-12; QuickTime File Format Specification.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from unshutter.errors import UnshutterError
from unshutter.photo.containers.boxes import inside, top_level_extents
from unshutter.video.mp4_tracks import Chunk, NotPlainError, Track, box

_LONGEST_MOOV = 1 << 30  # bytes
_BLOCK = 1 << 20  # bytes copied at a time
_LONG_HEAD = 16


@dataclass(frozen=True)
class Movie:
    """The boxes of a file.

    Attributes:
        stream: the open file.
        others: (type, content) of the boxes in ``moov`` that are not tracks.
        tracks: the tracks.
        early: whether ``moov`` comes before the samples, as players on the network prefer.
        brands: content of ``ftyp``; empty if there is none.
        loose: (type, start, end) of other top-level boxes that do not hold samples.
    """

    stream: BinaryIO
    others: list[tuple[bytes, bytes]]
    tracks: list[Track]
    early: bool
    brands: bytes
    loose: list[tuple[bytes, int, int]]

    @classmethod
    def read(cls, stream: BinaryIO) -> Movie:
        """Reads the boxes of a file, but not its samples.

        Raises:
            NotPlainError: the file is not an MP4 or QuickTime file, or is fragmented.
        """
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

    def film(self) -> int:
        """Returns the index of the first video track.

        Raises:
            NotPlainError: there is none.
        """
        for k, track in enumerate(self.tracks):
            if track.handler == b"vide":
                return k
        raise NotPlainError("no film")


def _read(stream: BinaryIO, start: int, end: int) -> bytes:
    stream.seek(start)
    return stream.read(end - start)


def _by_time(tracks: list[list[Chunk]]) -> Iterator[tuple[int, int]]:
    """Yields (track, chunk) of all chunks in order of time; those of a track stay in order."""
    order = [(chunk.at_s, t, k) for t, chunks in enumerate(tracks) for k, chunk in enumerate(chunks)]
    return ((t, k) for _, t, k in sorted(order))


# ---- replacing the film ----------------------------------------------------------------------------------


def can_take(path: str) -> bool:
    """Whether a file can be taken apart and reassembled."""
    try:
        with open(path, "rb") as stream:
            movie = Movie.read(stream)
            movie.film()
            for track in movie.tracks:
                track.chunks()
    except (OSError, NotPlainError, KeyError, struct.error, IndexError):
        return False
    return True


def write_with_film(original: BinaryIO, film: BinaryIO, out: BinaryIO) -> None:
    """Writes the original file with the video track of another file.

    Args:
        original: the original file (:func:`can_take`).
        film: a file whose only track is the new film.
        out: output file, written from its beginning.

    Raises:
        UnshutterError: one of the files ends early.
    """
    movie, new = Movie.read(original), Movie.read(film)
    place = movie.film()
    tracks, sources = list(movie.tracks), [original] * len(movie.tracks)
    own = new.tracks[new.film()]
    tracks[place], sources[place] = tracks[place].with_film(own, movie.timescale, new.timescale), film
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
