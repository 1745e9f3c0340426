"""MP4 and QuickTime files as their boxes: which tracks they have, and what else.

Source: ISO/IEC 14496-12; QuickTime File Format Specification.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from unshutter.photo.containers.boxes import inside, top_level_extents
from unshutter.video.mp4_tracks import Chunk, NotPlainError, Track

_LONGEST_MOOV = 1 << 30  # bytes


@dataclass(frozen=True)
class Movie:
    """A file's boxes.

    Attributes:
        stream: the open file.
        others: (type, content) of the boxes in ``moov`` that are no tracks.
        tracks: the others.
        early: whether ``moov`` comes before the samples, as players on the network like it.
        brands: content of ``ftyp``; empty: none.
        loose: (type, start, end) of further boxes of the file itself, which do not hold samples.
    """

    stream: BinaryIO
    others: list[tuple[bytes, bytes]]
    tracks: list[Track]
    early: bool
    brands: bytes
    loose: list[tuple[bytes, int, int]]

    @classmethod
    def read(cls, stream: BinaryIO) -> Movie:
        """Reads the boxes of a file, not its samples.

        Raises:
            NotPlainError: it is none, or in fragments.
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
        """Units of its times in a second."""
        header = dict(self.others)[b"mvhd"]
        return struct.unpack_from(">I", header, 20 if header[0] else 12)[0]

    def film(self) -> int:
        """Index of the track of pictures that comes first.

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


def iter_by_time(tracks: list[list[Chunk]]) -> Iterator[tuple[int, int]]:
    """(track, chunk) of all chunks, by their times; those of a track stay in order."""
    order = [(chunk.at_s, t, k) for t, chunks in enumerate(tracks) for k, chunk in enumerate(chunks)]
    return ((t, k) for _, t, k in sorted(order))
