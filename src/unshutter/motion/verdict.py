"""Verdict: whether a photo's motion is undone or the photo left unchanged, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from unshutter.motion.motion import Motion
from unshutter.options import Undo
from unshutter.reasons import SOURCES, Cause, Code, MotionSource, Reason, pixels

SURE, LIKELY = 0.8, 0.5  # confidence from which on a verdict is sure, or likely: calibrated probabilities
_LARGE = 1 / 12  # of the rows: an unsure motion that moves anything farther is worth a look
_SMALLEST = 256  # motions that were found and move nothing by a row in so many are no larger than their errors
_PROBABLY = 0.5  # confidence that nothing moved
LEAST_PX = 0.5  # below, a photo loses more by being resampled than it gains

_CAUSES = {
    Code.NO_MOTION: Cause.NO_MOTION,
    Code.NO_VISIBLE_MOTION: Cause.NO_MOTION,
    Code.NOTHING_MOVED: Cause.NO_MOTION,
    Code.NO_ROLLING_SHUTTER: Cause.NO_ROLLING_SHUTTER,
    Code.HOVERED: Cause.NO_MOTION,
    Code.FILM_STOOD_STILL: Cause.NO_MOTION,
    Code.UNSURE: Cause.UNSURE,
    Code.UNSURE_WHETHER_MOVED: Cause.UNSURE,
    Code.TOO_SMALL: Cause.TOO_SMALL,
    Code.STRENGTH_0: Cause.STRENGTH_0,
}
_WITH_CONFIDENCE = {Code.NO_MOTION, Code.NO_VISIBLE_MOTION, Code.TOO_SMALL}  # whose sentence does not state it


class Certainty(StrEnum):
    """A confidence in a word."""

    SURE = "sure"
    LIKELY = "likely"
    UNSURE = "unsure"

    @classmethod
    def of(cls, confidence: float) -> Certainty:
        """The word for a confidence."""
        return cls.SURE if confidence >= SURE else cls.LIKELY if confidence >= LIKELY else cls.UNSURE


@dataclass(frozen=True)
class Verdict:
    """Whether a motion is undone.

    Attributes:
        largest_px: the farthest that anything would be moved [px].
        confidence: the motion's.
        reason: why the photo is left unchanged; None where the motion is undone.
        source: where the motion comes from; None: the photo's pixels, or whoever gave it.
        rows: of the picture; 0 where it is not known.
        film: why the film inside the photo was not used; None where it was, or there is none.
    """

    largest_px: float
    confidence: float | None = None
    reason: Reason | None = None
    source: MotionSource | None = None
    rows: int = 0
    film: Reason | None = None

    @classmethod
    def of(cls, motion: Motion, undo: Undo) -> Verdict:
        """Whether a motion is undone.

        Args:
            motion: as it would be undone: for the photo's size, with its strength and reference row.
            undo: what is asked for; of it, the strength and the least confidence count here.
        """
        largest, sure = motion.largest_px, motion.confidence
        source = MotionSource(motion.estimator) if motion.estimator in set(MotionSource) else None
        return cls(largest, sure, _reason_against(motion, largest, sure, undo), source, motion.height, motion.film)

    @property
    def changes(self) -> bool:
        """Whether the motion is undone."""
        return self.reason is None

    @property
    def certainty(self) -> Certainty | None:
        """The confidence in a word; None where there is none."""
        return None if self.confidence is None else Certainty.of(self.confidence)

    @property
    def needs_a_look(self) -> bool:
        """Whether a large motion is undone that is unsure, so that a person should compare both pictures."""
        return self.changes and self.certainty is Certainty.UNSURE and self.largest_px > _LARGE * self.rows > 0

    @property
    def cause(self) -> Cause | None:
        """Why the photo is left unchanged, as it is counted; None where the motion is undone."""
        return None if self.reason is None else _CAUSES.get(self.reason.code, Cause.NO_EVIDENCE)

    @property
    def sentence(self) -> str:
        """Why the photo is left unchanged, ``not sure: confidence 0.01``; empty where the motion is undone."""
        if self.reason is None:
            return ""
        return str(self.reason) + (self._at_confidence if self.reason.code in _WITH_CONFIDENCE else "")

    @property
    def film_sentence(self) -> str:
        """Why the film inside the photo was not used; empty where it was, or there is none."""
        return "" if self.film is None else f"{self.film}: not used"

    def left_alone(self, motion: Motion) -> Motion:
        """What is undone of a motion where the verdict is to leave the photo unchanged: nothing, for this reason."""
        return replace(motion.scaled(0), reason=self.reason)

    def described(self) -> str:
        """``up to 41 px, confidence 0.93: sure``, or why the photo is left unchanged; where the motion comes from."""
        look = ", please look" if self.needs_a_look else ""
        words = f"up to {pixels(self.largest_px)}{self._at_confidence}{look}" if self.changes else self.sentence
        return words if self.source is None else f"{words} ({SOURCES[self.source]})"

    def as_json(self) -> dict[str, Any]:
        """The verdict for programs, as logs, manifests and the page's API have it."""
        data = {"changed": self.changes, "largest_px": round(self.largest_px, 2), "confidence": self.confidence}
        data |= {"certainty": self.certainty, "please_look": self.needs_a_look}
        if self.source is not None:
            data["source"] = self.source
        if self.film is not None:
            data["film"] = self.film.as_json()
        if self.reason is None:
            return data
        about = self.reason.as_json()
        return {
            **data,
            "cause": self.cause,
            "reason": self.sentence,
            "code": about["code"],
            "figures": about["figures"],
        }

    @property
    def _at_confidence(self) -> str:
        if self.confidence is None:
            return ""
        return f", confidence {_two_decimals(self.confidence):.2f}: {self.certainty}"


def _reason_against(motion: Motion, largest: float, sure: float | None, undo: Undo) -> Reason | None:
    """Why a motion is not undone; None where it is."""
    if motion.is_zero and motion.reason is not None:
        return motion.reason
    if undo.strength == 0:
        return Reason(Code.STRENGTH_0)
    if motion.is_zero:
        return Reason(Code.NO_MOTION)
    if sure is not None and undo.min_confidence > 0:
        if largest < max(LEAST_PX, motion.height / _SMALLEST):  # no larger than what one photo can show
            if sure >= _PROBABLY:
                return Reason(Code.NO_VISIBLE_MOTION)
            return Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=_two_decimals(sure))
        if sure < undo.min_confidence:
            return Reason.of(Code.UNSURE, confidence=_two_decimals(sure))
    return Reason(Code.TOO_SMALL) if largest < LEAST_PX else None


def _two_decimals(confidence: float) -> float:
    """Rounded down: what is below a limit must not read as if it met it."""
    return math.floor(100 * confidence + 1e-9) / 100
