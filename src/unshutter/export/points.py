"""Moves points by a motion, from the photo to the rectified picture or back, and reads and writes tables of points.

Convention: positions refer to **stored** pixels (readout.py): (col, row), pixel centres at whole numbers.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion
from unshutter.storage.files import check_target, remove_leftovers, written_whole
from unshutter.storage.protection import Protection
from unshutter.warp.grid import gs_to_rs_map, rs_to_gs_map


def move_points(
    motion: Motion, col: np.ndarray, row: np.ndarray, inverse: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Moves points of the RS photo to their positions in the GS picture, or with ``inverse`` the other way round.

    Args:
        motion: motion of the photo, for its full size.
        col, row: stored positions [px], any shape.
        inverse: GS -> RS instead of RS -> GS.

    Returns:
        (col, row) [px], float64. Outside the photo the motion is extrapolated, which is a guess.

    Raises:
        UnshutterError: the motion turns faster than rows are read.

    Examples:
        >>> motion = unshutter.RowMotion.from_polynomials([0, 60], [0], height=481, width=640)  # sheared by 60 px
        >>> col, row = move_points(motion, [100.0], [240.0])
        >>> col.round(), row.round()
        (array([70.]), array([240.]))
    """
    position = gs_to_rs_map(motion) if inverse else rs_to_gs_map(motion)
    with np.errstate(all="ignore"):  # far outside, Newton's method may diverge
        moved = position(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    return moved[0], moved[1]


@dataclass(frozen=True)
class PointTable:
    """A CSV file of points; all other columns are preserved.

    Attributes:
        header: names of the columns; None if the file has none.
        rows: the fields of every non-empty line.
        x, y: indices of the columns that hold the position.
    """

    header: list[str] | None
    rows: list[list[str]]
    x: int
    y: int

    @classmethod
    def read(cls, path: Path) -> PointTable:
        """Reads a table whose header names columns x and y, or one without a header whose first columns are x and y.

        Raises:
            UnshutterError: the file cannot be read, or a line (named in the message) is not a point.
        """
        lines = _filled_lines(path)
        if not lines:
            raise UnshutterError(f"{path} holds no points: it is empty")
        first = lines[0][1]
        header, x, y = None, 0, 1
        if len(first) < 2 or None in (_number(first[0]), _number(first[1])):
            names = [field.strip().lower() for field in first]
            if names.count("x") != 1 or names.count("y") != 1:
                raise UnshutterError(
                    f"{path}: the first line must name the columns x and y once each, separated by commas, "
                    "or begin with two numbers"
                )
            header, x, y = first, names.index("x"), names.index("y")
            lines = lines[1:]
        for number, fields in lines:
            if len(fields) != len(first):
                columns = f"{len(fields)} columns where the first line has {len(first)}"
                raise UnshutterError(f"{path}, line {number}: {columns}")
            for name, field in (("x", fields[x]), ("y", fields[y])):
                if _number(field) is None:
                    raise UnshutterError(f"{path}, line {number}: {name} is {field[:40]!r}, not a number")
        return cls(header, [fields for _, fields in lines], x, y)

    @property
    def positions(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (x, y) of all points, float64 [N]."""
        x, y = (np.array([float(fields[k]) for fields in self.rows]) for k in (self.x, self.y))
        return x, y

    def moved_to(self, x: np.ndarray, y: np.ndarray) -> PointTable:
        """Returns a table with other positions, written with four decimals."""
        rows = [list(fields) for fields in self.rows]
        for fields, new_x, new_y in zip(rows, x, y, strict=True):
            fields[self.x], fields[self.y] = f"{new_x:.4f}", f"{new_y:.4f}"
        return PointTable(self.header, rows, self.x, self.y)

    def write(self, path: Path, overwrite: bool = True) -> None:
        """Writes the table atomically as UTF-8 CSV; replaces an existing file by default."""
        with written_whole(path, overwrite) as part, part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerows(([self.header] if self.header else []) + self.rows)


def move_file(
    motion: Motion, source: Path, target: Path, inverse: bool = False, first_pixel: float = 0.0, overwrite: bool = False
) -> tuple[int, int]:
    """Moves the points of one CSV file and writes them to another.

    Args:
        motion: motion of the photo, for its full size.
        source, target: CSV files (:class:`PointTable`).
        inverse: GS -> RS instead of RS -> GS.
        first_pixel: coordinate of the first pixel's centre in the files: 0 (OpenCV, unshutter), 0.5 (COLMAP).
        overwrite: whether the target may be replaced.

    Returns:
        The number of points, and how many of them lie outside the photo.

    Raises:
        UnshutterError: a file or the motion cannot be used.

    Examples:
        >>> motion = unshutter.RowMotion.from_polynomials([0, 60], [0], height=481, width=640)
        >>> _ = Path("points.csv").write_text("100,240")
        >>> move_file(motion, Path("points.csv"), Path("straight.csv"))
        (1, 0)
        >>> Path("straight.csv").read_text().strip()
        '70.0000,240.0000'
    """
    Protection([source]).check(target)
    check_target(target, overwrite)
    remove_leftovers(target.parent)
    table = PointTable.read(source)
    col, row = (p - first_pixel for p in table.positions)
    moved = move_points(motion, col, row, inverse)
    table.moved_to(moved[0] + first_pixel, moved[1] + first_pixel).write(target, overwrite)
    in_photo = moved if inverse else (col, row)
    height, width = motion.readout.frame_size(motion.height, motion.width)
    seen = [(p >= -0.5) & (p <= size - 0.5) for p, size in zip(in_photo, (width, height), strict=True)]
    return len(col), int(np.sum(~(seen[0] & seen[1])))


def _filled_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Reads line number and fields of every non-empty line of a CSV file."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            return [(reader.line_num, fields) for fields in reader if any(fields)]
    except OSError as error:
        raise UnshutterError(f"cannot read points {path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise UnshutterError(f"cannot read points {path}: not a CSV text file") from None


def _number(field: str) -> float | None:
    """Parses a finite number; returns None if the field is not one."""
    try:
        value = float(field)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
