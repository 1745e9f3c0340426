"""Reasons: codes with figures, and their sentences."""

import json
import re
from string import Formatter

import pytest

from unshutter.reasons import Code, Reason, percent


def test_every_code_has_a_sentence() -> None:
    for code in Code:
        assert not code.sentence.endswith(".") and "--" not in code.sentence  # flags are the command line's business


@pytest.mark.parametrize("code", Code)
def test_a_reason_survives_json(code: Code) -> None:
    names = [name for _, name, _, _ in Formatter().parse(code.sentence) if name]
    reason = Reason.of(code, **dict.fromkeys(names, 3))
    assert Reason.from_json(json.loads(json.dumps(reason.as_json()))) == reason
    assert re.fullmatch(r"[a-z0-9-]+", reason.as_json()["code"])


@pytest.mark.parametrize(("share", "words"), [(0.8399, "84 %"), (0.8, "80 %"), (0.999, "99 %"), (1.0, "100 %")])
def test_a_share_is_the_nearest_per_cent_but_100_only_if_it_is_all(share: float, words: str) -> None:
    assert percent(share) == words


def test_a_code_of_a_later_version_keeps_its_sentence() -> None:
    later = {"code": "eclipse", "figures": {}, "sentence": "the sun was gone"}
    assert str(Reason.from_json(later)) == "the sun was gone"


@pytest.mark.parametrize("wrong", [{}, {"code": "unsure"}, {"code": "too-few-segments", "figures": {}}, "no", None])
def test_what_is_no_reason_is_refused(wrong: object) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        Reason.from_json(wrong)
