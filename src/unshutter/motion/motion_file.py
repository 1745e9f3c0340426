"""Motion files (JSON, format ``unshutter-motion/1``), and the limits on values in motions of any kind."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict, TypeVar, cast

import numpy as np

from unshutter.errors import MissingFileError, UnshutterError, visible
from unshutter.motion.shapes import ArrayLike
from unshutter.options import Reference
from unshutter.orientation import ScanDirection
from unshutter.reasons import JsonObject, Reason
from unshutter.storage.files import check_motion_name, check_target, read_text, written_whole
from unshutter.version import __version__

# Far beyond any real photo, so that only mistakes exceed them, and far below the limits of floating point.
MOST_SIDE = 1_000_000  # px
MOST_SHIFT_PX = 1e6


class Keywords(TypedDict, total=False):
    """Optional attributes of all kinds of motion, see :class:`Motion`."""

    reference: Reference
    scan_direction: ScanDirection


class Common(Keywords):
    """Attributes of all kinds of motion."""

    width: int


def read_only(values: ArrayLike, dtype: type = np.float64) -> np.ndarray:
    """Returns a read-only copy of an array."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def check_size(height: int, width: int) -> None:
    """Raises UnshutterError if no photo can have this size."""
    if width < 1:
        raise UnshutterError("a motion needs a width of at least 1 px")
    if max(height, width) > MOST_SIDE:
        raise UnshutterError(f"the motion is for a picture of more than {MOST_SIDE} px a side, which is too large")


def check_finite(*values: ArrayLike) -> None:
    """Raises UnshutterError if an array or number contains NaN or infinity."""
    if not all(np.isfinite(value).all() for value in values):
        raise UnshutterError("the motion contains values that are not finite numbers")


def check_lengths(*lengths_px: ArrayLike) -> None:
    """Raises UnshutterError if an array or number is not a plausible displacement [px]."""
    check_finite(*lengths_px)
    if any(np.abs(length).max() > MOST_SHIFT_PX for length in lengths_px):
        raise UnshutterError(f"no camera moves a picture by more than {MOST_SHIFT_PX:.0f} px while it is read")


def check_rotations(*turns_rad: ArrayLike) -> None:
    """Raises UnshutterError if an array or number is not a plausible rotation angle of a camera [rad]."""
    check_finite(*turns_rad)
    if any(np.abs(rotation).max() > 2 * math.pi for rotation in turns_rad):
        raise UnshutterError("no camera turns by more than 360 degrees while a picture is read")


def check_focal(focal_px: float) -> None:
    """Raises UnshutterError if no camera can have this focal length [px]."""
    check_finite(focal_px)
    if focal_px <= 0:
        raise UnshutterError(f"the focal length must be positive, got {focal_px:g} px")
    if not 1e-3 <= focal_px <= 1e9:
        raise UnshutterError(f"no camera has a focal length of {focal_px:g} px")


def check_aspect(height: int, width: int, new_height: int, new_width: int) -> None:
    """Raises UnshutterError if a motion for height x width cannot be resized to the new size."""
    check_size(new_height, new_width)
    if new_height < 1 or abs((new_width / width) / (new_height / height) - 1) > 0.02 + 1 / min(new_height, height):
        raise UnshutterError(
            f"cannot fit a motion of {width}x{height} px to {new_width}x{new_height} px: "
            "their aspect ratios differ, so it belongs to another photo or readout direction"
        )


FORMAT = "unshutter-motion/1"
# what a file says of a motion of which nothing is known but its geometry
GIVEN = {"estimator": "given", "confidence": None, "unshutter": __version__}


def parsed(text: str) -> JsonObject:
    """Parses a motion file into its keys and values; call it inside :func:`reading`."""
    data = json.loads(text)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UnshutterError(f'not a motion file: its "format" is not "{FORMAT}"')
    return data


def whole_number(number: float) -> int:
    """Returns a whole number of rows or columns; raises ValueError for any other."""
    if int(number) != number:
        raise ValueError(f"{number:g} is not a whole number of rows or columns")
    return int(number)


def common_of(data: JsonObject) -> Common:
    """Returns the attributes shared by all kinds of motion."""
    reference = cast(Reference, str(data.get("reference", "first")))  # which the motion checks
    return Common(
        width=whole_number(data["width"]),
        reference=reference,
        scan_direction=ScanDirection.parse(data.get("readout", "auto")),
    )


def reason_of(data: JsonObject) -> Reason | None:
    """Returns the reason why there is no motion; versions before 1.1 wrote only its sentence."""
    if "declined" in data:
        return Reason.from_json(data["declined"])
    sentence = visible(str(data.get("reason", "")))
    return Reason.stated(sentence) if sentence else None


def number_of(value: float | None) -> float | None:
    """Returns a number, or None for null; raises TypeError or ValueError for anything else."""
    return None if value is None else float(value)


def numbers(values: ArrayLike) -> np.ndarray:
    """Converts nested lists from a file to an array; raises ValueError or TypeError if they are not numeric."""
    return np.array(values, dtype=np.float64)


@contextmanager
def reading() -> Iterator[None]:
    """Turns any error in a malformed file into a one-line message."""
    try:
        yield
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UnshutterError(f"not a motion file: {error}") from None
    except KeyError as error:
        raise UnshutterError(f"not a motion file: {error} is missing") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise UnshutterError(f"not a usable motion file: {error}") from None


_Contents = TypeVar("_Contents")


def read_file(path: str | os.PathLike[str], parse: Callable[[str], _Contents]) -> _Contents:
    """Reads a motion file; raises the errors of :meth:`Motion.load`."""
    try:
        text = read_text(Path(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        kind = MissingFileError if isinstance(error, FileNotFoundError) else UnshutterError
        raise kind(f"cannot read motion file {{motion}}: {reason}", motion=path) from None
    try:
        return parse(text)
    except UnshutterError as error:
        error.subject = str(path)
        raise


def save(path: str | os.PathLike[str], text: str) -> None:
    """Writes a motion file, replacing one of this name; raises the errors of :meth:`Motion.save`."""
    target = Path(path)
    check_motion_name(target.name)
    check_target(target, overwrite=True)
    if target.exists():
        try:
            parsed(read_text(target))
        except (OSError, ValueError, RecursionError, UnshutterError):
            message = "cannot write {motion}: it is another file, not a motion: choose another name"
            raise UnshutterError(message, motion=target) from None
    with written_whole(target) as part:
        part.write_text(text + "\n", encoding="utf-8")
