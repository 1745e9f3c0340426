"""The verdict on a motion: how fast it was, whether to undo it, and how certain that is."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.finding import Finding
from unshutter.motion.motion import Motion
from unshutter.motion.shapes import Float64
from unshutter.motion.upright import Angle, Pose
from unshutter.options import MIN_CONFIDENCE, Undo, Upright, check_time
from unshutter.options.clip_options import ClipUndo
from unshutter.reasons import (
    Cause,
    Code,
    JsonObject,
    MotionSource,
    Reason,
    as_stated,
    known_values,
    pixels,
    rounded,
)


@dataclass(frozen=True, eq=False)
class Speed:
    """Speed of the scene in the picture at the time of each row; readout frame, signs as in Motion."""

    readout_ms: float  # time from the first to the last row [ms]
    # [H] angular rate about the viewing axis, positive clockwise as seen in the picture [deg/s]
    angular_deg_s: Float64[np.ndarray, "rows"]
    velocity_px_s: Float64[np.ndarray, "rows 2"]  # [H, 2], (col, row) of the scene in the middle of the picture [px/s]

    @classmethod
    def of(cls, motion: Motion, readout_ms: float) -> Speed:
        """Returns the speed of a motion; independent of its reference row."""
        check_time("readout-ms", readout_ms, "ms")
        if motion.height < 2:
            raise UnshutterError("a speed needs a motion of at least two rows")
        turning, velocity = motion.rates()
        per_second = 1000 * (motion.height - 1) / readout_ms  # rows
        return cls(readout_ms, np.degrees(turning) * per_second, velocity * per_second)

    def described(self) -> str:
        """The peaks in words: ``turned by up to 12 deg/s, moved by up to 1400 px/s``."""
        peaks = self.summary()
        deg_s = abs(peaks["angular_deg_s"]["peak"])
        return f"turned by up to {deg_s:.0f} deg/s, moved by up to {peaks['velocity_px_s']['peak']:.0f} px/s"

    def summary(self) -> dict:
        """Returns mean and peak, ready for JSON; all signed except the peak velocity, which is a magnitude."""
        peak = self.angular_deg_s[np.abs(self.angular_deg_s).argmax()]
        return {
            "readout_ms": self.readout_ms,
            "angular_deg_s": {"mean": float(self.angular_deg_s.mean()), "peak": float(peak)},
            "velocity_px_s": {
                "mean": self.velocity_px_s.mean(axis=0).tolist(),
                "peak": float(np.hypot(*self.velocity_px_s.T).max()),
            },
        }


def json_with_speed(finding: Finding, readout_ms: float) -> str:
    """Returns the finding as JSON text with an added ``speed`` key; :meth:`Finding.from_json` accepts it.

    Examples:
        >>> motion = unshutter.RowMotion.from_polynomials([0, 60], [0], height=480, width=640)
        >>> data = json.loads(json_with_speed(unshutter.Finding(motion), readout_ms=30))
        >>> round(data["speed"]["velocity_px_s"]["peak"])
        2000
    """
    return json.dumps(json.loads(finding.to_json()) | {"speed": Speed.of(finding.motion, readout_ms).summary()})


LIKELY = 0.8  # least confidence of a verdict that is likely
PROBABLE = 0.5  # probability that a motion helps, above which a photo that is left alone counts as unsure
_SMALLEST = 256  # estimated motions below 1 / this of the rows are within their error
LEAST_PX = 0.5  # below this, resampling costs more sharpness than the correction gains
_MOVED = {Code.WHICH_WAY, Code.UNSURE_HOW_MOVED, Code.MOVED_TOO_LITTLE, Code.MOVED_OTHERWISE}  # or is said to have

_CAUSES = {
    Code.NO_MOTION: Cause.NO_MOTION,
    Code.NO_VISIBLE_MOTION: Cause.NO_MOTION,
    Code.NOTHING_MOVED: Cause.NO_MOTION,
    Code.NO_ROLLING_SHUTTER: Cause.NO_ROLLING_SHUTTER,
    Code.PANORAMA: Cause.NO_ROLLING_SHUTTER,
    Code.EMBEDDED_VIDEO_STOOD_STILL: Cause.NO_MOTION,
    Code.UNSURE: Cause.UNSURE,
    Code.HARDLY_HELPS: Cause.UNSURE,
    Code.UNSURE_HOW_MOVED: Cause.UNSURE,
    Code.MOVED_TOO_LITTLE: Cause.UNSURE,
    Code.MOVED_OTHERWISE: Cause.UNSURE,
    Code.UNSURE_WHETHER_MOVED: Cause.UNSURE,
    Code.WHICH_WAY: Cause.UNSURE,
    Code.WIDE_LENS: Cause.UNSURE,
    Code.TOO_SMALL: Cause.TOO_SMALL,
    Code.STRENGTH_0: Cause.STRENGTH_0,
}


def probability_better(size: float, error: float) -> float:
    """Probability that undoing a motion brings a photo closer to the truth: that its error is less than its size.

    Args:
        size, error: mean displacement, and the standard deviation of its error, in the same unit.
    """
    return math.erf(size / (math.sqrt(2) * max(error, 1e-9)))


class Certainty(StrEnum):
    """The confidence in a motion as a word, the same one everywhere.

    By default, nothing doubtful is undone. Of photos that are left, no such word is said: a reason says why.
    """

    SURE = "sure"
    LIKELY = "likely"
    TENTATIVE = "tentative"
    DOUBTFUL = "doubtful"

    @classmethod
    def of(cls, confidence: float) -> Certainty:
        """Returns the word for a confidence."""
        return next(word for least, word in CERTAINTIES if confidence >= least)

    @property
    def is_doubted(self) -> bool:
        """Whether someone should compare a result of this certainty with the photo."""
        return self in (Certainty.TENTATIVE, Certainty.DOUBTFUL)


# least confidence of each word: calibrated probabilities
CERTAINTIES = (
    (0.95, Certainty.SURE),
    (LIKELY, Certainty.LIKELY),
    (MIN_CONFIDENCE, Certainty.TENTATIVE),
    (0.0, Certainty.DOUBTFUL),
)


@dataclass(frozen=True)
class Verdict:
    """Whether a motion is undone, and why if it is not; and whether the photo is turned upright."""

    finding: Finding  # what was found, its motion as it would be undone: at the reference row and the strength
    largest_px: float  # largest displacement that undoing the motion would cause [px]
    reason: Reason | None = None  # why the photo is left unchanged; None if the motion is undone
    strength: float = 1.0  # share of the motion that is undone
    upright: Pose | None = None  # the pose of the camera that is undone; None: the photo is not turned
    not_upright: Reason | None = None  # why the photo is not turned although that was asked for

    @property
    def carried_out(self) -> Finding:
        """The finding with the motion that is undone; zero, with the reason, if it is not."""
        if self.undoes:
            return self.finding
        return replace(self.finding, motion=self.finding.motion.scaled(0), reason=self.reason)

    @property
    def motion(self) -> Motion:
        """The motion that is undone; zero if it is not."""
        return self.carried_out.motion

    @property
    def confidence(self) -> float | None:
        """Stated probability that the result is better than the photo; None if unknown.

        Of a photo whose motion is not undone, for the reason that nothing moved, that nothing else is better.
        """
        sure = self.finding.confidence
        return None if sure is None else as_stated(sure)

    @property
    def error_px(self) -> float | None:
        """Mean displacement that is expected to remain if undoing the motion helps [px].

        None if unknown, or if the strength leaves more of it on purpose.
        """
        if self.finding.expected_error is None or self.strength != 1:
            return None
        return self.finding.expected_error * self.finding.motion.height

    @property
    def left_px(self) -> float:
        """Largest displacement that the strength leaves on purpose [px]; negative if more than the motion is undone."""
        return self.largest_px * (1 / self.strength - 1) if self.strength > 0 else 0.0

    @property
    def lean(self) -> Angle | None:
        """Angle by which levelling would turn a photo that is left unchanged, with its error; None: not offered.

        It is offered where the photo shows its camera's roll well enough, unless the camera moved or was asked about.
        """
        found = self.finding
        pose = found.held_at_rest
        asked = self.upright is not None or self.not_upright is not None or (found.roll and found.roll.stated)
        if self.reason is None or self.reason.code in _MOVED or asked or pose is None or pose.roll_error_deg is None:
            return None
        levelling = pose.undone_for("level", found.roll, found.tilt)
        # offered to 112 views, this got 102 of them nearer to level
        if isinstance(levelling, Reason) or abs(levelling.roll_deg) < 2.5 * pose.roll_error_deg:
            return None
        deg = round(abs(levelling.roll_deg), 1)
        return Angle(deg, error_deg=round(pose.roll_error_deg, 1)) if deg >= 1.0 else None  # visible

    @property
    def undoes(self) -> bool:
        """Whether the motion is undone."""
        return self.reason is None

    @property
    def changes(self) -> bool:
        """Whether the photo is changed: its motion is undone, or it is turned upright."""
        return self.undoes or self.upright is not None

    @property
    def certainty(self) -> Certainty | None:
        """The confidence in the motion that is undone, as a word; None if none is, or its confidence is unknown."""
        return None if self.confidence is None or not self.undoes else Certainty.of(self.confidence)

    @property
    def needs_a_look(self) -> bool:
        """Whether someone should compare both pictures, because a large motion was undone that is not "likely"."""
        doubted = self.certainty is not None and self.certainty.is_doubted
        return doubted and self.largest_px > self.finding.motion.height / 12

    @property
    def least_confidence(self) -> float | None:
        """The least confidence to ask for so that a motion left as unsure would be undone; None for any other."""
        if self.reason is None or _CAUSES.get(self.reason.code) is not Cause.UNSURE or self.reason.px < LEAST_PX:
            return None
        if self.confidence is None or not is_measurable(self.reason.px, self.finding.motion.height):
            return 0.0  # undoes the likeliest motion, whatever is known of it
        return math.floor(10 * self.confidence) / 10

    @property
    def cause(self) -> Cause | None:
        """Why the photo is left unchanged, as counted in summaries; None if it is changed."""
        return None if self.changes or self.reason is None else _CAUSES.get(self.reason.code, Cause.NO_EVIDENCE)

    @property
    def sentence(self) -> str:
        """Why the motion is not undone, e.g. ``only 3 straight segments found``; empty if it is."""
        return "" if self.reason is None else str(self.reason)

    def described(self) -> str:
        """One line: ``points moved by up to 41 px, confidence 0.93: likely, typically off by 2.0 px``, or why not."""
        look = ", please look" if self.needs_a_look else ""
        done = f"points moved {self._how_far}{self._at_confidence}{self._remaining}{look}"
        words = done if self.undoes else self.sentence
        words = f"{words} (by the video inside it)" if self.finding.source is MotionSource.EMBEDDED_VIDEO else words
        upright = self.not_upright if self.upright is None else self.upright.described()
        return f"{upright}; {words}" if upright else words

    def as_json(self) -> JsonObject:
        """Returns the verdict as a JSON-ready dictionary for logs, manifests and the page's API."""
        data = {"changed": self.changes, "largest_px": round(self.largest_px, 2), "confidence": self.confidence}
        data |= {"certainty": self.certainty, "please_look": self.needs_a_look}
        pose = self.upright
        about = self.reason.as_json() if self.reason is not None else {}
        video = self.finding.video_unused
        source = self.finding.source
        optional = {
            "expected_error_px": rounded(self.error_px, 2) if self.undoes else None,
            "left_px": round(self.left_px, 2) if self.undoes and self.left_px else None,
            "source": source if source is MotionSource.EMBEDDED_VIDEO else None,
            "film": video and video.as_json(),
            "upright": pose and {"roll_deg": round(pose.roll_deg, 1), "tilt_deg": pose.tilt_deg},
            "not_upright": self.not_upright and self.not_upright.as_json(),
            "lean_deg": self.lean and self.lean.deg,
            "lean_error_deg": self.lean and self.lean.error_deg,
        }
        data |= known_values(optional)
        if self.undoes:
            return data
        return data | {"cause": self.cause, "reason": self.sentence, "code": about["code"], "figures": about["figures"]}

    @property
    def _how_far(self) -> str:
        error = self.error_px
        if error is not None and error >= self.largest_px:
            return f"by no more than the typical error of {pixels(error)}"
        return f"by up to {pixels(self.largest_px)}"

    @property
    def _at_confidence(self) -> str:
        if self.confidence is None:
            return ""
        return f", confidence {self.confidence:.2f}: {self.certainty}"

    @property
    def _remaining(self) -> str:
        if self.left_px > 0:
            return f", up to {pixels(self.left_px)} left on purpose"
        if self.left_px < 0:
            return f", up to {pixels(-self.left_px)} more than was found, on purpose"
        if self.error_px is None or self.error_px >= self.largest_px:
            return ""
        return f", typically off by {pixels(self.error_px)}"


def is_measurable(largest_px: float, rows: int) -> bool:
    """Whether an estimated motion with this largest displacement [px] is larger than its usual error."""
    return largest_px >= max(LEAST_PX, rows / _SMALLEST)


def reason_to_leave(better: float, motion: Motion, moved: bool = False) -> Reason:
    """Returns why a photo is left unchanged whose best motion is not worth the risk of undoing it.

    Args:
        better: probability that undoing it brings the photo closer to the truth.
        moved: whether the user says that the camera moved.
    """
    if moved and (better > LIKELY or not is_measurable(motion.largest_px, motion.height)):
        return Reason.of(Code.MOVED_TOO_LITTLE, px=motion.largest_px)
    if moved:
        return Reason.of(Code.UNSURE_HOW_MOVED, confidence=better, px=motion.largest_px)
    if better > LIKELY:
        return Reason.of(Code.HARDLY_HELPS, px=motion.largest_px)
    if better > PROBABLE:
        return Reason.of(Code.UNSURE, confidence=better, px=motion.largest_px)
    if better > 0.2:
        return Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=1 - better)
    return Reason(Code.NO_VISIBLE_MOTION)


def judge(finding: Finding, undo: Undo) -> Verdict:
    """Decides whether to undo a motion, which has the photo's size, and whether to turn the photo upright."""
    finding = finding.rereferenced(undo.reference or finding.motion.reference)
    finding = replace(finding, motion=finding.motion.scaled(undo.strength))
    undone = Verdict(finding, finding.motion.largest_px, strength=undo.strength)
    judged = replace(undone, reason=_reason_against(undone, undo))
    return judged if undo.upright is None else _turn_upright(judged, undo.upright)


def _reason_against(verdict: Verdict, undo: Undo) -> Reason | None:
    """Returns why a motion should not be undone, or None if it should."""
    motion = verdict.finding.motion
    largest = verdict.largest_px
    sure = verdict.confidence
    if motion.is_zero and verdict.finding.reason is not None:
        return verdict.finding.reason
    if undo.strength == 0:
        return Reason(Code.STRENGTH_0)
    if motion.is_zero:
        return Reason(Code.NO_MOTION)
    if sure is not None and undo.min_confidence != 0:
        if not is_measurable(largest, motion.height):
            return Reason(Code.NO_VISIBLE_MOTION)
        if sure < (MIN_CONFIDENCE if undo.min_confidence is None else undo.min_confidence):
            return Reason.of(Code.UNSURE, confidence=sure, px=largest)
    return Reason(Code.TOO_SMALL) if largest < LEAST_PX else None


def _turn_upright(verdict: Verdict, wish: Upright) -> Verdict:
    """Returns the verdict with the pose to undo, or why it is left."""
    found = verdict.finding
    pose = found.held if verdict.undoes else found.held_at_rest
    if wish == "level" and pose is not None and not verdict.undoes and found.roll is None:
        pose = pose if pose.roll_error_deg is not None else None  # another roll fits as well
    upright = Reason(Code.POSE_UNKNOWN) if pose is None else pose.undone_for(wish, found.roll, found.tilt)
    if isinstance(upright, Reason):
        return replace(verdict, not_upright=upright)
    if upright.largest_px(found.motion.height, found.motion.width) < LEAST_PX:  # it is upright already
        return verdict
    return replace(verdict, upright=upright)


def undone_part(motion: Motion, undo: ClipUndo) -> Motion:
    """Returns the part of a frame's motion that is undone, at the reference row."""
    return motion.rereferenced(undo.reference).scaled(undo.strength)
