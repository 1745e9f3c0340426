"""How long a photo was exposed, and whether it was put together from several exposures.

Source: CIPA DC-008 (EXIF 2.32): ExposureTime, ShutterSpeedValue, CustomRendered, CompositeImage; the values that Apple
adds to CustomRendered and its maker note's tag 0x000A are those that exiftool.org lists (facts only).
"""

from __future__ import annotations

import struct
from fractions import Fraction

from unshutter.photo.tags import exif, maker_notes
from unshutter.photo.tags.directories import EXIF, Entry, Tree

_EXPOSURE_TIME, _SHUTTER_SPEED = 0x829A, 0x9201
_CUSTOM_RENDERED, _COMPOSITE = 0xA401, 0xA460
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0  # beyond, the tag is nonsense
# HDR, HDR with the original kept, panorama, portrait HDR (Apple); 1, a process of the maker's own, is Google's HDR
_MERGED_BY_CUSTOM_RENDERED = (1, 2, 3, 6, 7)
_MERGED_BY_COMPOSITE = (2, 3)  # a composite; one made while it was taken
_APPLE_HDR, _IS_HDR = 0x000A, 3


def time_s(blob: bytes | None) -> float | None:
    """Exposure time [s] that an EXIF blob tells; None where it tells none, or what no camera does."""
    tree = exif.read(blob)
    if tree is None:
        return None
    told = _first(tree, _EXPOSURE_TIME)
    if told is None and (speed := _first(tree, _SHUTTER_SPEED)) is not None and abs(speed) < 40:
        told = 2.0**-speed  # APEX
    return told if told is not None and _SHORTEST_S <= told <= _LONGEST_S else None


def blob_of(time_s: float) -> bytes | None:
    """EXIF that tells an exposure time [s] and nothing else; None for what :func:`time_s` would not believe."""
    if not _SHORTEST_S <= time_s <= _LONGEST_S:
        return None
    time = Fraction(time_s).limit_denominator(1_000_000)
    entry = Entry(5, 1, struct.pack("<II", time.numerator, time.denominator))
    return exif.of_tiff(Tree("<", [{EXIF: {_EXPOSURE_TIME: entry}}]))


def is_merged(blob: bytes | None) -> bool:
    """Whether a photo was put together from several exposures, of which its exposure time is but one.

    Blur then says less about motion: each of them may have been sharper or moved more than the whole.
    """
    tree = exif.read(blob)
    if tree is None:
        return False
    if tree.number(_CUSTOM_RENDERED, EXIF) in _MERGED_BY_CUSTOM_RENDERED:
        return True
    if tree.number(_COMPOSITE, EXIF) in _MERGED_BY_COMPOSITE:
        return True
    note = maker_notes.read(blob)
    return note is not None and note.maker == "Apple" and note.numbers(_APPLE_HDR) == (_IS_HDR,)


def _first(tree: Tree, tag: int) -> float | None:
    found = tree.numbers(tag, EXIF)
    return found[0] if found else None
