"""Reasons why no motion was found or a motion is not undone: a code with its figures, and the English sentences.

The program branches on codes, never on sentences. Each interface has its own wording: Python, the command line and the
logs use the sentences below; the page has its own (serve/page/words.js). Advice on what to do next belongs to the
interface, since it names a flag or a button.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class Cause(StrEnum):
    """Category under which an unchanged photo is counted."""

    NO_MOTION = "no motion"
    NO_EVIDENCE = "nothing to go by"
    NO_ROLLING_SHUTTER = "no rolling shutter"
    UNSURE = "not sure"
    TOO_SMALL = "less than half a pixel"
    STRENGTH_0 = "strength 0"


class MotionSource(StrEnum):
    """Source of a motion that was not estimated from the photo's pixels."""

    FILM = "film"
    FLIGHT = "flight"


SOURCES = {MotionSource.FILM: "by the film inside it", MotionSource.FLIGHT: "by its flight data"}


class Code(StrEnum):
    """Code of a reason, as used in logs, manifests and the API of ``unshutter serve``."""

    # one photo: from an estimator
    STATED = "stated"  # a sentence from another package's method
    TOO_LONG = "too-long"
    TOO_FEW_SEGMENTS = "too-few-segments"
    NO_RIGHT_ANGLES = "no-right-angles"
    TOO_FAST_FOR_HANDS = "too-fast-for-hands"
    TOO_SHARP = "too-sharp"
    NO_ROLLING_SHUTTER = "no-rolling-shutter"
    HOVERED = "hovered"
    FILM_STOOD_STILL = "film-stood-still"
    # the film inside a photo: why it cannot be used
    FILM_TOO_SHORT = "film-too-short"
    FILM_DIFFERS = "film-differs"
    FILM_STABILISED = "film-stabilised"
    IMPOSSIBLE_MOTION = "impossible-motion"
    ASKED_FOR_NOTHING = "asked-for-nothing"
    # one photo: from the verdict
    NO_MOTION = "no-motion"
    NO_VISIBLE_MOTION = "no-visible-motion"
    STRENGTH_0 = "strength-0"
    UNSURE = "unsure"
    UNSURE_WHETHER_MOVED = "unsure-whether-moved"
    TOO_SMALL = "too-small"
    # frames and clips
    STOOD_STILL = "stood-still"
    NOTHING_MOVED = "nothing-moved"
    NOTHING_TO_SEE = "nothing-to-see"
    HARDLY_MOVED = "hardly-moved"
    ONLY_OTHERS_MOVED = "only-others-moved"
    NO_COMMON_MOTION = "no-common-motion"
    NO_NEIGHBOUR = "no-neighbour"
    SHOT_TOO_SHORT = "shot-too-short"
    OTHER_SIZE = "other-size"
    TOO_LITTLE_TO_FOLLOW = "too-little-to-follow"
    SCENES_DIFFER = "scenes-differ"
    FRAMES_DISAGREE = "frames-disagree"
    RATIO_UNKNOWN = "ratio-unknown"  # for frames
    READOUT_TIME_UNKNOWN = "readout-time-unknown"  # for a clip
    GYRO_TOO_CALM = "gyro-too-calm"
    GYRO_TOO_SHORT = "gyro-too-short"
    GYRO_DISAGREES = "gyro-disagrees"
    # frames and clips: why the readout ratio is unknown
    TOO_FEW_FRAMES = "too-few-frames"
    SHOOK_TOO_FAST = "shook-too-fast"
    TOO_EVEN = "too-even"
    IMPRECISE = "imprecise"
    NO_ANGLES_OR_MOTION = "no-angles-or-motion"
    PARTS_DISAGREE = "parts-disagree"
    NO_CLEAR_PART = "no-clear-part"


# Code -> sentence, with the names of its figures in braces.
SENTENCES = {
    Code.STATED: "{sentence}",
    Code.TOO_LONG: "the photo's sides differ by more than {aspect:g} times",
    Code.TOO_FEW_SEGMENTS: "only {segments} straight segments found",
    Code.NO_RIGHT_ANGLES: "the photo shows no right angles",
    Code.TOO_FAST_FOR_HANDS: "the lines would mean more motion than a hand-held camera makes",
    Code.TOO_SHARP: "it is too sharp for a camera that moved during an exposure of {exposure}",
    Code.NO_ROLLING_SHUTTER: "its camera has no rolling shutter",
    Code.HOVERED: "the drone hovered",
    Code.FILM_STOOD_STILL: "the camera stood still",
    Code.FILM_TOO_SHORT: "the film inside it is too short",
    Code.FILM_DIFFERS: "the film inside it shows something else",
    Code.FILM_STABILISED: "the film inside it is stabilised",
    Code.IMPOSSIBLE_MOTION: "what was found is not a motion that a camera can make: {detail}",
    Code.ASKED_FOR_NOTHING: "asked to do nothing",
    Code.NO_MOTION: "no motion",
    Code.NO_VISIBLE_MOTION: "no visible motion",
    Code.STRENGTH_0: "a strength of 0 undoes nothing",
    Code.UNSURE: "not sure: confidence {confidence:.2f}",
    Code.UNSURE_WHETHER_MOVED: "not sure whether the camera moved: confidence {confidence:.2f}",
    Code.TOO_SMALL: "it would move by less than half a pixel",
    Code.STOOD_STILL: "the camera stood still",
    Code.NOTHING_MOVED: "nothing moved between the frames",
    Code.NOTHING_TO_SEE: "nothing to see: at most {px:.1f} px at any plausible readout time",
    Code.HARDLY_MOVED: "the camera hardly moved",
    Code.NO_COMMON_MOTION: "near and far move too differently for one motion of the camera",
    Code.ONLY_OTHERS_MOVED: "the camera stood still; what moved in front of it is not straightened",
    Code.NO_NEIGHBOUR: "there is no frame before or after it",
    Code.SHOT_TOO_SHORT: "the shot is too short to show how the camera moved",
    Code.OTHER_SIZE: "the frames before and after it have another size",
    Code.TOO_LITTLE_TO_FOLLOW: "there is too little to follow",
    Code.SCENES_DIFFER: "the neighbouring frames show another scene, or near and far move too differently in them",
    Code.FRAMES_DISAGREE: "the frames do not show how the camera moved",
    Code.RATIO_UNKNOWN: "the readout ratio cannot be found from these frames ({why})",
    Code.READOUT_TIME_UNKNOWN: "this clip does not show its readout time ({why})",
    Code.TOO_FEW_FRAMES: "{frames} frames are too few to show it",
    Code.SHOOK_TOO_FAST: "the motion changes too abruptly from frame to frame: fast shaking, or missing frames",
    Code.TOO_EVEN: "the camera moved too evenly, or too little could be followed",
    Code.IMPRECISE: "{evidence} give {value:.2f} ± {error:.2f}",
    Code.NO_ANGLES_OR_MOTION: "they show no right angles, or barely move from side to side",
    Code.PARTS_DISAGREE: "parts of the clip disagree: {ratios}",
    Code.GYRO_TOO_CALM: "the camera hardly turned: the clip does not show which moment of its gyro log is which",
    Code.GYRO_TOO_SHORT: "the gyro log ends before the clip, or has gaps",
    Code.GYRO_DISAGREES: "the picture does not follow the gyro log (correlation {correlation:.2f}): "
    "the clip was stabilised, or the log is of another clip",
    Code.NO_CLEAR_PART: "no {frames} frames in a row show one scene clearly",
}


@dataclass(frozen=True)
class Reason:
    """A reason why no motion was found, or why a motion is not undone.

    Attributes:
        code: the kind of reason.
        figures: (name, value) pairs to insert into the sentence.
    """

    code: Code
    figures: tuple[tuple[str, float | int | str], ...] = ()

    @classmethod
    def of(cls, code: Code, **figures: float | int | str) -> Reason:
        """Creates a reason from keyword figures."""
        return cls(code, tuple(figures.items()))

    @classmethod
    def stated(cls, sentence: str) -> Reason:
        """Creates a reason from a free-form sentence, as provided by other packages' methods and old motion files."""
        return cls.of(Code.STATED, sentence=sentence)

    @classmethod
    def from_json(cls, data: Any) -> Reason:
        """Reads the output of :meth:`as_json`; a reason with an unknown code keeps its sentence.

        Raises:
            TypeError, ValueError, KeyError: the data do not have this form.
        """
        code, figures = str(data["code"]), dict(data["figures"])
        if code not in set(Code):
            return cls.stated(str(data["sentence"]))
        reason = cls.of(Code(code), **figures)
        str(reason)
        return reason

    def __str__(self) -> str:
        """The reason as an English sentence."""
        return SENTENCES[self.code].format(**dict(self.figures))

    def as_json(self) -> dict[str, Any]:
        """Returns code, figures and sentence for use by programs."""
        return {"code": str(self.code), "figures": dict(self.figures), "sentence": str(self)}


def pixels(px: float) -> str:
    """Formats a length for people: ``41 px``, ``4.1 px``."""
    return f"{px:.0f} px" if px >= 10 else f"{px:.1f} px"
