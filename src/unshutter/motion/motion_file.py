"""Motion files (JSON, format ``unshutter-motion/1``), and the values that motions of any kind and origin may have."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError, visible
from unshutter.motion.upright import Pose, Stated
from unshutter.orientation import Readout
from unshutter.reasons import Reason

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
        raise UnshutterError(f"the motion is for a picture of more than {MOST_SIDE} px a side, which is too large")


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


def check_focal(focal_px: float) -> None:
    """Raises UnshutterError if no camera can have this focal length [px]."""
    check_finite(focal_px)
    if focal_px <= 0:
        raise UnshutterError(f"the focal length must be positive, got {focal_px:g} px")
    if not LEAST_FOCAL_PX <= focal_px <= MOST_FOCAL_PX:
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


def written(kind: str, common: dict[str, Any], rows: dict[str, Any], own: dict[str, Any]) -> str:
    """Returns a motion as JSON text."""
    data = {
        "format": FORMAT,
        "kind": kind,
        "height": rows["height"],
        "width": common["width"],
        "readout": str(common["readout"]),
        "reference": common["reference"],
        "reference_row": rows["reference_row"],
        "largest_px": round(rows["largest_px"], 3) if math.isfinite(rows["largest_px"]) else None,
        "tx_px": rows["tx_px"].tolist(),
        "rz_rad": rows["rz_rad"].tolist(),
        "estimator": common["estimator"],
        "confidence": common["confidence"],
        "unshutter": common["version"],
        **own,
    }
    reason, film, attitude_from = (common[name] for name in ("reason", "film", "attitude_from"))
    attitude = {"roll_deg": common["roll_deg"], "tilt_deg": common["tilt_deg"], "from": attitude_from}
    attitude |= {"stated": common["stated_angles"]._asdict()} if any(common["stated_angles"]) else {}
    optional = {
        "reason": reason and str(reason),
        "declined": reason and reason.as_json(),
        "attitude": attitude if attitude_from else None,
        "exposure_s": common["exposure_s"],
        "expected_error": None if common["expected_error"] is None else round(common["expected_error"], 6),
        "kinds": {name: round(share, 4) for name, share in common["kind_shares"]} or None,
        "film": film and film.as_json(),
        **{name: common[name] and asdict(common[name]) for name in ("held", "held_at_rest")},
    }
    return json.dumps(data | {name: value for name, value in optional.items() if value is not None})


def parsed(text: str) -> dict[str, Any]:
    """Parses a motion file into its keys and values; call it inside :func:`reading`."""
    data = json.loads(text)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UnshutterError(f'not a motion file: its "format" is not "{FORMAT}"')
    return data


def whole(number: Any) -> int:
    """Returns a whole number of rows or columns; raises ValueError for any other."""
    if int(number) != number:
        raise ValueError(f"{number:g} is not a whole number of rows or columns")
    return int(number)


def common_of(data: dict[str, Any]) -> dict[str, Any]:
    """Returns the attributes shared by all kinds of motion."""
    attitude = dict(data.get("attitude") or {})
    return {
        "width": whole(data["width"]),
        "reference": str(data.get("reference", "first")),
        "readout": Readout.parse(data.get("readout", "auto")),
        "estimator": visible(str(data.get("estimator", "given"))),
        "confidence": _number(data.get("confidence")),
        "expected_error": _number(data.get("expected_error")),
        "reason": reason_of(data),
        "roll_deg": _number(attitude.get("roll_deg")),
        "tilt_deg": _number(attitude.get("tilt_deg")),
        "attitude_from": visible(str(attitude.get("from", ""))),
        "stated_angles": Stated(**{name: bool(own) for name, own in dict(attitude.get("stated") or {}).items()}),
        "exposure_s": _number(data.get("exposure_s")),
        "kind_shares": tuple(
            (visible(str(name)), float(share)) for name, share in dict(data.get("kinds") or {}).items()
        ),
        "film": Reason.from_json(data["film"]) if "film" in data else None,
        **{name: Pose(**data[name]) for name in ("held", "held_at_rest") if name in data},
        "version": visible(str(data.get("unshutter", ""))),
    }


def reason_of(data: dict[str, Any]) -> Reason | None:
    """Returns why there is no motion; versions before 1.1 wrote only the sentence."""
    if "declined" in data:
        return Reason.from_json(data["declined"])
    sentence = visible(str(data.get("reason", "")))
    return Reason.stated(sentence) if sentence else None


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def numbers(values: Any) -> np.ndarray:
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
