"""Finding: what is found about a photo's motion, and the candidates that a person can choose from."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.motion import Motion
from unshutter.options import Camera, Reference
from unshutter.orientation import scene_up
from unshutter.reasons import MOST_STATED, as_stated, pixels

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
        probability: that undoing this motion brings the photo closer to the truth, 0 to 1, the same as the motion's
            confidence, so those of several motions need not add up to 1; for the unchanged photo, that the likeliest of
            the others does not. None if the method does not report one.
        expected_error_px: mean displacement that remains if it does [px]; None if the method does not report one.
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
        return self.name if self.kind == "still" else f"{self.name}, {pixels(self.motion.largest_px)}"

    @property
    def name(self) -> str:
        """The kind of motion in words, e.g. ``pan to the left`` or ``hand``."""
        if self.kind == "still":
            return "as it is"
        return f"pan {_TURNS[self.direction]}" if self.kind == "pan" else _NAMES[self.kind]

    def described(self) -> str:
        """Description with the known figures: ``hand, 9.0 px (chance 0.62 that it helps, typically off by 3.1 px)``."""
        known = []
        helps = "the likeliest other does not help" if self.kind == "still" else "it helps"
        if self.probability is not None:
            known.append(f"chance {as_stated(self.probability):.2f} that {helps}")
        if self.expected_error_px is not None:
            known.append(f"typically off by {pixels(self.expected_error_px)}")
        return f"{self.description} ({', '.join(known)})" if known else self.description

    def as_stated(self, most: float = MOST_STATED) -> Candidate:
        """Returns the candidate with its probability, wherever it says it, as :func:`~unshutter.reasons.as_stated`."""
        sure = self.motion.confidence
        reason = self.motion.reason
        motion = replace(
            self.motion,
            confidence=None if sure is None else as_stated(sure, most),
            reason=None if reason is None else reason.as_stated(most),
        )
        least = 1 - MOST_STATED if self.kind == "still" else 0.0  # that nothing helps is never ruled out
        chance = None if self.probability is None else max(as_stated(self.probability, most), round(least, 2))
        return replace(self, motion=motion, probability=chance)

    def as_json(self) -> dict[str, Any]:
        """Returns ``kind``, ``description``, ``probability``, ``expected_error_px`` and ``motion``, ready for JSON."""
        return {
            "kind": self.kind,
            "description": self.description,
            "probability": _rounded(self.probability, 4),
            "expected_error_px": _rounded(self.expected_error_px, 2),
            "motion": json.loads(self.motion.to_json()),
        }

    def rereferenced(self, reference: Reference) -> Candidate:
        """Returns the candidate with its motion relative to another reference row."""
        return replace(self, motion=self.motion.rereferenced(reference))

    def resized(self, height: int, width: int) -> Candidate:
        """Returns the candidate for another size of the photo's readout frame."""
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


def list_single(motion: Motion, orientation: int = _UPRIGHT) -> tuple[Candidate, ...]:
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


@dataclass(frozen=True)
class Finding:
    """What is found about a photo's motion, or given.

    Attributes:
        motion: the motion that fits best, or was chosen; zero, with a reason, if the photo does not show enough.
        candidates: all motions that fit, the best one first; empty if the motion was given.
    """

    motion: Motion
    candidates: tuple[Candidate, ...] = ()

    def choose(self, number: int | None) -> Finding:
        """Returns the finding with the motion of a candidate, counted from 1; None: as it is, with its confidence.

        A motion that a person has chosen has no confidence, as no doubt remains.

        Raises:
            UnshutterError: there is no such candidate.
        """
        if number is None:
            return self
        if number > len(self.candidates):
            listed = ", ".join(each.description for each in self.candidates)
            raise UnshutterError(f"there is no candidate {number}: the photo has {len(self.candidates)} ({listed})")
        taken = self.candidates[number - 1]
        strength = 0 if taken.kind == "still" else 1  # "as it is" leaves no trace of motion, either
        return replace(self, motion=replace(taken.motion.scaled(strength), confidence=None))

    def fit(self, height: int, width: int, readout: str = "auto") -> Finding:
        """Returns the finding for a stored picture of height x width [px]; the aspect ratio must fit.

        Raises:
            UsageError: another readout direction is asked for; UnshutterError: the aspect ratio differs.
        """
        if readout != "auto" and Camera(readout).direction != self.motion.readout:
            raise UsageError(f"the motion was made for readout {self.motion.readout}, not {readout}")
        size = self.motion.readout.frame_size(height, width)
        return replace(self, motion=self.motion.resized(*size))
