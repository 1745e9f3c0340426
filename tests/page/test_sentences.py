"""Reasons in the page's words, and the buttons that it offers with them."""

import re
from string import Formatter

import pytest

from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import Certainty, judge
from unshutter.options import Undo
from unshutter.page.app import PAGE
from unshutter.page.sentences import OTHER_NEIGHBOURS, advice, reason_json, sentence, verdict_json
from unshutter.reasons import Cause, Code, Reason


@pytest.mark.parametrize("code", Code)
def test_every_reason_has_its_words(code: Code) -> None:
    """Complete with the figures that the program states, and without flags, which are the command line's."""
    names = [name for _, name, _, _ in Formatter().parse(code.sentence) if name]
    said = sentence(Reason.of(code, **dict.fromkeys(names, 3)))
    assert said and not re.search(r"[{}]|--|\bNone\b", said)


@pytest.mark.parametrize(
    ("reason", "said"),
    [
        (Reason(Code.NO_VISIBLE_MOTION), "no motion can be seen"),
        (
            Reason.of(Code.UNSURE, confidence=0.344),
            "not sure enough: straightening it would help with a probability of 34 %",
        ),
        (Reason.of(Code.TOO_FEW_SEGMENTS, segments=1), "only 1 straight line was found"),
        (Reason.of(Code.TOO_FEW_SEGMENTS, segments=0), "only 0 straight lines were found"),
        (
            Reason.of(Code.MOVED_TOO_LITTLE, px=12.34),
            "you said that the camera moved, but the motion that fits is hardly larger than its typical error",
        ),
        (Reason.of(Code.TOO_ASKEW, deg=31.6), "not levelled: held askew by 32°"),
        (Reason(Code.HARDLY_MOVED), "the camera hardly moved"),  # as everywhere
        (Reason.stated("the sun was gone"), "the sun was gone"),
    ],
)
def test_what_is_said(reason: Reason, said: str) -> None:
    assert sentence(reason) == reason_json(reason)["sentence"] == said


@pytest.mark.parametrize(
    "reason",
    [
        Reason(Code.NO_RIGHT_ANGLES),
        Reason.of(Code.TOO_FEW_SEGMENTS, segments=3),
        Reason(Code.WIDE_LENS),
        Reason.of(Code.TOO_SHARP, exposure="1/100 s"),
        Reason.of(Code.NO_ROLLING_SHUTTER, camera="a Canon PowerShot A70"),
    ],
)
def test_nobody_is_asked_which_way_the_camera_moved_where_that_does_not_help(reason: Reason) -> None:
    """Of a flower, for instance: no right angles, whichever way."""
    assert "adviceWay" not in advice(reason, Cause.UNSURE)
    assert "adviceWay" in advice(Reason(Code.NO_VISIBLE_MOTION), Cause.NO_MOTION)


def test_the_page_has_no_words_of_its_own_for_a_confidence() -> None:
    """They come with each result and candidate, and whether they ask for a look."""
    script = "".join(file.read_text("utf-8") for file in PAGE.glob("*.js"))
    assert [word for word in Certainty if f'"{word}"' in script] == []


def test_what_is_advised() -> None:
    assert "adviceAnyway" in advice(Reason.of(Code.UNSURE, confidence=0.3), Cause.UNSURE)
    assert "adviceAnyway" not in advice(Reason(Code.NO_RIGHT_ANGLES), Cause.NO_EVIDENCE)
    assert advice(Reason(Code.STRENGTH_0)) == ()  # nothing is left to try
    assert advice(Reason(Code.OTHER_SIZE)) == OTHER_NEIGHBOURS


def test_a_verdict_has_reason_and_advice_unless_it_is_undone() -> None:
    motion = RowMotion.from_polynomials([0, 20], [0], 80, 100)
    still = Finding(motion.scaled(0), reason=Reason(Code.NO_RIGHT_ANGLES))
    declined = verdict_json(judge(still, Undo()))
    assert (declined["reason"], declined["code"]) == ("the photo shows no right angles", "no-right-angles")
    assert "adviceByHand" in declined["advice"]
    left = verdict_json(judge(Finding(motion), Undo(strength=0)))
    assert (left["reason"], left["advice"]) == ("the strength is 0", ())
    assert {"reason", "advice"}.isdisjoint(verdict_json(judge(Finding(motion), Undo())))


def test_every_button_that_is_advised_is_on_the_page() -> None:
    names = {name for code in Code for cause in (None, Cause.UNSURE) for name in advice(Reason(code), cause)}
    words = (PAGE / "words.js").read_text("utf-8")
    assert names >= {"adviceWay", "adviceAnyway", "adviceLeaveNeighbours"}
    assert [name for name in sorted(names) if f"\n  {name}:" not in words] == []
