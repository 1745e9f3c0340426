"""The page's wording of why something is left unchanged, and the buttons that it offers then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.reasons import Cause, Code, JsonObject, Reason, percent

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict

# Where the sentence of a reason speaks of the program, the page says it to someone who looks at the photo.
_SENTENCES = {
    Code.TOO_LONG: "one side is more than {aspect:g} times as long as the other",
    Code.TOO_FEW_SEGMENTS: "only {segments} straight lines were found",
    Code.TOO_ASKEW: "not levelled: held askew by {deg:.0f}°",
    Code.TOO_STEEP: "not made upright: tilted by {deg:.0f}°",
    Code.EMBEDDED_VIDEO_STOOD_STILL: "the camera stood still, as the video inside it shows",
    Code.IMPOSSIBLE_MOTION: "no camera moves like that: {detail}",
    Code.ASKED_FOR_NOTHING: "that is what you asked for",
    Code.NO_MOTION: "the camera did not move",
    Code.NO_VISIBLE_MOTION: "no motion can be seen",
    Code.STRENGTH_0: "the strength is 0",
    Code.UNSURE: "not sure enough: straightening it would help with a probability of {percent}",
    Code.UNSURE_HOW_MOVED: "you said that the camera moved, but straightening it by the likeliest motion would help "
    "with a probability of only {percent}",
    Code.UNSURE_WHETHER_MOVED: "not sure whether the camera moved: leaving the photo is right with a probability of "
    "{percent}",
    Code.TOO_SMALL: "nothing would move by as much as half a pixel",
    Code.TOO_LITTLE_TO_FOLLOW: "there is too little to follow from frame to frame",
    Code.SCENES_DIFFER: "its neighbours show another scene, or near and far move too differently in them",
    Code.RATIO_UNKNOWN: "the readout time cannot be found from these frames ({why})",
}
_ONE_LINE = "only 1 straight line was found"

# The names of the page's buttons that may help (page/web/advice.js), beside the reasons for which they do.
_BY_HAND = ("adviceNeighbour", "adviceByHand")
# reasons of photos with straight lines: which way the camera moved then decides
_WAY_HELPS = {
    Code.NO_MOTION,
    Code.NO_VISIBLE_MOTION,
    Code.TOO_FAST_FOR_HANDS,
    Code.UNSURE,
    Code.HARDLY_HELPS,
    Code.UNSURE_WHETHER_MOVED,
    Code.UNSURE_HOW_MOVED,
    Code.MOVED_TOO_LITTLE,
    Code.MOVED_OTHERWISE,
    Code.WHICH_WAY,
}
_LEANS = "adviceLevel"
OTHER_NEIGHBOURS = ("adviceNeighbours", "adviceLeaveNeighbours")
_ADVICE: dict[Code, tuple[str, ...]] = {
    **dict.fromkeys(
        (Code.NO_ROLLING_SHUTTER, Code.PANORAMA, Code.BORDER, Code.ASKED_FOR_NOTHING, Code.STRENGTH_0), ()
    ),  # nothing is left to try
    **dict.fromkeys(
        (Code.OTHER_SIZE, Code.SCENES_DIFFER, Code.TOO_LITTLE_TO_FOLLOW, Code.FRAMES_DISAGREE, Code.NO_NEIGHBOUR),
        OTHER_NEIGHBOURS,
    ),
}


def sentence(reason: Reason) -> str:
    """Phrases a reason as the page does."""
    figures = dict(reason.figures)
    if figures.get("segments") == 1:
        return _ONE_LINE
    if "confidence" in figures:
        figures["percent"] = percent(float(figures["confidence"]))
    return _SENTENCES.get(reason.code, reason.code.sentence).format(**figures)


def advice(reason: Reason, cause: Cause | None = None) -> tuple[str, ...]:
    """Returns the names of the buttons that may help someone whose photo is left unchanged for a reason."""
    if reason.code in _ADVICE:
        return _ADVICE[reason.code]
    way = ("adviceWay",) if reason.code in _WAY_HELPS else ()
    anyway = ("adviceAnyway",) if cause is Cause.UNSURE and way else ()
    return *way, *anyway, *_BY_HAND


def verdict_json(verdict: Verdict) -> JsonObject:
    """Returns a verdict as JSON, worded for the page and with advice."""
    data = verdict.as_json()
    data["doubted"] = verdict.certainty is not None and verdict.certainty.is_doubted
    if verdict.reason is not None and not verdict.undoes:
        said = sentence(verdict.reason)
        offered = advice(verdict.reason, verdict.cause)
        data |= {"reason": said, "advice": offered}
        if verdict.lean is not None:
            data["advice"] = (_LEANS, *offered)
    return data


def reason_json(reason: Reason) -> JsonObject:
    """Returns a reason as JSON, in the page's words."""
    return {**reason.as_json(), "sentence": sentence(reason)}
