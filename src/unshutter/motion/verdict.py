"""Whether a photo's motion is undone, or the photo left as it is, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from unshutter.motion.motion import Motion
from unshutter.options import Undo

_SMALLEST = 256  # motions that were found and move nothing by a row in so many are no larger than their errors
_PROBABLY = 0.5  # confidence that nothing moved
LEAST_PX = 0.5  # below, a photo loses more by being resampled than it gains

# Why a photo is left as it is, as it is counted.
Cause = Literal["", "no motion", "nothing to go by", "not sure", "less than half a pixel", "strength 0"]


@dataclass(frozen=True)
class Verdict:
    """Whether a motion is undone.

    Attributes:
        largest_px: the farthest that anything would be moved [px].
        confidence: the motion's.
        cause: why the photo is left as it is, in a few fixed words; empty where the motion is undone.
        reason: the same in a sentence, with its figures.
        hint: what a user can say to have it moved, where something can be said.
    """

    largest_px: float
    confidence: float | None = None
    cause: Cause = ""
    reason: str = ""
    hint: str = ""

    @classmethod
    def of(cls, motion: Motion, how: Undo) -> Verdict:
        """Whether a motion is undone.

        Args:
            motion: as it would be undone: for the photo's size, with its strength and reference row.
            how: what is asked for; of it, the least confidence counts here.
        """
        largest, sure = motion.largest_px, motion.confidence
        if motion.is_zero and motion.reason:
            return cls(largest, sure, "nothing to go by", motion.reason)
        if how.strength == 0:
            return cls(largest, sure, "strength 0", "a strength of 0 undoes nothing")
        if motion.is_zero:
            return cls(largest, sure, "no motion", f"no motion{_at(sure)}")
        if sure is not None and how.min_confidence > 0:
            if largest < max(LEAST_PX, motion.height / _SMALLEST):
                return cls._of_next_to_nothing(largest, sure)
            if sure < how.min_confidence:
                hint = f"--min-confidence {_one_digit(sure):g} would move it by up to {_pixels(largest)}"
                return cls(largest, sure, "not sure", f"not sure: confidence {_two_decimals(sure)}", hint)
        if largest < LEAST_PX:
            return cls(largest, sure, "less than half a pixel", f"it would move by less than half a pixel{_at(sure)}")
        return cls(largest, sure)

    @classmethod
    def _of_next_to_nothing(cls, largest: float, sure: float) -> Verdict:
        """Of a motion that was found, no larger than what one photo can tell."""
        if sure >= _PROBABLY:
            return cls(largest, sure, "no motion", f"no visible motion{_at(sure)}")
        reason = f"not sure whether the camera moved: confidence {_two_decimals(sure)}"
        return cls(largest, sure, "not sure", reason, "--moving says that it did")

    @property
    def changes(self) -> bool:
        """Whether the motion is undone."""
        return not self.cause

    def left_alone(self, motion: Motion) -> Motion:
        """What is undone of a motion where the verdict is to leave the photo as it is: nothing, for this reason."""
        return replace(motion.scaled(0), reason=self.reason)

    def told(self) -> str:
        """What a user of the command line should know: ``up to 41 px, confidence 0.93``."""
        if self.changes:
            return f"up to {_pixels(self.largest_px)}" + _at(self.confidence)
        return "; ".join(filter(None, (self.reason, self.hint)))

    def as_json(self) -> dict[str, Any]:
        """The same for programs, as logs and manifests have it."""
        told = {"changed": self.changes, "largest_px": round(self.largest_px, 2), "confidence": self.confidence}
        return told if self.changes else {**told, "cause": self.cause, "reason": self.reason}


def _at(confidence: float | None) -> str:
    return "" if confidence is None else f", confidence {_two_decimals(confidence)}"


def _two_decimals(confidence: float) -> str:
    """Rounded down: what is below a limit must not read as if it met it."""
    return f"{math.floor(100 * confidence + 1e-9) / 100:.2f}"


def _one_digit(confidence: float) -> float:
    """Rounded down to one digit that counts: 0.36 -> 0.3, 0.036 -> 0.03, 0.0036 -> 0."""
    steps = 10 if confidence >= 0.1 else 100
    return math.floor(steps * confidence) / steps


def _pixels(px: float) -> str:
    return f"{px:.0f} px" if px >= 10 else f"{px:.1f} px"
