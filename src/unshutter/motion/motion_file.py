"""Motion files: JSON, format ``unshutter-motion/1`` (docs/reference). Independent of the kinds of motion."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError, visible
from unshutter.geometry.readout import Readout
from unshutter.reasons import Reason

FORMAT = "unshutter-motion/1"


def written(kind: str, common: dict[str, Any], rows: dict[str, Any], own: dict[str, Any]) -> str:
    """Returns a motion as JSON text.

    Args:
        kind: tag of the motion's kind.
        common: attributes shared by all kinds.
        rows: height, reference_row, largest_px, tx_px and rz_rad.
        own: additional keys of this kind.
    """
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
    if common["reason"] is not None:
        data["reason"] = str(common["reason"])
        data["declined"] = common["reason"].as_json()
    if common["attitude_from"]:
        held = {name: common[name] for name in ("roll_deg", "tilt_deg")}
        data["attitude"] = {**held, "from": common["attitude_from"]}
    if common["exposure_s"] is not None:
        data["exposure_s"] = common["exposure_s"]
    if common["kind_shares"]:
        data["kinds"] = {name: round(share, 4) for name, share in common["kind_shares"]}
    if common["film"] is not None:
        data["film"] = common["film"].as_json()
    return json.dumps(data)


def parsed(text: str) -> dict[str, Any]:
    """Parses a motion file into its keys and values; call it inside :func:`reading`.

    Raises:
        UnshutterError: the file has another format.
    """
    data = json.loads(text)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UnshutterError(f'not a motion file: its "format" is not "{FORMAT}"')
    return data


def kind_of(data: dict[str, Any]) -> str:
    """Returns the tag of the motion's kind; the earliest files had none."""
    return str(data.get("kind", "rotations" if "rotations_rad" in data else "rows"))


def common_of(data: dict[str, Any]) -> dict[str, Any]:
    """Returns the attributes shared by all kinds of motion."""
    attitude = dict(data.get("attitude") or {})
    return {
        "width": int(data["width"]),
        "reference": str(data.get("reference", "first")),
        "readout": Readout.parse(data.get("readout", "auto")),
        "estimator": visible(str(data.get("estimator", "given"))),
        "confidence": _number(data.get("confidence")),
        "reason": reason_of(data),
        "roll_deg": _number(attitude.get("roll_deg")),
        "tilt_deg": _number(attitude.get("tilt_deg")),
        "attitude_from": visible(str(attitude.get("from", ""))),
        "exposure_s": _number(data.get("exposure_s")),
        "kind_shares": tuple(
            (visible(str(name)), float(share)) for name, share in dict(data.get("kinds") or {}).items()
        ),
        "film": Reason.from_json(data["film"]) if "film" in data else None,
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
    """Turns any error in a malformed file into a one-line message.

    Raises:
        UnshutterError: replaces the exceptions of Python and NumPy.
    """
    try:
        yield
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UnshutterError(f"not a motion file: {error}") from None
    except KeyError as error:
        raise UnshutterError(f"not a motion file: {error} is missing") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise UnshutterError(f"not a usable motion file: {error}") from None
