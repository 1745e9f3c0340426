"""Exports a motion: as a map for other programs (NPZ, EXR, TIFF), as moved points (CSV), or as a plot.

Convention: positions refer to **stored** pixels (orientation.py): (col, row), pixel centres at whole numbers. An ST map
expresses them as fractions of the picture, from its bottom left corner: s = (col + 0.5) / W to the right,
t = 1 - (row + 0.5) / H upwards, as read by Nuke's STMap.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import ZipFile

import numpy as np

from unshutter import version
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.motion.finding import Finding
from unshutter.motion.grid import SamplingGrid, gs_to_rs_map, rs_to_gs_map
from unshutter.motion.verdict import Speed, judge
from unshutter.options import MAX_PIXELS, Find, Reference, Undo
from unshutter.photo.embedded_video import videos_beside
from unshutter.photo.libvips import libvips, refusing
from unshutter.photo.photo import open_photo
from unshutter.rectification.find import find as find_motion
from unshutter.single.register import weights_file
from unshutter.storage.files import check_target, read_text, remove_leftovers, written_whole
from unshutter.storage.locations import RunFiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from unshutter.motion.shapes import Float64


SUFFIXES = (".npz", ".exr", ".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class PixelMap:
    """The position in one picture that each pixel of another picture of the same size shows; stored orientation."""

    col: np.ndarray
    row: np.ndarray
    valid: np.ndarray  # bool [H, W], whether that position lies inside the picture

    @classmethod
    def of(cls, motion: Motion, inverse: bool = False) -> PixelMap:
        """Computes the map of a motion for exactly its size.

        Each GS pixel samples the RS photo (rectifies), or with ``inverse`` each RS pixel the GS picture (distorts).
        """
        size = motion.scan_direction.frame_size(motion.height, motion.width)
        grid = SamplingGrid.of(rs_to_gs_map(motion) if inverse else gs_to_rs_map(motion), *size)
        col, row = grid.everywhere()
        return cls(col, row, grid.inside(col, row))

    def st(self) -> np.ndarray:
        """Returns the ST map: float32 [H, W, 3], top row first: s, t, and 1 where valid, else 0."""
        height, width = self.col.shape
        s = (self.col + 0.5) / width
        t = 1 - (self.row + 0.5) / height
        return np.stack([s, t, self.valid], axis=-1).astype(np.float32)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Writes the map atomically.

        ``.npz``: arrays ``map_x`` and ``map_y`` (col and row) for cv2.remap. ``.exr`` (extra ``exr``), ``.tif``,
        ``.tiff``: the ST map, 32-bit float, R = s, G = t, B = valid.
        """
        target = Path(path)
        check_map_target(target, overwrite)
        suffix = target.suffix.lower()
        with written_whole(target, overwrite) as part:
            if suffix == ".npz":
                write_npz(part, map_x=self.col, map_y=self.row)
            elif suffix == ".exr":
                _write_exr(part, target, self.st())
            else:
                with refusing("cannot write {target}", target=target):
                    image = libvips().Image.new_from_array(self.st())
                    image = image.copy(interpretation="srgb")  # otherwise written as linear light
                    image.tiffsave(str(part), compression="deflate")  # not all readers support predictors for floats


def map_file(
    source: Path,
    output: Path,
    *,
    find: Find | None = None,
    reference: Reference | None = None,
    inverse: bool = False,
    size: str | None = None,
    overwrite: bool = False,
) -> Finding:
    """Writes the map of a photo or a motion file.

    Args:
        source: photo whose motion is estimated, or a motion file (``.json``).
        output: map to write, see :meth:`PixelMap.save`.
        find: how the motion is found, by default as :func:`unshutter.estimate` does; for a motion file, only the
            readout direction may be specified.
        reference: row whose time of exposure the GS picture shows; by default the motion's own, otherwise the first.
        inverse: see :meth:`PixelMap.of`.
        size: ``WxH`` of the map in stored pixels, for a scaled copy of the photo; by default the photo's.

    Returns:
        The motion that the map applies, and what is known of it.

    Examples:
        >>> found = map_file(Path("street.jpg"), Path("street.npz"))
        >>> sorted(np.load("street.npz"))
        ['map_x', 'map_y']
    """
    find = find or Find()
    check_map_target(output, overwrite)
    RunFiles(reads=[source, *videos_beside(source), weights_file(find.estimator)]).check(output)
    remove_leftovers(output.parent)
    map_size = None if size is None else _parse_size(size)
    if source.suffix.lower() == ".json":
        find.check_unused()
        finding = Finding.load(source)
        motion = finding.motion
        finding = finding.fit(*motion.scan_direction.frame_size(motion.height, motion.width), find.camera.readout)
    else:
        finding = find_motion(open_photo(source), find).choose(find.candidate)
    finding = finding.rereferenced(reference or finding.motion.reference)
    finding = finding.fit(*map_size) if map_size else finding
    PixelMap.of(finding.motion, inverse).save(output, overwrite)
    return finding


def _parse_size(size: str) -> tuple[int, int]:
    """Parses a size of the form WxH into (height, width)."""
    sides = size.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and 1 <= len(side) <= 9 for side in sides):
        raise UsageError(f"cannot understand the size '{size}': write it like 1920x1080")
    width, height = map(int, sides)
    if not 1 <= width * height <= MAX_PIXELS:
        raise UsageError(f"a map of {size} px cannot be made: it must have 1 to {MAX_PIXELS:,} pixels")
    return height, width


def check_map_target(target: Path, overwrite: bool) -> None:
    """Checks that a map can be written to a file name."""
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"cannot write a map to {target}: its extension must be one of {', '.join(SUFFIXES)}")
    check_target(target, overwrite)
    if suffix == ".exr":
        _openexr()


def _openexr():
    try:
        import OpenEXR
    except ImportError:
        raise UnshutterError(f"EXR files need the extra: {version.extra('exr')} (or write .tif)") from None
    return OpenEXR


def write_npz(part: Path, **arrays: np.ndarray) -> None:
    """Writes arrays as np.savez does, but closes the file on a full disc, where NumPy 2.1 prints a traceback later."""
    with ZipFile(part, "w") as packed:
        for name, array in arrays.items():
            with packed.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


def _write_exr(part: Path, target: Path, st: np.ndarray) -> None:
    exr = _openexr()
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    channels = {name: np.ascontiguousarray(st[..., k]) for k, name in enumerate("RGB")}
    try:
        with exr.File(header, channels) as file:
            file.write(str(part))
    except (RuntimeError, ValueError) as error:
        cause = " ".join(str(error).rpartition(f'"{part}". ')[2].split()).rstrip(".")
        raise UnshutterError(f"cannot write {{target}}: {cause}", target=target) from None


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
    """A CSV file of points; all other columns are preserved."""

    header: list[str] | None  # names of the columns; None if the file has none
    rows: list[list[str]]  # the fields of every non-empty line
    x: int  # index of the column with positions across
    y: int  # index of the column with positions down

    @classmethod
    def read(cls, path: Path) -> PointTable:
        """Reads a table whose header names columns x and y, or one without a header whose first columns are x and y."""
        lines = _filled_lines(path)
        if not lines:
            raise UnshutterError(f"{path} is empty: it has no points")
        first = lines[0][1]
        header = None
        x = 0
        y = 1
        if len(first) < 2 or None in (_number(first[0]), _number(first[1])):
            names = [field.strip().lower() for field in first]
            if names.count("x") != 1 or names.count("y") != 1:
                raise UnshutterError(
                    f"{path}: the first line must name the columns x and y once each, separated by commas, "
                    "or begin with two numbers"
                )
            header = first
            x = names.index("x")
            y = names.index("y")
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

    def write(self, path: Path, x: np.ndarray, y: np.ndarray, overwrite: bool) -> None:
        """Writes the table atomically as UTF-8 CSV, with other positions of four decimals."""
        for fields, new_x, new_y in zip(self.rows, x, y, strict=True):
            fields[self.x], fields[self.y] = f"{new_x:.4f}", f"{new_y:.4f}"
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

    Returns:
        The number of points, and how many of them lie outside the photo.

    Examples:
        >>> motion = unshutter.RowMotion.from_polynomials([0, 60], [0], height=481, width=640)
        >>> _ = Path("points.csv").write_text("100,240")
        >>> move_file(motion, Path("points.csv"), Path("straight.csv"))
        (1, 0)
        >>> Path("straight.csv").read_text().strip()
        '70.0000,240.0000'
    """
    RunFiles(reads=[source]).check(target)
    check_target(target, overwrite)
    remove_leftovers(target.parent)
    table = PointTable.read(source)
    col, row = (p - first_pixel for p in table.positions)
    moved = move_points(motion, col, row, inverse)
    table.write(target, moved[0] + first_pixel, moved[1] + first_pixel, overwrite)
    in_photo = moved if inverse else (col, row)
    height, width = motion.scan_direction.frame_size(motion.height, motion.width)
    seen = [(p >= -0.5) & (p <= size - 0.5) for p, size in zip(in_photo, (width, height), strict=True)]
    return len(col), int(np.sum(~(seen[0] & seen[1])))


def _filled_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Reads line number and fields of every non-empty line of a CSV file."""
    try:
        reader = csv.reader(io.StringIO(read_text(path), newline=""))
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


def plot_motion(found: Finding, path: str | os.PathLike[str], title: str = "", readout_ms: float | None = None) -> None:
    """Plots t_x [px] and r_z [deg] against the row, top row first, into a PNG, SVG or PDF file.

    The title states how far the motion moves the photo, or why the photo would be left unchanged.
    With the readout time, speeds are also plotted: across and along the rows [px/s], and angular [deg/s].
    """
    motion = found.motion
    curves = {"t_x [px]": motion.tx_px, "r_z [deg]": np.degrees(motion.rz_rad)}
    if readout_ms is not None:
        speed = Speed.of(motion, readout_ms)
        curves |= {
            "velocity: columns, rows [px/s]": speed.velocity_px_s,
            "angular velocity [deg/s]": speed.angular_deg_s,
        }
    figure = _figure(3.5 * len(curves))
    axes = figure.subplots(1, len(curves), sharey=True)
    rows = np.arange(motion.height)
    for axis, (label, values) in zip(axes, curves.items(), strict=True):
        axis.plot(values, rows)
        axis.axhline(motion.reference_row, color="grey", lw=0.6, ls=":")
        axis.set_xlabel(label)
    axes[0].set_ylabel("row")
    axes[0].invert_yaxis()
    name = f"{title} ({found.estimator})" if title else found.estimator
    verdict = judge(found, Undo())
    about = verdict.described() if verdict.changes else f"left unchanged ({verdict.described()})"
    figure.suptitle(f"{name}\n{about}", fontsize=10)
    _save(figure, Path(path))


def plot_rotation_rates(
    times_s: Float64[np.ndarray, "frames"],
    rates_deg_s: Float64[np.ndarray, "frames 3"],
    cuts_s: Sequence[float],
    path: Path,
    title: str = "",
    overwrite: bool = True,
) -> None:
    """Plots how fast the camera turned during a clip, into a PNG, SVG or PDF file.

    Args:
        times_s: time at which each frame is shown [s].
        rates_deg_s: angular velocity about x (pitch), y (yaw) and z (roll) [deg/s]; NaN where unknown.
        cuts_s: times of scene changes [s].
    """
    figure = _figure(10)
    axes = figure.subplots()
    for name, values in zip(("r_x (pitch)", "r_y (yaw)", "r_z (roll)"), rates_deg_s.T, strict=True):
        axes.plot(times_s, values, label=name, lw=1)
    for cut in cuts_s:
        axes.axvline(cut, color="grey", lw=0.6, ls=":")
    axes.axhline(0, color="grey", lw=0.6)
    axes.set(xlabel="time [s]", ylabel="angular velocity [deg/s]")
    axes.legend(loc="upper right")
    figure.suptitle(title, fontsize=10)
    _save(figure, path, overwrite)


def check_plot(path: Path) -> None:
    """Checks that a plot can be written, before any work is done."""
    known = _figure(1).canvas.get_supported_filetypes()
    if path.suffix.lower().removeprefix(".") not in known:
        raise UsageError(f"a plot is a .png, .svg or .pdf file, not {path.name}")


def _figure(width: float) -> Figure:
    """Creates an empty figure of this width [inches]."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise UnshutterError(f"plots need the extra: {version.extra('plot')}") from None
    return Figure(figsize=(width, 4), layout="constrained")


def _save(figure: Figure, path: Path, overwrite: bool = True) -> None:
    try:
        with written_whole(path, overwrite) as part:
            figure.savefig(part, dpi=150)
    except ValueError as error:  # an extension that matplotlib does not support
        raise UnshutterError(f"cannot write {path}: {str(error).splitlines()[0]}") from None
