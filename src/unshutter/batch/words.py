"""Words of the command line for verdicts: what became of a photo, and which option would change that."""

from __future__ import annotations

import math

from unshutter.motion.verdict import Verdict, pixels
from unshutter.reasons import Code


def about(verdict: Verdict) -> str:
    """The verdict, and what to do about it where something can be done."""
    return "; ".join(filter(None, (verdict.described(), advice(verdict))))


def advice(verdict: Verdict) -> str:
    """The option that would have the photo moved; empty where there is none."""
    if verdict.reason is None or verdict.confidence is None:
        return ""
    if verdict.reason.code is Code.UNSURE:
        limit = _one_digit(verdict.confidence)
        return f"--min-confidence {limit:g} would move it by up to {pixels(verdict.largest_px)}"
    return "--moving says that it did" if verdict.reason.code is Code.UNSURE_WHETHER_MOVED else ""


def _one_digit(confidence: float) -> float:
    """Rounded down to one digit that counts: 0.36 -> 0.3, 0.036 -> 0.03, 0.0036 -> 0."""
    steps = 10 if confidence >= 0.1 else 100
    return math.floor(steps * confidence) / steps
