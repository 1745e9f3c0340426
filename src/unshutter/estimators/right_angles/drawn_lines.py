"""Lines that a person draws in a photo, and files of them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from unshutter.errors import UnshutterError, UsageError

LineKind: TypeAlias = Literal["upright", "level", "straight"]

FORMAT = "unshutter-lines/1"
MOST_LINES, MOST_POINTS = 100, 100


@dataclass(frozen=True)
class DrawnLine:
    """A line drawn by a person.

    Attributes:
        kind: ``upright``: vertical in the scene; ``level``: horizontal in the scene, receding or not; ``straight``:
            straight in the scene, in any direction.
        points: two or more (col, row) along it [px of the stored photo]; a straight line needs three.

    Raises:
        UsageError: unknown kind, too few or too many points, or a position that is not finite.
    """

    kind: LineKind
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if self.kind not in get_args(LineKind):
            raise UsageError(f"unknown kind of line '{self.kind!s:.40}': choose upright, level or straight")
        fewest = 3 if self.kind == "straight" else 2
        if not fewest <= len(self.points) <= MOST_POINTS:
            raise UsageError(f"a line that is {self.kind} needs {fewest} to {MOST_POINTS} points")
        if not all(math.isfinite(value) and abs(value) < 1e9 for point in self.points for value in point):
            raise UsageError("the points of a line are positions in the photo [px]")


def lines_from_json(text: str) -> tuple[DrawnLine, ...]:
    """Parses text written by :func:`lines_to_json`.

    Raises:
        UnshutterError: the text has another format.
        UsageError: a line is invalid.
    """
    try:
        data = json.loads(text)
        if data["format"] != FORMAT:
            raise ValueError
        return checked_lines([DrawnLine(each["kind"], _points(each["points"])) for each in data["lines"]])
    except (ValueError, TypeError, KeyError, RecursionError):
        line = '{"kind": "upright", "points": [[col, row], [col, row]]}'
        example = f'{{"format": "{FORMAT}", "lines": [{line}]}}'
        raise UnshutterError(f"not a file of drawn lines: it must be {example}") from None


def read_lines(path: Path) -> tuple[DrawnLine, ...]:
    """Reads a file of lines.

    Raises:
        UnshutterError: the file cannot be read, or does not have the format of :func:`lines_to_json`.
    """
    try:
        return lines_from_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UnshutterError(f"cannot read {path}: {getattr(error, 'strerror', None) or 'it is not text'}") from None


def lines_to_json(lines: Iterable[DrawnLine]) -> str:
    """Returns lines as the text of a file, format ``unshutter-lines/1``."""
    listed = [{"kind": line.kind, "points": [list(point) for point in line.points]} for line in lines]
    return json.dumps({"format": FORMAT, "lines": listed})


def checked_lines(lines: Sequence[DrawnLine]) -> tuple[DrawnLine, ...]:
    """Returns the lines after checking their number.

    Raises:
        UsageError: there are none, or too many.
    """
    if not 1 <= len(lines) <= MOST_LINES:
        raise UsageError(f"draw at least one line, and at most {MOST_LINES}")
    return tuple(lines)


def _points(points: Any) -> tuple[tuple[float, float], ...]:
    return tuple((float(col), float(row)) for col, row in points)
