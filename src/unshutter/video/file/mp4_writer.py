"""Writes MP4 and QuickTime files with other frames: everything else stays where it was, byte for byte.

The new file is the old one with some ranges of bytes replaced: the film's samples, by those of the new film; ``moov``,
whose tables follow what has moved; and what must not stay. So what no table lists, between samples or behind the last
box, is carried too.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from typing import BinaryIO

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.video.file.mp4 import (
    DAMAGE,
    LONG_HEAD,
    STBL,
    Chunk,
    Movie,
    TopBox,
    Track,
    box,
    chunk_offsets,
    offsets_box,
    rebuilt,
)
from unshutter.video.file.mp4_film import Replacement, with_descriptions
from unshutter.video.file.mp4_inventory import (
    LONGEST_TABLE,
    PlaceTable,
    Range,
    lists_places,
    loose,
    merged,
    place_lists,
    sample_ranges,
    signatures,
    without,
    without_place_lists,
)

_BLOCK = 1 << 20  # bytes copied at a time
_LONGEST_SHORT = 0xFFFFFFFF  # bytes of a box whose size has 32 bits
_LONGEST_NARROW = 0xF0000000  # bytes of a file whose positions have 32 bits for sure


@dataclass
class _Change:
    """A range of bytes of a file that is replaced."""

    start: int
    end: int
    size: int = 0  # bytes that take its place
    content: Callable[[Places], bytes] = lambda _: b""  # which are these
    samples: list[int] = field(default_factory=list)  # or these samples of the new film, by number


class Places:
    """Where the bytes of a file are after some changes."""

    def __init__(self, changes: Iterable[_Change]):
        self.changes = sorted(changes, key=lambda each: (each.start, each.end))
        moved = [0, *accumulate(each.size - (each.end - each.start) for each in self.changes)]
        self._ends = np.array([each.end for each in self.changes], np.int64)
        self._moved = np.array(moved, np.int64)

    def __call__(self, old: np.ndarray) -> np.ndarray:
        """Returns the new positions of bytes that are kept."""
        return old + self._moved[np.searchsorted(self._ends, old, "right")]

    def of_samples(self, sizes: list[int]) -> np.ndarray:
        """Returns the positions of the new film's samples, given their sizes."""
        starts = np.zeros(len(sizes), np.int64)
        for change, moved in zip(self.changes, self._moved.tolist(), strict=False):
            at = change.start + moved
            for number in change.samples:
                starts[number] = at
                at += sizes[number]
        return starts


def can_take(movie: Movie, number: int) -> bool:
    """Whether a file can be written with other frames in the track with an ID."""
    holders = [each for each in movie.boxes if each.name != b"moov"]
    try:
        others = [sample_ranges(track) for track in movie.tracks if track.number != number]
        film = sample_ranges(movie.track(number))
        is_described = all(track.handler and track.sample_kind for track in movie.tracks)
    except DAMAGE:
        return False
    taken = merged(each for ranges in others for each in ranges)
    starts, ends = np.array([*film, *taken], np.int64).reshape(-1, 2).T
    place = np.searchsorted([each.start for each in holders], starts, "right")
    are_inside = (place > 0) & (ends <= np.array([0, *(each.end for each in holders)])[place])
    has_own = _length(merged([*film, *taken])) > _length(taken)
    has_each_once = _length(film) == _length(merged(film)) and len(others) + 1 == len(movie.tracks)
    return is_described and bool(are_inside.all()) and has_own and has_each_once


def _length(ranges: list[Range]) -> int:
    return sum(end - start for start, end in ranges)


def write_with_video(
    original: BinaryIO,
    number: int,
    video: BinaryIO,
    out: BinaryIO,
    corner: tuple[int, int] = (0, 0),
    dolby_vision: bool = False,
    light: Sequence[tuple[bytes, bytes]] = (),
) -> None:
    """Writes the original file with the only track of another file in place of its track with an ID.

    Args:
        corner: left and top side of the part of each frame that is kept [px].
        dolby_vision: whether the new samples have that of the old ones.
        light: boxes that say how bright the new film is, if the original has none.
    """
    movie = Movie.read(original)
    new = Movie.read(video)
    film = movie.track(number)
    (own,) = new.tracks
    samples = own.packets()
    sizes = [each.size for each in samples]
    replacement = Replacement(film, own, (movie.timescale, new.timescale), corner, dolby_vision, light)
    begin_s = film.begin_s(movie.timescale) - own.begin_s(new.timescale)
    changes = _film_changes(movie, film, [each._replace(at_s=each.at_s - begin_s) for each in samples])
    changes += [_Change(each.head, each.end) for each in (*signatures(movie), *place_lists(movie))]
    is_wide = movie.length + sum(sizes) > _LONGEST_NARROW
    ranges = loose(movie)

    def change(name: bytes, content: bytes, places: Places) -> bytes | None:
        if name != b"trak":
            return _with_tables_moved(name, content, ranges, places)
        if content != film.content:
            return box(name, _moved(without_place_lists(content), places, is_wide))
        return box(name, without_place_lists(replacement.track(places.of_samples(sizes), is_wide)))

    changes += _tables(movie, ranges)
    moov = partial(_rebuilt, movie.content, change)
    place = movie.moov
    changes.append(_Change(place.head, place.end, len(moov(Places([]))), moov))
    _write(movie, Places(changes), [(video, each) for each in samples], out)


def write_completed(video: BinaryIO, covers: list[bytes], light: Sequence[tuple[bytes, bytes]], out: BinaryIO) -> None:
    """Writes a video of FFmpeg with what FFmpeg drops.

    Args:
        covers: cover pictures, which it drops if there are tags of all kinds.
        light: boxes that say how bright the film is.
    """
    movie = Movie.read(video)
    pictures = b"".join(box(b"data", struct.pack(">II", _picture_kind(each), 0) + each) for each in covers)
    handler = box(b"hdlr", bytes(8) + b"mdirappl" + bytes(9))
    meta = box(b"meta", bytes(4) + handler + box(b"ilst", box(b"covr", pictures)))
    tags = box(b"udta", dict(movie.others).get(b"udta", b"") + meta) if covers else b""
    is_wide = movie.length > _LONGEST_NARROW

    def change(name: bytes, content: bytes, places: Places) -> bytes | None:
        if name != b"trak":
            return b"" if name == b"udta" and covers else None
        film = with_descriptions(content, light) if Track(content).handler == b"vide" else content
        return box(name, _moved(film, places, is_wide))

    def moov(places: Places) -> bytes:
        return box(b"moov", rebuilt(movie.content, lambda name, inner: change(name, inner, places)) + tags)

    place = movie.moov
    early = next(each.head for each in movie.boxes if each.name == b"mdat")
    changes = [_Change(place.head, place.end), _Change(early, early, len(moov(Places([]))), moov)]
    _write(movie, Places(changes), [], out)


def _picture_kind(picture: bytes) -> int:
    """Returns the number of a picture's format in tags of QuickTime: JPEG, PNG or BMP."""
    return 14 if picture.startswith(b"\x89PNG") else 27 if picture.startswith(b"BM") else 13


# ---- which bytes change ---------------------------------------------------------------------------------------------


def _film_changes(movie: Movie, film: Track, samples: list[Chunk]) -> list[_Change]:
    """Returns the changes that put new samples where the film's were at their time."""
    taken = [each for track in movie.tracks if track.number != film.number for each in sample_ranges(track)]
    chunks = film.chunks()
    changes: list[_Change] = []
    of_chunk = []  # the number of each chunk's change
    for pieces in without([(start, start + size) for _, start, size in chunks], taken):
        changes += [_Change(*piece) for piece in pieces if piece[0] < piece[1]]
        of_chunk.append(max(len(changes) - 1, 0))
    times = [each.at_s for each in chunks]
    for number, sample in enumerate(samples):
        change = changes[of_chunk[max(bisect_right(times, sample.at_s + 1e-6) - 1, 0)]]
        change.samples.append(number)
        change.size += sample.size
    return [*changes, *_heads(movie, changes)]


def _heads(movie: Movie, changes: list[_Change]) -> Iterator[_Change]:
    """Yields new headers of the boxes whose samples change."""
    holders = [each for each in movie.boxes if each.name != b"moov"]
    starts = [each.start for each in holders]
    grown = [0] * len(holders)
    for change in changes:
        grown[bisect_right(starts, change.start) - 1] += change.size - (change.end - change.start)
    for each, more in zip(holders, grown, strict=True):
        if more and movie.read_at(each.head, 4) != bytes(4):  # the last one may go on to the end of the file
            yield _head(each, more)


def _head(holder: TopBox, more: int) -> _Change:
    """Returns the change of a box's header if it grows by some bytes."""
    size = holder.end - holder.head + more
    head = struct.pack(">I4s", size, holder.name) if size <= _LONGEST_SHORT else b""
    if not head or holder.start - holder.head == LONG_HEAD:
        head = struct.pack(">I4sQ", 1, holder.name, holder.end - holder.start + more + LONG_HEAD)
    return _Change(holder.head, holder.start, len(head), lambda _: head)


def _tables(movie: Movie, ranges: list[Range]) -> Iterator[_Change]:
    """Yields the changes of boxes outside ``moov`` that list places in the file."""
    for each in movie.boxes:
        size = each.end - each.start
        content = (
            movie.read_at(each.start, size) if each.name not in (b"moov", b"mdat") and size <= LONGEST_TABLE else b""
        )
        table = PlaceTable.of(each.name, content, ranges)
        if table is not None:
            yield _Change(each.start, each.end, size, partial(table.moved, content))


# ---- moov -----------------------------------------------------------------------------------------------------------


def _rebuilt(content: bytes, change: Callable[[bytes, bytes, Places], bytes | None], places: Places) -> bytes:
    """Returns the ``moov`` box with each box inside changed."""
    return box(b"moov", rebuilt(content, lambda name, inner: change(name, inner, places)))


def _with_tables_moved(name: bytes, content: bytes, ranges: list[Range], places: Places) -> bytes | None:
    """Returns a box of ``moov`` with what it lists of places in the file moved; None if it lists none."""
    if name == b"udta":
        return box(name, rebuilt(content, lambda kind, inner: _with_tables_moved(kind, inner, ranges, places)))
    if lists_places(name, content):
        return b""
    table = PlaceTable.of(name, content, ranges)
    return None if table is None else box(name, table.moved(content, places))


def _moved(track: bytes, places: Places, is_wide: bool) -> bytes:
    """Returns a track's content with new positions of its chunks."""

    def table(name: bytes, content: bytes) -> bytes | None:
        if name not in (b"stco", b"co64"):
            return None
        return offsets_box(places(chunk_offsets(name, content)), is_wide or name == b"co64")

    return rebuilt(track, table, *STBL)


# ---- writing --------------------------------------------------------------------------------------------------------


def _write(movie: Movie, places: Places, samples: list[tuple[BinaryIO, Chunk]], out: BinaryIO) -> None:
    """Writes a file with some changes.

    Args:
        samples: those of the new film, and the file that each is in.
    """
    at = 0
    for change in places.changes:
        _copy(movie.stream, at, change.start - at, out)
        out.write(change.content(places))
        for number in change.samples:
            source, sample = samples[number]
            _copy(source, sample.start, sample.size, out)
        at = change.end
    _copy(movie.stream, at, movie.length - at, out)


def _copy(source: BinaryIO, start: int, size: int, out: BinaryIO) -> None:
    source.seek(start)
    while size:
        block = source.read(min(size, _BLOCK))
        if not block:
            raise UnshutterError("the clip changed or ended while it was copied")
        out.write(block)
        size -= len(block)
