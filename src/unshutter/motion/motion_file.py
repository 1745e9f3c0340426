"""The file form of a motion: JSON, format ``unshutter-motion/1`` (docs/reference). Knows no kind of motion."""

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
    """A motion as JSON text.

    Args:
        kind: its tag.
        common: its attributes that all kinds have.
        rows: height, reference_row, largest_px, tx_px and rz_rad.
        own: further keys of its kind.
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
    """The keys and values of a motion file; to be read inside :func:`reading`.

    Raises:
        UnshutterError: it is of another format.
    """
    data = json.loads(text)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UnshutterError(f'not a motion file: its "format" is not "{FORMAT}"')
    return data


def kind_of(data: dict[str, Any]) -> str:
    """The tag of the motion's kind; the first files had none."""
    return str(data.get("kind", "rotations" if "rotations_rad" in data else "rows"))


def common_of(data: dict[str, Any]) -> dict[str, Any]:
    """The attributes that all kinds of motion have."""
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
    """Why there is no motion; versions before 1.1 wrote the sentence alone."""
    if "declined" in data:
        return Reason.from_json(data["declined"])
    sentence = visible(str(data.get("reason", "")))
    return Reason.stated(sentence) if sentence else None


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def numbers(values: Any) -> np.ndarray:
    """Nested lists of a file as an array; ValueError or TypeError where they are none of numbers."""
    return np.array(values, dtype=np.float64)


@contextmanager
def reading() -> Iterator[None]:
    """Whatever is wrong with a stranger's file becomes one line.

    Raises:
        UnshutterError: instead of what Python and NumPy raise.
    """
    try:
        yield
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UnshutterError(f"not a motion file: {error}") from None
    except KeyError as error:
        raise UnshutterError(f"not a motion file: {error} is missing") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise UnshutterError(f"not a usable motion file: {error}") from None
