"""Moves what refers to a clip's times along with a part of it: chapters, and the timecode of the first frame.

Source of drop-frame timecodes: SMPTE ST 12-1, which leaves out two (of 60 frames: four) numbers each minute but every
tenth.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import Any

_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d)")


def chapters_of_part(chapters: list[dict[str, Any]], start_s: float, end_s: float) -> list[dict[str, Any]]:
    """Returns the chapters of a part that begins and ends at these times [s], on its own clock.

    Args:
        chapters: as PyAV gives them.
    """
    found: list[dict[str, Any]] = []
    for chapter in chapters:
        base = chapter["time_base"]
        begin, end = (max(min(float(chapter[key] * base), end_s) - start_s, 0.0) for key in ("start", "end"))
        if end > begin:
            times = {"start": round(begin / base), "end": round(end / base)}
            found.append({**chapter, **times})
    return found


def timecode_after(timecode: str, seconds: float, rate: Fraction) -> str:
    """Returns the timecode of the first frame shown at least this many seconds after one with a known timecode.

    A text of another kind is returned unchanged.

    Examples:
        >>> timecode_after("01:02:03:04", 0.9, Fraction(30))
        '01:02:04:01'
        >>> timecode_after("00:00:59;29", 1 / 29.97, Fraction(30000, 1001))
        '00:01:00;02'
    """
    match = _TIMECODE.fullmatch(timecode)
    whole = round(rate)
    if match is None or not whole:
        return timecode
    hours, minutes, secs, mark, number = match.groups()
    dropped = 0 if mark == ":" else 2 * round(whole / 30)
    all_minutes = 60 * int(hours) + int(minutes)
    count = (60 * all_minutes + int(secs)) * whole + int(number) - dropped * (all_minutes - all_minutes // 10)
    count += math.ceil(seconds * rate - 1e-6)
    tens, rest = divmod(count, 600 * whole - 9 * dropped)
    minute = max(rest - dropped, 0) // (60 * whole - dropped)  # the first one of ten has all numbers
    count += dropped * (9 * tens + minute)
    all_seconds, number = divmod(count, whole)
    return f"{all_seconds // 3600 % 24:02}:{all_seconds // 60 % 60:02}:{all_seconds % 60:02}{mark}{number:02}"
