"""Reasons why no motion was found or a motion is not undone: a code with its figures, and the English sentences.

The program branches on codes, never on sentences. Python, the command line and the logs use the sentences below, and so
does the page, except for those that page/sentences.py words otherwise. Advice on what to do next belongs to the
interface, since it names a flag or a button.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Self, TypeAlias

JsonObject: TypeAlias = dict[str, Any]  # name -> value; whoever reads one from a file checks the values


class Cause(StrEnum):
    """Category under which an unchanged photo is counted."""

    NO_MOTION = "no motion"
    NO_EVIDENCE = "nothing to go by"
    NO_ROLLING_SHUTTER = "no rolling shutter"
    UNSURE = "not sure"
    TOO_SMALL = "less than half a pixel"
    STRENGTH_0 = "strength 0"


class MotionSource(StrEnum):
    """Where a motion comes from."""

    PIXELS = "pixels"  # a method that sees the photo
    EMBEDDED_VIDEO = "film"  # the video inside the photo
    NEIGHBOURS = "neighbours"  # the frames before and after it, or its burst
    HAND = "hand"  # a person, with lines or numbers
    GIVEN = "given"  # a motion file, or a motion passed in Python


class Worded(StrEnum):
    """A word for programs, with its English for people: a sentence, or a part of one."""

    sentence: str

    def __new__(cls, word: str, sentence: str) -> Self:
        """Creates a member, whose value is its word."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.sentence = sentence
        return member


class Code(Worded):
    """Code of a reason, as used in logs, manifests and the API of ``unshutter serve``.

    Its sentence has the names of the reason's figures in braces.
    """

    # one photo: from an estimator
    STATED = "stated", "{sentence}"  # a sentence from another package's method
    TOO_LONG = "too-long", "the photo's sides differ by more than {aspect:g} times"
    TOO_FEW_SEGMENTS = "too-few-segments", "only {segments} straight segments found"
    NO_RIGHT_ANGLES = "no-right-angles", "the photo shows no right angles"
    TOO_FAST_FOR_HANDS = "too-fast-for-hands", "the lines would mean more motion than a hand-held camera makes"
    TOO_SHARP = "too-sharp", "it is too sharp for a camera that moved during an exposure of {exposure}"
    NO_ROLLING_SHUTTER = "no-rolling-shutter", "{camera} exposes all rows at once"
    PANORAMA = "panorama", "it is a panorama, whose rows were not read out one after another"
    BORDER = "border", "there is a plain border round the picture, which the camera did not see: crop it off first"
    EMBEDDED_VIDEO_STOOD_STILL = "film-stood-still", "the camera stood still"
    # the video inside a photo: why it cannot be used
    EMBEDDED_VIDEO_TOO_SHORT = "film-too-short", "the video inside it is too short"
    EMBEDDED_VIDEO_DIFFERS = "film-differs", "the video inside it shows something else"
    EMBEDDED_VIDEO_STABILISED = "film-stabilised", "the video inside it is stabilised"
    IMPOSSIBLE_MOTION = "impossible-motion", "no camera can make the motion that was found: {detail}"
    ASKED_FOR_NOTHING = "asked-for-nothing", "this method never finds a motion"
    # one photo: from the verdict
    NO_MOTION = "no-motion", "no motion"
    NO_VISIBLE_MOTION = "no-visible-motion", "no visible motion"
    STRENGTH_0 = "strength-0", "a strength of 0 undoes nothing"
    UNSURE = "unsure", "not sure enough: it would help with a probability of {confidence:.2f}"
    HARDLY_HELPS = "hardly-helps", "not sure enough: the motion that was found is hardly larger than its typical error"
    UNSURE_WHETHER_MOVED = (
        "unsure-whether-moved",
        "not sure whether the camera moved: leaving the photo is right with a probability of {confidence:.2f}",
    )
    # the same of a photo whose user says that the camera moved
    UNSURE_HOW_MOVED = (
        "unsure-how-moved",
        "you said that the camera moved, but the likeliest motion would help with a probability of only "
        "{confidence:.2f}",
    )
    MOVED_TOO_LITTLE = (
        "moved-too-little",
        "you said that the camera moved, but the motion that fits is hardly larger than its typical error",
    )
    MOVED_OTHERWISE = "moved-otherwise", "you said how the camera moved, but no motion that fits goes that way"
    WIDE_LENS = "wide-lens", "not sure: a wide lens bends lines"
    WHICH_WAY = "which-way", "its motion blur shows that the camera moved, but not which way"
    TOO_SMALL = "too-small", "it would move by less than half a pixel"
    POSE_UNKNOWN = "pose-unknown", "the photo does not show how the camera was held"
    TOO_ASKEW = "too-askew", "not levelled: held askew by {deg:.0f} degrees"
    TOO_STEEP = "too-steep", "not made upright: tilted by {deg:.0f} degrees"
    # frames and clips
    STOOD_STILL = "stood-still", "the camera stood still"
    NOTHING_MOVED = "nothing-moved", "nothing moved between the frames"
    NOTHING_TO_SEE = "nothing-to-see", "nothing to see: at most {px:.1f} px at any plausible readout time"
    NO_VISIBLE_DISTORTION = "no-visible-distortion", "this clip has no visible rolling-shutter distortion"
    NO_GAIN = (
        "no-gain",
        "undoing the motion hardly helps: wobble of {before:.2f} px before, {after:.2f} px after",
    )
    LEANS_OTHERWISE = (
        "leans-otherwise",
        "frames do not lean as the camera's speed says (correlation {correlation:.2f}): the readout time is wrong, or "
        "more moves than the camera",
    )
    READ_AT_ONCE = (
        "read-at-once",
        "its frames show no rolling shutter: all rows were exposed at once, or the camera corrected them",
    )
    FRAMES_REPEAT = "frames-repeat", "some frames repeat the one before them"
    SCENE_CONTRADICTS = (
        "scene-contradicts",
        "this scene does not show the readout time of the clip: another camera took it, or it is corrected already",
    )
    DAMAGED = "damaged", "it is damaged in the file"
    NO_WOBBLE = "no-wobble", "its frames do not show that their rows were read one after another"
    HARDLY_MOVED = "hardly-moved", "the camera hardly moved"
    ONLY_OTHERS_MOVED = "only-others-moved", "the camera stood still; what moved in front of it is not straightened"
    NO_COMMON_MOTION = "no-common-motion", "near and far move too differently for one motion of the camera"
    NO_NEIGHBOUR = "no-neighbour", "there is no frame before or after it"
    SHOT_TOO_SHORT = "shot-too-short", "the shot is too short to show how the camera moved"
    OTHER_SIZE = "other-size", "the frames before and after it have another size"
    TOO_LITTLE_TO_FOLLOW = "too-little-to-follow", "there is too little to follow"
    SCENES_DIFFER = (
        "scenes-differ",
        "the neighbouring frames show another scene, or near and far move too differently in them",
    )
    FRAMES_DISAGREE = "frames-disagree", "the frames do not show how the camera moved"
    RATIO_UNKNOWN = "ratio-unknown", "the readout ratio cannot be found from these frames ({why})"  # for frames
    READOUT_TIME_UNKNOWN = "readout-time-unknown", "this clip does not show its readout time ({why})"  # for a clip
    GYRO_TOO_CALM = (
        "gyro-too-calm",
        "the camera barely turned: the gyro log cannot be aligned with the clip",
    )
    GYRO_TOO_SHORT = "gyro-too-short", "the gyro log ends before the clip, or has gaps"
    GYRO_DISAGREES = (
        "gyro-disagrees",
        "the picture does not follow the gyro log (correlation {correlation:.2f}): "
        "the clip was stabilised, or the log belongs to another clip",
    )
    GYRO_DAMAGED = "gyro-damaged", "it is damaged"
    GYRO_UNREAD = "gyro-unread", "reading it needs the extra gyro"
    STABILISED_IN_CAMERA = (
        "stabilised-in-camera",
        "its camera stabilised the clip, so the times of its rows are unknown",
    )
    # frames and clips: why the readout ratio is unknown
    TOO_FEW_FRAMES = "too-few-frames", "{frames} frames are too few to show it"
    SHOOK_TOO_FAST = (
        "shook-too-fast",
        "the motion changes too abruptly from frame to frame: fast shaking, or missing frames",
    )
    TOO_EVEN = "too-even", "the camera moved too evenly, or too little could be followed"
    PARTS_DISAGREE = "parts-disagree", "parts of the clip disagree: {ratios}"
    NO_CLEAR_PART = "no-clear-part", "no {frames} frames in a row show one scene clearly"


@dataclass(frozen=True)
class Reason:
    """A reason why no motion was found, or why a motion is not undone."""

    code: Code  # the kind of reason
    figures: tuple[tuple[str, float | int | str], ...] = ()  # (name, value) pairs to insert into the sentence

    @classmethod
    def of(cls, code: Code, **figures: float | int | str) -> Reason:
        """Creates a reason from keyword figures."""
        return cls(code, tuple(figures.items()))

    @classmethod
    def stated(cls, sentence: str) -> Reason:
        """Creates a reason from a free-form sentence, as provided by other packages' methods and old motion files."""
        return cls.of(Code.STATED, sentence=sentence)

    @classmethod
    def from_json(cls, data: JsonObject) -> Reason:
        """Reads the output of :meth:`as_json`; one with codes or figures of another version keeps its sentence."""
        code = str(data["code"])
        figures = dict(data["figures"])
        if code not in set(Code):
            return cls.stated(str(data["sentence"]))
        reason = cls.of(Code(code), **figures)
        try:
            str(reason)
        except KeyError:
            return cls.stated(str(data["sentence"]))
        return reason

    @property
    def px(self) -> float:
        """The displacement that it states [px]; 0 if it states none."""
        return float(dict(self.figures).get("px", 0.0))

    def as_stated(self, most: float) -> Reason:
        """Returns the reason with its confidence, if it has one, rounded by :func:`as_stated`."""
        figures = dict(self.figures)
        if "confidence" in figures:
            figures["confidence"] = as_stated(float(figures["confidence"]), most)
        return replace(self, figures=tuple(figures.items()))

    def __str__(self) -> str:
        """The reason as an English sentence."""
        return self.code.sentence.format(**dict(self.figures))

    def as_json(self) -> JsonObject:
        """Returns code, figures and sentence for use by programs."""
        return {"code": str(self.code), "figures": dict(self.figures), "sentence": str(self)}


def known_values(values: JsonObject) -> JsonObject:
    """Returns the values that are known: not None."""
    return {name: value for name, value in values.items() if value is not None}


def rounded(number: float | None, digits: int) -> float | None:
    """Returns a number as it is written; None if it is unknown."""
    return None if number is None else round(number, digits)


def pixels(px: float) -> str:
    """Formats a length for people: ``41 px``, ``4.1 px``."""
    return f"{px:.0f} px" if px >= 10 else f"{px:.1f} px"


MOST_STATED = 0.97  # of those stated at more, three in five of a hard set were wrong: no evidence supports more


def as_stated(probability: float, most: float = MOST_STATED) -> float:
    """Rounds a probability for people: down to two decimals, and to no more than was measured."""
    return min(math.floor(100 * probability + 1e-9) / 100, most)


def percent(share: float) -> str:
    """Formats a share for people: ``84 %``; 100 % is all of it, not almost all."""
    return f"{min(round(100 * share), 99) if share < 1 else round(100 * share)} %"
