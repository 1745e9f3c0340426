"""The file form of a Motion: JSON, format ``unshutter-motion/1`` (docs/conventions)."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Readout
from unshutter.motion.motion import Motion
from unshutter.motion.rotation_motion import RotationMotion

FORMAT = "unshutter-motion/1"


def to_json(motion: Motion) -> str:
    """The motion as JSON text."""
    data: dict[str, Any] = {
        "format": FORMAT,
        "height": motion.height,
        "width": motion.width,
        "readout": str(motion.readout),
        "reference": motion.reference,
        "reference_row": motion.reference_row,
        "tx_px": motion.tx_px.tolist(),
        "rz_rad": motion.rz_rad.tolist(),
        "estimator": motion.estimator,
        "confidence": motion.confidence,
        "unshutter": motion.version,
    }
    if isinstance(motion, RotationMotion):  # what maps positions; t_x and r_z are worked out from it
        data["rotations_rad"] = motion.rotations.tolist()
        data["focal_px"] = motion.focal_px
    if motion.center_shift_px:
        data["center_shift_px"] = motion.center_shift_px
    if motion.reason:
        data["reason"] = motion.reason
    return json.dumps(data)


def from_json(text: str) -> Motion:
    """Reads what :func:`to_json` wrote.

    Raises:
        UnshutterError: the text is no motion of this format, or its numbers do not fit together.
    """
    try:
        data = json.loads(text)
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise UnshutterError(f'not a motion file: its "format" is not "{FORMAT}"')
        confidence = data.get("confidence")
        about: dict[str, Any] = {
            "width": int(data["width"]),
            "reference": data.get("reference", "first"),
            "readout": Readout.parse(data.get("readout", "auto")),
            "estimator": str(data.get("estimator", "given")),
            "confidence": None if confidence is None else float(confidence),
            "reason": str(data.get("reason", "")),
            "version": str(data.get("unshutter", "")),
        }
        tx, rz = (np.array(data[key], dtype=np.float64) for key in ("tx_px", "rz_rad"))
        if "rotations_rad" in data:
            rotations = np.array(data["rotations_rad"], dtype=np.float64)
            motion = RotationMotion(rotations=rotations, focal_px=float(data["focal_px"]), **about)
            if not (_same(tx, motion.tx_px) and _same(rz, motion.rz_rad)):
                raise UnshutterError("the motion file contradicts itself: t_x and r_z are not those of its rotations")
        else:
            motion = Motion(tx_px=tx, rz_rad=rz, center_shift_px=float(data.get("center_shift_px", 0.0)), **about)
        height = int(data["height"])
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UnshutterError(f"not a motion file: {error}") from None
    except KeyError as error:
        raise UnshutterError(f"not a motion file: {error} is missing") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise UnshutterError(f"not a usable motion file: {error}") from None
    if height != motion.height:
        raise UnshutterError(f"the motion file says height {height} but has {motion.height} rows")
    return motion


def _same(written: np.ndarray, worked_out: np.ndarray) -> bool:
    return written.shape == worked_out.shape and bool(np.allclose(written, worked_out, rtol=1e-6, atol=1e-6))
