"""Candidate: one of the possible motions of a photo, with its probability and a description."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from unshutter.geometry.readout import scene_up
from unshutter.motion.motion import Motion
from unshutter.reasons import pixels

KindOfMotion = Literal["still", "pan", "hand", "quadratic", "other"]
Direction = Literal["left", "right", "up", "down"]

_TURNS = {"left": "to the left", "right": "to the right", "up": "upwards", "down": "downwards"}
_NAMES = {"hand": "hand", "quadratic": "uneven motion", "other": "motion"}
_UPRIGHT = 1  # EXIF orientation of a photo stored upright


@dataclass(frozen=True, eq=False)
class Candidate:
    """A possible motion of a photo; leaving the photo unchanged is also a candidate.

    Attributes:
        kind: still (the photo is left unchanged), pan, hand (shake), quadratic (uneven motion, as drawn in benchmarks),
            or other (for methods that do not report a kind).
        motion: for the photo's full size, with the first row as the reference.
        probability: that this is what happened, 0 to 1; None if the method does not report one.
        expected_error_px: mean remaining displacement after undoing this motion [px]; None if the method does not
            report one.
        orientation: EXIF orientation of the photo; determines the directions in the description.
    """

    kind: KindOfMotion
    motion: Motion
    probability: float | None = None
    expected_error_px: float | None = None
    orientation: int = _UPRIGHT

    @property
    def description(self) -> str:
        """Short description, e.g. ``pan to the left, 24 px``, ``hand, 9 px`` or ``as it is``."""
        if self.kind == "still":
            return "as it is"
        name = f"pan {_TURNS[self.direction]}" if self.kind == "pan" else _NAMES[self.kind]
        return f"{name}, {pixels(self.motion.largest_px)}"

    def described(self) -> str:
        """Description with the known figures, e.g. ``pan to the left, 24 px (probability 0.62, off by 3.1 px)``."""
        stated = [] if self.probability is None else [f"probability {self.probability:.2f}"]
        if self.expected_error_px is not None:
            stated.append(f"off by {pixels(self.expected_error_px)}")
        return f"{self.description} ({', '.join(stated)})" if stated else self.description

    def as_json(self) -> dict[str, Any]:
        """Returns ``kind``, ``description``, ``probability``, ``expected_error_px`` and ``motion``, ready for JSON."""
        return {
            "kind": self.kind,
            "description": self.description,
            "probability": _rounded(self.probability, 4),
            "expected_error_px": _rounded(self.expected_error_px, 2),
            "motion": json.loads(self.motion.to_json()),
        }

    def resized(self, height: int, width: int) -> Candidate:
        """Returns the candidate for another size of the photo's readout frame.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent.
        """
        error = self.expected_error_px
        scaled = None if error is None else error * height / self.motion.height
        return replace(self, motion=self.motion.resized(height, width), expected_error_px=scaled)

    @property
    def direction(self) -> Direction:
        """Direction in which the camera turned, as seen in the upright photo; the scene moves the opposite way."""
        up = np.array(scene_up(self.orientation, self.motion.readout))
        right = np.array([-up[1], up[0]])
        scene = np.array([self.motion.tx_px[-1] - self.motion.tx_px[0], 0.0])
        sideways, upwards = float(scene @ right), float(scene @ up)
        if abs(sideways) >= abs(upwards):
            return "left" if sideways > 0 else "right"
        return "down" if upwards > 0 else "up"


def alone(motion: Motion, orientation: int = _UPRIGHT) -> tuple[Candidate, ...]:
    """Returns the candidates of a method that finds a single motion: that motion, then the unchanged photo."""
    if motion.is_zero:
        return (Candidate("still", motion, motion.confidence, orientation=orientation),)
    as_it_is = replace(motion.scaled(0), confidence=None)
    return (
        Candidate("other", motion, motion.confidence, orientation=orientation),
        Candidate("still", as_it_is, orientation=orientation),
    )


def candidates_to_json(candidates: Iterable[Candidate]) -> str:
    """Returns the candidates of a photo as JSON text, numbered as users select them."""
    listed = [{"number": number, **each.as_json()} for number, each in enumerate(candidates, 1)]
    return json.dumps({"format": "unshutter-candidates/1", "candidates": listed})


def _rounded(number: float | None, digits: int) -> float | None:
    return None if number is None else round(number, digits)
