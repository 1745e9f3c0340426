"""An MP4 or QuickTime file with another film in it: all other tracks, tags and tables are those of the file.

FFmpeg writes what it knows of; cameras and phones put more into their files: telemetry, timecode, places, names of
their own. So only the film's samples are taken from what FFmpeg encoded, and put into the file that came in.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

from unshutter.errors import UnshutterError
from unshutter.video.mp4_movie import Movie, iter_by_time
from unshutter.video.mp4_tracks import NotPlainError, box

_BLOCK = 1 << 20  # bytes copied at a time
_LONG_HEAD = 16


def can_take(path: str) -> bool:
    """Whether a file can be taken apart and put together again."""
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
    """Writes the original with the film of another file.

    Args:
        original: the file that came in (:func:`can_take`).
        film: a file with the new film as its only track.
        out: is written to, from its beginning.

    Raises:
        UnshutterError: one of the files ends early.
    """
    movie, new = Movie.read(original), Movie.read(film)
    place = movie.film()
    tracks, sources = list(movie.tracks), [original] * len(movie.tracks)
    own = new.tracks[new.film()]
    tracks[place], sources[place] = tracks[place].with_film(own, movie.timescale, new.timescale), film
    chunks = [track.chunks() for track in tracks]
    order = list(iter_by_time(chunks))
    total = sum(chunks[t][k].size for t, k in order)

    before = b"".join([box(b"ftyp", movie.brands)] if movie.brands else [])
    before += b"".join(box(name, _copied(original, start, end)) for name, start, end in movie.loose)
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
    """The tables, in their order: what is no track stays in front or behind as it was."""
    made = [box(name, content) for name, content in movie.others]
    inner = [box(b"trak", track.moved(each)) for track, each in zip(tracks, starts, strict=True)]
    return box(b"moov", b"".join([made[0], *inner, *made[1:]]))


def _copied(stream: BinaryIO, start: int, end: int) -> bytes:
    stream.seek(start)
    return stream.read(end - start)


def _copy(source: BinaryIO, start: int, size: int, out: BinaryIO) -> None:
    source.seek(start)
    while size:
        block = source.read(min(size, _BLOCK))
        if not block:
            raise UnshutterError("the clip changed or ended while it was copied")
        out.write(block)
        size -= len(block)
