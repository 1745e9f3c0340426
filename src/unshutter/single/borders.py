"""Borders round the picture of a photo: framed scans, screenshots and letterboxed pictures, whose edges are plain.

The camera saw only what lies between them, and where its first row was read is not known of a scan or a screenshot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.motion.shapes import UInt8


@dataclass(frozen=True)
class BorderParams:
    """What counts as a border; lines are rows, or columns."""

    alike: int = 6  # levels by which its pixels differ from its own, at most
    plain: float = 0.98  # least share of a line that is so
    picture: float = 0.5  # largest share of a line of the picture that is so
    soft: float = 0.01  # share of all lines over which its inner edge may be blurred
    least: float = 0.015  # share of all lines that it takes, at least
    most: float = 0.45  # and at most


_PARAMS = BorderParams()


def has_border(grey: UInt8[np.ndarray, "rows columns"]) -> bool:
    """Whether plain lines of one level run along two opposite sides, and end at once: no sky, sea or backdrop does."""
    sides = ((grey, grey[::-1]), (grey.T, grey.T[::-1]))
    return any(_begins_plain(first) and _begins_plain(second) for first, second in sides)


def _begins_plain(lines: UInt8[np.ndarray, "lines across"]) -> bool:
    count = len(lines)
    soft = max(round(_PARAMS.soft * count), 2)
    few = lines[: round(_PARAMS.most * count) + 2 * soft].astype(np.int16)
    level = np.median(few[:2])
    alike = (np.abs(few - level) <= _PARAMS.alike).mean(axis=1)
    if (alike >= _PARAMS.plain).all():
        return False
    edge = int(np.argmax(alike < _PARAMS.plain))
    beyond = alike[edge + soft : edge + 2 * soft]
    return _PARAMS.least * count <= edge <= _PARAMS.most * count and bool(np.median(beyond) < _PARAMS.picture)
