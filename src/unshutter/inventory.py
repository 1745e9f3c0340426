"""The inventory of an input file: what becomes of each of its parts in the output.

Whoever writes an output works through the parts of its input, and gives each a fate. What is left out is reported.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from unshutter.reasons import JsonObject


class Fate(StrEnum):
    """What becomes of a part."""

    CARRIED = "carried"  # byte for byte
    TRANSFORMED = "transformed"  # as the pixels, their number or their times were
    REPLACED = "replaced"
    LEFT_OUT = "left out"


@dataclass(frozen=True)
class Part:
    """A part of a file: a track, box, segment, chunk or tag, or bytes between them."""

    name: str  # for people
    fate: Fate
    reason: str = ""  # why, in words that follow the name; empty if that goes without saying
    size: int = 0  # length [bytes]; 0 if unknown

    def __str__(self) -> str:
        """Returns the name, and the reason in brackets."""
        return f"{self.name} ({self.reason})" if self.reason else self.name

    def as_json(self) -> JsonObject:
        """Returns the part for logs."""
        reason = {"reason": self.reason} if self.reason else {}
        return {"name": self.name, "fate": self.fate, **reason, "bytes": self.size}


def left_out(parts: Iterable[Part]) -> list[str]:
    """Returns the names of the parts that are left out, with reasons, each once.

    Examples:
        >>> left_out([Part("IPTC", Fate.CARRIED), Part("thumbnail", Fate.LEFT_OUT, "it shows the old pixels")])
        ['thumbnail (it shows the old pixels)']
    """
    return list(dict.fromkeys(str(part) for part in parts if part.fate is Fate.LEFT_OUT))


def as_they_were(parts: Iterable[Part]) -> list[str]:
    """Returns the names of the parts that are carried for a reason that is worth a line, with that reason."""
    return list(dict.fromkeys(str(part) for part in parts if part.fate is Fate.CARRIED and part.reason))


def describe(names: Iterable[str]) -> str:
    """Returns a line about parts that are left out; empty if there are none.

    Examples:
        >>> describe(["IPTC", "thumbnail"])
        'not kept: IPTC, thumbnail'
    """
    listed = ", ".join(names)
    return f"not kept: {listed}" if listed else ""
