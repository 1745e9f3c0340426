"""The parts of a photo's file: what a reader found, and what becomes of each in a result (inventory.py)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from unshutter.inventory import Fate, Part

OTHER = "other data"  # what has no name of its own: chunks, segments, tags of other programs
PICTURES = "further pictures"
DAMAGED = "damaged"
GAIN_MAP = "gain map"
DEPTH_MAP = "depth map"
CONFIDENCE_MAP = "confidence map"  # of a depth map
MATTES = "mattes"
EXTENDED_XMP = "XMP (beyond the first 64 kB)"
AUXILIARY = (GAIN_MAP, DEPTH_MAP, CONFIDENCE_MAP, MATTES)  # pictures in the photo's own coordinates


class Found(NamedTuple):
    """A part of a file."""

    name: str  # for people
    size: int = 0  # [bytes]; 0: unknown
    held: str = ""  # attribute of ``Metadata`` that holds its content
    otherwise: Fate = Fate.LEFT_OUT  # its fate where nothing holds it; replaced: it only describes the old pixels
    reason: str = ""  # why it is left out

    def part(self, holds: Iterable[str], changed: Iterable[str]) -> Part:
        """Returns the part with its fate in a format that can hold some attributes, of which some have changed."""
        if self.held not in holds:
            return Part(self.name, self.otherwise, self.reason, self.size)
        return Part(self.name, Fate.TRANSFORMED if self.held in changed else Fate.CARRIED, "", self.size)


def of_coding(name: str, size: int = 0) -> Found:
    """Returns a part that describes the old pixels, their encoding or the structure of their file."""
    return Found(name, size, otherwise=Fate.REPLACED)


def further_picture(name: str, size: int = 0, held: str = "") -> Found:
    """Returns a part that is a further picture, or belongs to one."""
    return Found(name, size, held, reason="the result is SDR" if name == GAIN_MAP else "")


def without(found: tuple[Found, ...], held: str, name: str, reason: str = "") -> tuple[Found, ...]:
    """Returns the parts where what an attribute holds is left out for a reason: there is at least one of that name."""
    held_parts = (part for part in found if part.held == held)
    gone = (part._replace(held="", otherwise=Fate.LEFT_OUT, reason=reason or part.reason) for part in held_parts)
    return *(part for part in found if part.held != held), *(list(gone) or [Found(name, reason=reason)])


def lost(names: Iterable[str]) -> Iterator[Part]:
    """Yields parts that are left out."""
    return (Part(name, Fate.LEFT_OUT) for name in names)


# What further pictures in a file show, by the names of their kind in boxes or in XMP, in lower case. Sources: ISO/IEC
# 23008-12 (auxiliary images), ISO 21496-1 and Adobe (gain maps), Apple's names, Google's depth maps.
_PURPOSES = (
    (re.compile(rb":auxid:1$|auxiliary:alpha"), ""),  # transparency, which is kept
    (re.compile(rb"hdr-?gain-?map|hdrgm:|hdr-gain-map|iso:ts:21496"), GAIN_MAP),
    (
        re.compile(
            rb":auxid:2\b|auxiliary:depth|aux:(depth|disparity)|imagetype\W{1,4}(depth|disparity)|gdepth|depthmap"
        ),
        DEPTH_MAP,
    ),
    (re.compile(rb"aux:\w*matte"), MATTES),
)


def purpose(kind: bytes) -> str | None:
    """Names a further picture by its kind; empty for transparency, None for an unknown kind."""
    kind = kind.lower()
    return next((words for pattern, words in _PURPOSES if pattern.search(kind)), None)
