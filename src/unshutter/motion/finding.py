"""Finding: a photo's motion with its source and certainty, its motion file, and the candidates to choose from."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable
from dataclasses import KW_ONLY, asdict, dataclass, replace
from typing import Literal

import numpy as np

from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.motion import motion_file
from unshutter.motion.motion import Motion, interpolated, matching_rows, row_index
from unshutter.motion.motion_file import number_of
from unshutter.motion.upright import Angle, Pose
from unshutter.options import Camera, Reference
from unshutter.orientation import scene_up
from unshutter.reasons import MOST_STATED, JsonObject, MotionSource, Reason, as_stated, known_values, pixels, rounded
from unshutter.version import __version__


@dataclass(frozen=True)
class MotionOdds:
    """A photo's evidence on whether its camera moved, for judging the photos of a folder together (run/folder.py)."""

    log_odds: float  # that the camera moved, if half of all cameras did
    decision_threshold: float  # log odds of the folder from which a motion is undone


@dataclass(frozen=True)
class Finding:
    """A motion that was found or given, with its source and certainty.

    Attributes:
        motion: the motion that fits best, or was chosen; zero, with a reason, if the photo does not show enough.
        estimator: name of the method that found it, or of another source; ``given`` if unknown.
        source: where it comes from.
        confidence: probability (0 ... 1) that undoing it brings the photo closer to the truth; for no motion, that no
            motion would, unless the reason is that a motion was too unsure: then the probability is that motion's.
            None if the estimator does not report one.
        expected_error: mean displacement that is expected to remain if it does, as a share of the rows; None if the
            estimator does not report one.
        reason: why there is no motion, if the estimator declined; otherwise None.
        roll, tilt: attitude of the camera (see :class:`~unshutter.options.Camera`); None if unknown when the motion was
            found.
        attitude_from: source of the attitude, in words; empty if unknown.
        exposure_s: exposure time of the photo [s]; None if unknown.
        kind_shares: probability of each kind of motion (pan, hand, quadratic), given that the camera moved, as
            (name, share); empty if the estimator does not report them.
        video_unused: why the video inside the photo was not used; None if it was used or the photo has none.
        motion_odds: what the photo says about whether its camera moved; None if unknown; not in motion files.
        held, held_at_rest: how the camera was held if it moved like this, and if it did not move; None if unknown.
        version: version of unshutter that found it.
        candidates: all motions that fit, the best one first; empty if there was no choice.

    Raises:
        UnshutterError: a number is impossible.
    """

    motion: Motion
    _: KW_ONLY
    estimator: str = "given"
    source: MotionSource = MotionSource.GIVEN
    confidence: float | None = None
    expected_error: float | None = None
    reason: Reason | None = None
    roll: Angle | None = None
    tilt: Angle | None = None
    attitude_from: str = ""
    exposure_s: float | None = None
    kind_shares: tuple[tuple[str, float], ...] = ()
    video_unused: Reason | None = None
    motion_odds: MotionOdds | None = None
    held: Pose | None = None
    held_at_rest: Pose | None = None
    version: str = __version__
    candidates: tuple[Candidate, ...] = ()

    def __post_init__(self) -> None:
        if self.confidence is not None and not 0 <= self.confidence <= 1:
            raise UnshutterError(f"a confidence lies between 0 and 1, got {self.confidence:g}")
        angles = {"roll": self.roll and self.roll.deg, "tilt": self.tilt and self.tilt.deg}
        for name, number in (*angles.items(), ("exposure", self.exposure_s)):
            if number is not None and not math.isfinite(number):
                raise UnshutterError(f"the motion's {name} is not a finite number: {number}")

    @classmethod
    def of(cls, answer: Motion | Finding, estimator: str) -> Finding:
        """Returns an estimator's answer as a finding; the answer may be a bare motion."""
        if isinstance(answer, Finding):
            return answer
        return cls(answer, estimator=estimator, source=MotionSource.PIXELS)

    def __repr__(self) -> str:
        sure = "" if self.confidence is None or self.reason else f", confidence {self.confidence:.2f}"
        why = "" if self.reason is None else f", {self.reason}"
        return f"Finding({self.motion!r}, {self.estimator}{sure}{why})"

    # ---- of another row, size or choice ------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> Finding:
        """Returns the finding with its motion relative to another reference row."""
        rotated = float(self.motion.rz_rad[row_index(reference, self.motion.height)])
        return replace(self, motion=self.motion.rereferenced(reference), held=self.held and self.held.rolled(rotated))

    def resized(self, height: int, width: int) -> Finding:
        """Returns the finding for another size of the photo's readout frame; the aspect ratio must fit."""
        old = self.motion
        motion = old.resized(height, width)
        if motion is old or self.held is None:
            return replace(self, motion=motion)
        at = matching_rows(old.height, height)[motion.reference_row]  # the reference row is read at another time
        rotated = float(interpolated(np.array([at]), np.arange(old.height, dtype=np.float64), old.rz_rad)[0])
        return replace(self, motion=motion, held=self.held.rolled(rotated))

    def as_stated(self, most: float = MOST_STATED) -> Finding:
        """Returns the finding with every confidence in it rounded by :func:`~unshutter.reasons.as_stated`."""
        sure = None if self.confidence is None else as_stated(self.confidence, most)
        return replace(self, confidence=sure, reason=self.reason and self.reason.as_stated(most))

    def choose(self, number: int | None) -> Finding:
        """Returns the finding of a candidate, counted from 1; None: as it is, with its confidence.

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
        motion = taken.motion.scaled(strength)
        return replace(taken.finding, motion=motion, confidence=None, candidates=self.candidates)

    def fit(self, height: int, width: int, scan_direction: str = "auto") -> Finding:
        """Returns the finding for a stored picture of height x width [px]; the aspect ratio must fit.

        Raises:
            UsageError: another readout direction is asked for; UnshutterError: the aspect ratio differs.
        """
        if scan_direction != "auto" and Camera(scan_direction).scan_direction != self.motion.scan_direction:
            raise UsageError(f"the motion was made for readout {self.motion.scan_direction}, not {scan_direction}")
        return self.resized(*self.motion.scan_direction.frame_size(height, width))

    # ---- motion files --------------------------------------------------------------------------------------------

    def to_json(self) -> str:
        """Returns the finding as JSON text, format ``unshutter-motion/1`` (docs/reference/conventions)."""
        answer = {"estimator": self.estimator, "confidence": self.confidence, "unshutter": self.version}
        angles = {"roll": self.roll, "tilt": self.tilt}
        attitude = {f"{name}_deg": angle and angle.deg for name, angle in angles.items()} | {"from": self.attitude_from}
        stated = {name: angle is not None and angle.stated for name, angle in angles.items()}
        if any(stated.values()):
            attitude |= {"stated": stated}
        optional = {
            "reason": self.reason and str(self.reason),
            "declined": self.reason and self.reason.as_json(),
            "attitude": attitude if self.attitude_from else None,
            "exposure_s": self.exposure_s,
            "expected_error": rounded(self.expected_error, 6),
            "kinds": {name: round(share, 4) for name, share in self.kind_shares} or None,
            "film": self.video_unused and self.video_unused.as_json(),
            "held": self.held and asdict(self.held),
            "held_at_rest": self.held_at_rest and asdict(self.held_at_rest),
        }
        return json.dumps(self.motion.as_data(answer) | known_values(optional))

    @staticmethod
    def from_json(text: str) -> Finding:
        """Parses text written by :meth:`to_json`.

        Raises:
            UnshutterError: the text is not a motion of this format, or its values are inconsistent.
        """
        with motion_file.reading():
            data = motion_file.parsed(text)
            return Finding(Motion.of_data(data), **_answer_of(data))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes :meth:`to_json` to a file, as :meth:`Motion.save` does."""
        motion_file.save(path, self.to_json())

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Finding:
        """Reads a motion file, as :meth:`Motion.load` does."""
        return motion_file.read_file(path, Finding.from_json)


# sources by the names in motion files; all others are methods that see the photo
_SOURCES = {
    "film": MotionSource.EMBEDDED_VIDEO,
    "frames-camera": MotionSource.NEIGHBOURS,
    "by-hand": MotionSource.HAND,
    "drawn-lines": MotionSource.HAND,
    "given": MotionSource.GIVEN,
}


def _answer_of(data: JsonObject) -> JsonObject:
    """Returns the attributes of a finding other than its motion, from the contents of a motion file."""
    name = visible(str(data.get("estimator", "given")))
    attitude = dict(data.get("attitude") or {})
    stated = dict(attitude.get("stated") or {})
    angles: dict[str, Angle | None] = {}
    for angle in ("roll", "tilt"):
        degrees = number_of(attitude.get(f"{angle}_deg"))
        angles[angle] = None if degrees is None else Angle(degrees, bool(stated.get(angle)))
    shares = dict(data.get("kinds") or {})
    return {
        "estimator": name,
        "source": _SOURCES.get(name, MotionSource.PIXELS),
        "confidence": number_of(data.get("confidence")),
        "expected_error": number_of(data.get("expected_error")),
        "reason": motion_file.reason_of(data),
        **angles,
        "attitude_from": visible(str(attitude.get("from", ""))),
        "exposure_s": number_of(data.get("exposure_s")),
        "kind_shares": tuple((visible(str(kind)), float(share)) for kind, share in shares.items()),
        "video_unused": Reason.from_json(data["film"]) if "film" in data else None,
        **{held: Pose(**data[held]) for held in ("held", "held_at_rest") if held in data},
        "version": visible(str(data.get("unshutter", ""))),
    }


# ---- candidates ----------------------------------------------------------------------------------------------------

KindOfMotion = Literal["still", "pan", "hand", "quadratic", "other"]
Direction = Literal["left", "right", "up", "down"]

_TURNS = {"left": "to the left", "right": "to the right", "up": "upwards", "down": "downwards"}
_NAMES = {"hand": "hand", "quadratic": "uneven motion", "other": "motion"}
_UPRIGHT = 1  # EXIF orientation of a photo stored upright


@dataclass(frozen=True)
class Candidate:
    """A possible motion of a photo; leaving the photo unchanged is also a candidate.

    Attributes:
        kind: still (the photo is left unchanged), pan, hand (shake), quadratic (uneven motion, as drawn in benchmarks),
            or other (for methods that do not report a kind).
        finding: its motion, for the photo's full size and with the first row as the reference, and what is known of it.
        probability: that undoing this motion brings the photo closer to the truth, 0 to 1, the same as the finding's
            confidence, so those of several motions need not add up to 1; for the unchanged photo, that the likeliest of
            the others does not, so that leaving the photo is right. None if the method does not report one.
        orientation: EXIF orientation of the photo; determines the directions in the description.
    """

    kind: KindOfMotion
    finding: Finding
    probability: float | None = None
    orientation: int = _UPRIGHT

    @property
    def motion(self) -> Motion:
        """The motion."""
        return self.finding.motion

    @property
    def expected_error_px(self) -> float | None:
        """Mean displacement that remains if undoing it helps [px]; None if the method does not report one."""
        error = self.finding.expected_error
        return None if error is None or self.kind == "still" else error * self.motion.height

    @property
    def description(self) -> str:
        """Short description, e.g. ``pan to the left, 24 px`` or ``as it is``; without a size below its error."""
        if self.kind == "still" or self.is_within_error:
            return self.name
        return f"{self.name}, {pixels(self.motion.largest_px)}"

    @property
    def is_within_error(self) -> bool:
        """Whether the motion is no larger than its usual error."""
        error = self.expected_error_px
        return error is not None and error >= self.motion.largest_px

    @property
    def name(self) -> str:
        """The kind of motion in words, e.g. ``pan to the left`` or ``hand``."""
        if self.kind == "still":
            return "as it is"
        return f"pan {_TURNS[self.direction]}" if self.kind == "pan" else _NAMES[self.kind]

    def described(self) -> str:
        """With its figures: ``hand, 9.0 px (helps with a probability of 0.62, typically off by 3.1 px)``."""
        known = []
        helps = "right" if self.kind == "still" else "helps"
        if self.probability is not None:
            known.append(f"{helps} with a probability of {as_stated(self.probability):.2f}")
        if self.expected_error_px is not None:
            within = "no larger than its typical error of" if self.is_within_error else "typically off by"
            known.append(f"{within} {pixels(self.expected_error_px)}")
        return f"{self.description} ({', '.join(known)})" if known else self.description

    def as_stated(self, most: float = MOST_STATED) -> Candidate:
        """Returns the candidate with every probability in it rounded by :func:`~unshutter.reasons.as_stated`."""
        least = 1 - MOST_STATED if self.kind == "still" else 0.0  # that nothing helps is never ruled out
        motion_odds = None if self.probability is None else max(as_stated(self.probability, most), round(least, 2))
        return replace(self, finding=self.finding.as_stated(most), probability=motion_odds)

    def as_json(self) -> JsonObject:
        """Returns ``kind``, ``description``, ``probability``, ``expected_error_px`` and ``motion``, ready for JSON."""
        return {
            "kind": self.kind,
            "description": self.description,
            "probability": rounded(self.probability, 4),
            "expected_error_px": rounded(self.expected_error_px, 2),
            "motion": json.loads(self.finding.to_json()),
        }

    def rereferenced(self, reference: Reference) -> Candidate:
        """Returns the candidate with its motion relative to another reference row."""
        return replace(self, finding=self.finding.rereferenced(reference))

    def resized(self, height: int, width: int) -> Candidate:
        """Returns the candidate for another size of the photo's readout frame."""
        return replace(self, finding=self.finding.resized(height, width))

    @property
    def direction(self) -> Direction:
        """Direction in which the camera turned, as seen in the upright photo; the scene moves the opposite way."""
        up = np.array(scene_up(self.orientation, self.motion.scan_direction))
        right = np.array([-up[1], up[0]])
        scene = np.array([self.motion.tx_px[-1] - self.motion.tx_px[0], 0.0])
        sideways = float(scene @ right)
        upwards = float(scene @ up)
        if abs(sideways) >= abs(upwards):
            return "left" if sideways > 0 else "right"
        return "down" if upwards > 0 else "up"


def list_single(found: Finding, orientation: int = _UPRIGHT) -> tuple[Candidate, ...]:
    """Returns the candidates of a method that finds a single motion: that motion, then the unchanged photo."""
    if found.motion.is_zero:
        return (Candidate("still", found, found.confidence, orientation),)
    as_it_is = replace(found, motion=found.motion.scaled(0), confidence=None)
    return Candidate("other", found, found.confidence, orientation), Candidate("still", as_it_is, None, orientation)


def candidates_to_json(candidates: Iterable[Candidate]) -> str:
    """Returns the candidates of a photo as JSON text, numbered as users select them."""
    listed = [{"number": number, **each.as_json()} for number, each in enumerate(candidates, 1)]
    return json.dumps({"format": "unshutter-candidates/1", "candidates": listed})
