"""Why a photo, moment or clip is left unchanged, as the page says it, and the buttons that it then offers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.reasons import WITHOUT_CONFIDENCE, Cause, Code, JsonObject, Reason, percent, pixels

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict

# Where the sentence of a reason speaks of the program, the page says it to someone who looks at the photo.
_SENTENCES = {
    Code.TOO_LONG: "one side is more than {aspect:g} times as long as the other",
    Code.TOO_FEW_SEGMENTS: "only {segments} straight lines were found",
    Code.TOO_ASKEW: "not levelled: held askew by {deg:.0f}°",
    Code.TOO_STEEP: "not made upright: tilted by {deg:.0f}°",
    Code.NO_ROLLING_SHUTTER: "this camera exposes all rows at once",
    Code.FILM_STOOD_STILL: "the camera stood still, as the film inside it shows",
    Code.IMPOSSIBLE_MOTION: "no camera moves like that: {detail}",
    Code.ASKED_FOR_NOTHING: "that is what you asked for",
    Code.NO_MOTION: "the camera did not move",
    Code.NO_VISIBLE_MOTION: "no motion can be seen",
    Code.STRENGTH_0: "the strength is 0",
    Code.UNSURE: "not sure: straightening it would help with a probability of {percent}",
    Code.UNSURE_HOW_MOVED: "you said that the camera moved, but straightening it by the likeliest motion would help "
    "with a probability of only {percent}",
    Code.MOVED_TOO_LITTLE: "you said that the camera moved, but the motion that fits, up to {length}, is hardly larger "
    "than its typical error",
    Code.UNSURE_WHETHER_MOVED: "not sure whether the camera moved (confidence {percent})",
    Code.TOO_SMALL: "nothing would move by as much as half a pixel",
    Code.TOO_LITTLE_TO_FOLLOW: "there is too little to follow from frame to frame",
    Code.SCENES_DIFFER: "its neighbours show another scene, or near and far move too differently in them",
    Code.RATIO_UNKNOWN: "the readout time cannot be found from these frames ({why})",
}
_ONE_LINE = "only 1 straight line was found"

# The names of the page's buttons that may help (page/web/advice.js), beside the reasons for which they do.
_BY_HAND = ("adviceWay", "adviceNeighbour", "adviceByHand")
_UNSURE = ("adviceWay", "adviceAnyway", "adviceNeighbour", "adviceByHand")
_LEANS = "adviceLevel"
OTHER_NEIGHBOURS = ("adviceNeighbours", "adviceLeaveNeighbours")
_ADVICE: dict[Code, tuple[str, ...]] = {
    **dict.fromkeys((Code.NO_ROLLING_SHUTTER, Code.ASKED_FOR_NOTHING, Code.STRENGTH_0), ()),  # nothing is left to try
    **dict.fromkeys(
        (Code.OTHER_SIZE, Code.SCENES_DIFFER, Code.TOO_LITTLE_TO_FOLLOW, Code.FRAMES_DISAGREE, Code.NO_NEIGHBOUR),
        OTHER_NEIGHBOURS,
    ),
}


def sentence(reason: Reason, confidence: float | None = None) -> str:
    """Words a reason as the page does, with a verdict's confidence where that means something."""
    figures = dict(reason.figures)
    if figures.get("segments") == 1:
        return _ONE_LINE
    if "confidence" in figures:
        figures["percent"] = percent(float(figures["confidence"]))
    if "px" in figures:
        figures["length"] = pixels(float(figures["px"]))
    said = _SENTENCES.get(reason.code, reason.code.sentence).format(**figures)
    if reason.code in WITHOUT_CONFIDENCE and confidence is not None and confidence >= 0.5:
        return f"{said} (confidence {percent(confidence)})"
    return said


def advice(reason: Reason, cause: Cause | None = None) -> tuple[str, ...]:
    """Returns the names of the buttons that may help someone whose photo is left unchanged for a reason."""
    return _ADVICE.get(reason.code, _UNSURE if cause is Cause.UNSURE else _BY_HAND)


def verdict_json(verdict: Verdict) -> JsonObject:
    """Returns a verdict as JSON, worded for the page and with advice."""
    data = verdict.as_json()
    if verdict.reason is not None and not verdict.undoes:
        said = sentence(verdict.reason, verdict.confidence)
        offered = advice(verdict.reason, verdict.cause)
        data |= {"reason": said, "advice": offered}
        if verdict.lean_deg is not None:
            data |= {"advice": (_LEANS, *offered), "lean_deg": round(verdict.lean_deg, 2)}
    return data


def reason_json(reason: Reason) -> JsonObject:
    """Returns a reason as JSON, in the page's words."""
    return {**reason.as_json(), "sentence": sentence(reason)}
