"""Verdict: whether a photo's motion is undone, and if not, why the photo is left unchanged."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from unshutter.motion.motion import Motion
from unshutter.options import Undo
from unshutter.reasons import SOURCES, Cause, Code, MotionSource, Reason, pixels

SURE, LIKELY = 0.8, 0.5  # least confidence of a verdict that is sure, or likely: calibrated probabilities
_LARGE = 1 / 12  # of the rows: an unsure motion with a larger displacement deserves a look
_SMALLEST = 256  # estimated motions below 1 / this of the rows are within their error
_PROBABLY = 0.5  # least confidence that nothing moved
LEAST_PX = 0.5  # below this, resampling costs more sharpness than the correction gains

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
_WITH_CONFIDENCE = {Code.NO_MOTION, Code.NO_VISIBLE_MOTION, Code.TOO_SMALL}  # their sentences do not state it


def least_visible_px(rows: int) -> float:
    """The smallest motion [px] that one photo of so many rows can show."""
    return max(LEAST_PX, rows / _SMALLEST)


class Certainty(StrEnum):
    """A confidence as a word."""

    SURE = "sure"
    LIKELY = "likely"
    UNSURE = "unsure"

    @classmethod
    def of(cls, confidence: float) -> Certainty:
        """Returns the word for a confidence."""
        return cls.SURE if confidence >= SURE else cls.LIKELY if confidence >= LIKELY else cls.UNSURE


@dataclass(frozen=True)
class Verdict:
    """Whether a motion is undone, and why if it is not.

    Attributes:
        largest_px: largest displacement that undoing the motion would cause [px].
        confidence: confidence of the motion.
        reason: why the photo is left unchanged; None if the motion is undone.
        source: source of the motion; None if it was estimated from the photo's pixels or supplied by the user.
        rows: number of rows of the picture; 0 if unknown.
        film: why the film inside the photo was not used; None if it was used or the photo has none.
    """

    largest_px: float
    confidence: float | None = None
    reason: Reason | None = None
    source: MotionSource | None = None
    rows: int = 0
    film: Reason | None = None

    @classmethod
    def of(cls, motion: Motion, undo: Undo) -> Verdict:
        """Decides whether to undo a motion.

        Args:
            motion: the motion to undo, for the photo's size, with its strength and reference row.
            undo: the user's options; only strength and minimum confidence matter here.
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
        """The confidence as a word; None if there is no confidence."""
        return None if self.confidence is None else Certainty.of(self.confidence)

    @property
    def needs_a_look(self) -> bool:
        """Whether a large but unsure motion is undone, so that someone should compare both pictures."""
        return self.changes and self.certainty is Certainty.UNSURE and self.largest_px > _LARGE * self.rows > 0

    @property
    def cause(self) -> Cause | None:
        """Why the photo is left unchanged, as counted in summaries; None if the motion is undone."""
        return None if self.reason is None else _CAUSES.get(self.reason.code, Cause.NO_EVIDENCE)

    @property
    def sentence(self) -> str:
        """Why the photo is left unchanged, e.g. ``not sure: confidence 0.01``; empty if the motion is undone."""
        if self.reason is None:
            return ""
        return str(self.reason) + (self._at_confidence if self.reason.code in _WITH_CONFIDENCE else "")

    @property
    def film_sentence(self) -> str:
        """Why the film inside the photo was not used; empty if it was used or the photo has none."""
        return "" if self.film is None else f"{self.film}: not used"

    def left_alone(self, motion: Motion) -> Motion:
        """Returns a zero motion with this verdict's reason, for a photo that is left unchanged."""
        return replace(motion.scaled(0), reason=self.reason)

    def described(self) -> str:
        """One-line summary, e.g. ``up to 41 px, confidence 0.93: sure``, or why the photo is left unchanged."""
        look = ", please look" if self.needs_a_look else ""
        words = f"up to {pixels(self.largest_px)}{self._at_confidence}{look}" if self.changes else self.sentence
        return words if self.source is None else f"{words} ({SOURCES[self.source]})"

    def as_json(self) -> dict[str, Any]:
        """Returns the verdict as a JSON-ready dictionary for logs, manifests and the page's API."""
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
    """Returns why a motion should not be undone, or None if it should."""
    if motion.is_zero and motion.reason is not None:
        return motion.reason
    if undo.strength == 0:
        return Reason(Code.STRENGTH_0)
    if motion.is_zero:
        return Reason(Code.NO_MOTION)
    if sure is not None and undo.min_confidence > 0:
        if largest < least_visible_px(motion.height):
            if sure >= _PROBABLY:
                return Reason(Code.NO_VISIBLE_MOTION)
            return Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=_two_decimals(sure))
        if sure < undo.min_confidence:
            return Reason.of(Code.UNSURE, confidence=_two_decimals(sure))
    return Reason(Code.TOO_SMALL) if largest < LEAST_PX else None


def _two_decimals(confidence: float) -> float:
    """Rounds down, so that a value below a limit never appears to reach it."""
    return math.floor(100 * confidence + 1e-9) / 100
