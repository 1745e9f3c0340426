"""Finds the film that belongs to a photo: in its file (Google's and Samsung's phones) or next to it (Apple's).

Source: Google, Motion Photo format 1.0; Apple, Live Photos: both files hold the same content identifier, the photo in
its maker note, the film under a key of QuickTime's metadata (names as listed by exiftool.org, facts only).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from unshutter.photo.containers import motion_photo
from unshutter.photo.tags import maker_notes

if TYPE_CHECKING:
    from unshutter.photo.metadata import Metadata
    from unshutter.photo.source import Source

_SUFFIXES = (".mov", ".MOV", ".Mov")


class PhotoFilm(NamedTuple):
    """A film that belongs to a photo.

    Attributes:
        place: an MP4 file in memory, or the path of a QuickTime file.
        moment_s: time at which the photo was taken, in the film's time [s]; None: unknown.
        identifier: content identifier that the film must have; empty: any.
    """

    place: bytes | Path
    moment_s: float | None = None
    identifier: str = ""


def film_of(source: Source | None, format: str, metadata: Metadata) -> PhotoFilm | None:
    """Finds the film that belongs to a photo; returns None if there is none.

    Args:
        source: the photo's encoded data; None: its pixels are new.
        format: format of the encoded data.
        metadata: metadata of the photo.
    """
    inside = metadata.film.content if metadata.film is not None else None
    if source is not None and format == "heic":
        with source.stream() as stream:
            inside = motion_photo.film_in_boxes(stream)
    if inside is not None:
        return PhotoFilm(inside, motion_photo.moment_s(metadata.xmp))
    path = source.path if source is not None else None
    others = [path.with_suffix(suffix) for suffix in _SUFFIXES] if path is not None else []
    place = next((other for other in others if other.is_file()), None)
    identifier = maker_notes.content_identifier(metadata.exif) if place is not None else ""
    return PhotoFilm(place, None, identifier) if place is not None and identifier else None
