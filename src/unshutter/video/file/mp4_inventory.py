"""The inventory of an MP4 or QuickTime file: its tracks and boxes, and the bytes that neither of them covers.

What cannot depend on the frames is carried byte for byte, known or not. What signs the old frames is left out.

Sources: ISO/IEC 14496-12; C2PA Technical Specification (the type of its box); exiftool.org (where cameras put data).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from hashlib import blake2b
from typing import BinaryIO, NamedTuple, TypeAlias

import numpy as np

from unshutter.inventory import Fate, Part
from unshutter.photo.boxes import inside
from unshutter.video.file import mp4_film
from unshutter.video.file.containers import ONE_FILM
from unshutter.video.file.mp4 import DAMAGE, FULL, STBL, Movie, NotPlainError, TopBox, Track, rebuilt
from unshutter.video.file.mp4_film import words

Range: TypeAlias = tuple[int, int]  # positions of the first byte and of that behind the last
_SIGNATURE = bytes.fromhex("d8fec3d61b0e483c92975828877ec481")  # C2PA's content credentials
CREDENTIALS = Part("content credentials", Fate.LEFT_OUT, "they sign the old frames")
_SIGNATURES = (b"c2pa", b"jumb", b"jumd")
LONGEST_TABLE = 1 << 20  # bytes
_BLOCK = 1 << 20  # bytes read at a time
_LONGEST_BEFORE = 16  # bytes in a box before its table
_LONGEST_EMPTY = 8  # bytes of a reference that names no other file
_GPS = b"gps "
_PLACES_OF_SAMPLES = (b"saio", b"saiz")
_MOVED = "it lists places in the file, which move"


# ---- where bytes are ------------------------------------------------------------------------------------------------


def sample_ranges(track: Track) -> list[Range]:
    """Returns where a track's samples are; raises NotPlainError if they are in another file."""
    with suppress(KeyError):
        entries = inside(track.part(b"mdia", b"minf", b"dinf", b"dref")[8:])
        if any(len(entry) > _LONGEST_EMPTY and not entry[3] & 1 for _, entry in entries):
            raise NotPlainError("its samples are in another file")
    starts, ends = track.places
    return [(start, end) for start, end in zip(starts.tolist(), ends.tolist(), strict=True) if end > start]


def merged(ranges: Iterable[Range]) -> list[Range]:
    """Returns ranges in order, those that touch as one."""
    out: list[Range] = []
    for start, end in sorted(ranges):
        if out and start <= out[-1][1]:
            out[-1] = out[-1][0], max(end, out[-1][1])
        else:
            out.append((start, end))
    return out


def without(ranges: Iterable[Range], taken: Iterable[Range]) -> Iterator[list[Range]]:
    """Yields what is left of each range without those that are taken."""
    whole = merged(taken)
    ends = [end for _, end in whole]
    for start, end in ranges:
        pieces = []
        for place in range(bisect_right(ends, start), len(whole)):
            first, last = whole[place]
            if first >= end:
                break
            if start < first:
                pieces.append((start, first))
            start = last
        if start < end:
            pieces.append((start, end))
        yield pieces


def loose(movie: Movie) -> list[Range]:
    """Returns the ranges that no table of samples covers: between them, in other boxes, and behind the last box."""
    covered = merged(each for track in movie.tracks for each in sample_ranges(track))
    boxes = []
    for each in movie.boxes:
        is_empty = each.name != b"mdat" and next(without([each[2:]], covered)) == [each[2:]]
        boxes += [(each.head if is_empty else each.start, each.end)] * (each.name != b"moov")
    behind = (movie.boxes[-1].end, movie.length)
    return [piece for pieces in without([*boxes, behind], covered) for piece in pieces]


def is_signature(name: bytes, content: bytes) -> bool:
    """Whether a box, of which the first bytes suffice, signs the file as it was."""
    return name in _SIGNATURES or (name == b"uuid" and content.startswith(_SIGNATURE))


def signatures(movie: Movie) -> list[TopBox]:
    """Returns the boxes that sign the file as it was."""
    return [each for each in movie.boxes if is_signature(each.name, movie.read_at(each.start, len(_SIGNATURE)))]


def lists_places(name: bytes, content: bytes) -> bool:
    """Whether a box lists where its items or its samples' further data are in the file, and is not kept."""
    if name != b"meta":
        return name in _PLACES_OF_SAMPLES
    for start in (FULL, 0):  # QuickTime's has no version
        with suppress(*DAMAGE):
            if listed := dict(inside(content[start:])).get(b"iloc"):
                return _has_places(listed)
    return False


def _has_places(iloc: bytes) -> bool:
    """Whether items of the box ``iloc`` are elsewhere in the file, not in their own box or in other items."""
    version, (places, base) = iloc[0], iloc[4:6]
    wide = 4 if version == 2 else 2  # bytes of a number of items
    extent = (places >> 4) + (places & 15) + (base & 15 if version else 0)
    count = int.from_bytes(iloc[6 : 6 + wide], "big")
    at = 6 + wide
    for _ in range(count):
        at += wide
        method = iloc[at + 1] & 15 if version else 0
        at += (4 if version else 2) + (base >> 4)
        extents = int.from_bytes(iloc[at : at + 2], "big")
        if extents and method == 0:
            return True
        at += 2 + extents * extent
    return False


def place_lists(movie: Movie) -> list[TopBox]:
    """Returns the boxes outside ``moov`` that list where items are in the file."""
    metas = (each for each in movie.boxes if each.name == b"meta" and each.end - each.start <= LONGEST_TABLE)
    return [each for each in metas if lists_places(each.name, movie.read_at(each.start, each.end - each.start))]


def without_place_lists(track: bytes) -> bytes:
    """Returns the content of a track without boxes that list places in the file, but for those of its samples."""

    def change(name: bytes, content: bytes) -> bytes | None:
        return b"" if lists_places(name, content) else None

    return rebuilt(rebuilt(track, change), change, *STBL)


def behind_and_between(movie: Movie) -> Iterator[tuple[str, list[Range]]]:
    """Yields where there are data that are in no box, or in no sample, with a name."""
    samples = [each for each in movie.boxes if each.name == b"mdat"]
    ranges = loose(movie)
    between = [each for each in ranges if any(holder.start <= each[0] < holder.end for holder in samples)]
    behind = movie.boxes[-1].end
    yield "data between samples", between
    yield "data behind the last box", [each for each in ranges if each[0] >= behind]


class PlaceTable(NamedTuple):
    """A table of places in a file, each with a size: dash cameras list so where their GPS data are."""

    first: int  # position of the first place in its box [bytes]
    kind: str  # of the numbers, as NumPy names it

    @classmethod
    def of(cls, name: bytes, content: bytes, ranges: list[Range]) -> PlaceTable | None:
        """Finds the table in a box of a type; None if it holds none.

        Args:
            ranges: those in order that no table of samples covers.
        """
        starts = np.array([start for start, _ in ranges], np.int64)
        ends = np.array([end for _, end in ranges], np.int64)
        for kind in (">u4", "<u4", ">u8") if 8 <= len(content) <= LONGEST_TABLE and ranges else ():
            for first in range(0, _LONGEST_BEFORE + 1, 4):
                table = cls(first, kind)
                places, sizes = table._rows(content)
                if not len(places):
                    continue
                within = np.searchsorted(starts, places, "right") - 1
                if (within < 0).any() or (sizes <= 0).any() or (places + sizes > ends[within]).any():
                    continue
                begins = np.concatenate([starts, starts + 8, places + sizes])
                if name == _GPS or np.isin(places, begins).all():
                    return table
        return None

    def _rows(self, content: bytes) -> tuple[np.ndarray, np.ndarray]:
        """Returns the places and sizes up to the last that is not 0; none if they do not fill the box."""
        size = 2 * np.dtype(self.kind).itemsize
        if (len(content) - self.first) % size or len(content) - self.first < size:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        rows = np.frombuffer(content, self.kind, offset=self.first).reshape(-1, 2).astype(np.int64)
        used = np.flatnonzero(rows.any(axis=1))
        return tuple(rows[: used[-1] + 1 if len(used) else 0].T)

    def moved(self, content: bytes, places: Callable[[np.ndarray], np.ndarray]) -> bytes:
        """Returns the content of the box with each place moved."""
        old, _ = self._rows(content)
        numbers = np.frombuffer(content, self.kind, offset=self.first).copy()
        numbers[: 2 * len(old) : 2] = places(old)
        return content[: self.first] + numbers.tobytes()


# ---- the inventory --------------------------------------------------------------------------------------------------


def parts(movie: Movie, film: Track, other_films: Collection[int] = (), dolby_vision: bool = False) -> Iterator[Part]:
    """Yields what becomes of each part of a file whose film is replaced.

    Args:
        other_films: IDs of further tracks with moving pictures.
        dolby_vision: whether the new film has that of the old one.
    """
    ranges = loose(movie)
    for track in movie.tracks:
        name = f"track {track.number} ({words(track.handler)}, {words(track.sample_kind)})"
        size = sum(end - start for start, end in sample_ranges(track))
        if track.number != film.number:
            yield Part(name, Fate.CARRIED, ONE_FILM if track.number in other_films else "", size)
            yield from _place_lists_in(track)
            continue
        yield Part(name, Fate.REPLACED, size=size)
        yield from mp4_film.parts(track, dolby_vision)
    for name, content in movie.others:
        is_left = lists_places(name, content)
        fate = Fate.LEFT_OUT if is_left else Fate.TRANSFORMED if PlaceTable.of(name, content, ranges) else Fate.CARRIED
        yield Part(f"box moov/{words(name)}", fate, _MOVED if is_left else "", len(content))
    signed, moved = signatures(movie), place_lists(movie)
    for each in movie.boxes:
        size = each.end - each.head
        if each in signed:
            yield replace(CREDENTIALS, size=size)
        elif each in moved:
            yield Part(f"box {words(each.name)}", Fate.LEFT_OUT, _MOVED, size)
        elif each.name not in (b"moov", b"mdat"):
            yield Part(f"box {words(each.name)}", Fate.CARRIED, size=size)
    for name, held in behind_and_between(movie):
        if held:
            yield Part(name, Fate.CARRIED, size=sum(end - start for start, end in held))


def _place_lists_in(track: Track) -> Iterator[Part]:
    for name, content in (*inside(track.content), *inside(track.part(*STBL))):
        if lists_places(name, content):
            yield Part(f"table {words(name)} of track {track.number}", Fate.LEFT_OUT, _MOVED, len(content))


# ---- the audit ------------------------------------------------------------------------------------------------------


def audited(
    before: BinaryIO, after: BinaryIO, number: int, other_films: Collection[int], dolby_vision: bool = False
) -> list[Part]:
    """Returns what became of each part of a file whose film was replaced; what is found to be lost is among it.

    Args:
        number: ID of the film's track.
        other_films: IDs of further tracks with moving pictures.
        dolby_vision: whether the new film has that of the old one.
    """
    movie = Movie.read(before)
    film = movie.track(number)
    lost = audit(movie, Movie.read(after), film)
    return [
        *parts(movie, film, other_films, dolby_vision),
        *(Part(name, Fate.LEFT_OUT, "it was damaged") for name in lost),
    ]


def audit(before: Movie, after: Movie, film: Track) -> list[str]:
    """Compares a file with one in which the film was replaced; returns what should be as it was, and is not.

    It reads all bytes of both but the film's, and does not know how the second one was written.
    """
    ranges = loose(before), loose(after)
    lost = []
    if _digest(before, ranges[0], ranges[0]) != _digest(after, ranges[1], ranges[1]):
        lost.append("data that no track lists")
    if _boxes(before, ranges[0]) != _boxes(after, ranges[1]):
        lost.append("boxes of moov")
    new = {track.number: track for track in after.tracks}
    for track in before.tracks:
        name = f"track {track.number} ({words(track.sample_kind)})"
        other = new.get(track.number)
        if other is None:
            lost.append(name)
        elif track.number == film.number:
            lost += [] if mp4_film.kept(track) <= mp4_film.kept(other) else [f"descriptions of {name}"]
        elif _masked(track) != _masked(other):
            lost.append(f"tables of {name}")
        elif _digest(before, sample_ranges(track), []) != _digest(after, sample_ranges(other), []):
            lost.append(f"samples of {name}")
    return lost


def _digest(movie: Movie, ranges: list[Range], unlisted: list[Range]) -> bytes:
    """Returns a digest of the bytes in ranges, but for what signs the file, and for places that it lists."""
    tables = {each.head: each for each in movie.boxes if each.name not in (b"moov", b"mdat")}
    signed = {each.head for each in (*signatures(movie), *place_lists(movie))}
    digest = blake2b()
    for start, end in ranges:
        holder = tables.get(start)
        if holder is not None and start in signed:
            continue
        if holder is not None and end - start <= LONGEST_TABLE:
            digest.update(_listless(holder.name, movie.read_at(holder.start, holder.end - holder.start), unlisted))
            continue
        for at in range(start, end, _BLOCK):
            digest.update(movie.read_at(at, min(end - at, _BLOCK)))
    return digest.digest()


def _boxes(movie: Movie, unlisted: list[Range]) -> list[tuple[bytes, bytes]]:
    """Returns the boxes of ``moov`` that are not tracks, without the places that they list."""
    found = []
    for name, content in movie.others:
        inner = inside(content) if name == b"udta" else [(name, content)]
        found += [(each, _listless(each, data, unlisted)) for each, data in inner if not lists_places(each, data)]
    return found


def _listless(name: bytes, content: bytes, ranges: list[Range]) -> bytes:
    table = PlaceTable.of(name, content, ranges)
    return content if table is None else table.moved(content, np.zeros_like)


def _masked(track: Track) -> bytes:
    """Returns the content of a track without the places of its samples."""
    return rebuilt(
        without_place_lists(track.content), lambda name, _: b"" if name in (b"stco", b"co64") else None, *STBL
    )
