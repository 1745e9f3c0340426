"""Validation of motions: rejects impossible values with a one-line error, whatever their origin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError

# Far beyond any real photo, so that only mistakes exceed them, and far below the limits of floating point.
MOST_SIDE = 1_000_000  # px
MOST_SHIFT_PX = 1e6
MOST_TURN_RAD = 2 * math.pi
LEAST_FOCAL_PX, MOST_FOCAL_PX = 1e-3, 1e9


def read_only(values: Any, dtype: type = np.float64) -> np.ndarray:
    """Returns a read-only copy of an array."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def check_size(height: int, width: int) -> None:
    """Raises UnshutterError if no photo can have this size."""
    if width < 1:
        raise UnshutterError("a motion needs a width of at least 1 px")
    if max(height, width) > MOST_SIDE:
        raise UnshutterError(f"the motion is for a picture of more than {MOST_SIDE} px a side, and none is that large")


def check_finite(*values: Any) -> None:
    """Raises UnshutterError if an array or number contains NaN or infinity."""
    if not all(np.isfinite(value).all() for value in values):
        raise UnshutterError("the motion contains values that are not finite numbers")


def check_lengths(*lengths_px: Any) -> None:
    """Raises UnshutterError if an array or number is not a plausible displacement [px]."""
    check_finite(*lengths_px)
    if any(np.abs(length).max() > MOST_SHIFT_PX for length in lengths_px):
        raise UnshutterError(f"no camera moves a picture by more than {MOST_SHIFT_PX:.0f} px while it is read")


def check_turns(*turns_rad: Any) -> None:
    """Raises UnshutterError if an array or number is not a plausible rotation angle of a camera [rad]."""
    check_finite(*turns_rad)
    if any(np.abs(turn).max() > MOST_TURN_RAD for turn in turns_rad):
        raise UnshutterError("no camera turns by more than 360 degrees while a picture is read")


def check_row_motion(tx_px: np.ndarray, rz_rad: np.ndarray) -> None:
    """Raises UnshutterError unless the arrays are a valid t_x and r_z for every row of a photo."""
    if tx_px.ndim != 1 or tx_px.shape != rz_rad.shape or tx_px.size < 1:
        raise UnshutterError(f"a motion needs one t_x and one r_z per row, got shapes {tx_px.shape} and {rz_rad.shape}")
    check_lengths(tx_px)
    check_turns(rz_rad)


def check_focal(focal_px: float) -> None:
    """Raises UnshutterError if no camera can have this focal length [px]."""
    check_finite(focal_px)
    if focal_px <= 0:
        raise UnshutterError(f"the focal length must be positive, got {focal_px:g} px")
    if not LEAST_FOCAL_PX <= focal_px <= MOST_FOCAL_PX:
        raise UnshutterError(f"no camera has a focal length of {focal_px:g} px")


def check_confidence(confidence: float | None) -> None:
    """Raises UnshutterError if the confidence is neither None nor a number from 0 to 1."""
    if confidence is not None and not 0 <= confidence <= 1:
        raise UnshutterError(f"a confidence lies between 0 and 1, got {confidence:g}")


def check_known(**numbers: float | None) -> None:
    """Raises UnshutterError if a known value of the photo is neither None nor a finite number."""
    for name, number in numbers.items():
        if number is not None and not math.isfinite(number):
            raise UnshutterError(f"the motion's {name} is not a finite number: {number}")


def check_aspect(height: int, width: int, new_height: int, new_width: int) -> None:
    """Raises UnshutterError if a motion for height x width cannot be resized to the new size."""
    check_size(new_height, new_width)
    if new_height < 1 or abs((new_width / width) / (new_height / height) - 1) > 0.02 + 1 / min(new_height, height):
        raise UnshutterError(
            f"cannot fit a motion of {width}x{height} px to {new_width}x{new_height} px: "
            "the aspect ratio differs, it belongs to another photo or readout direction"
        )
