"""Options by the names of the command line's flags."""

import re
from pathlib import Path

import pytest

from unshutter.cli.arguments import parse
from unshutter.cli.photo_commands import RECTIFY
from unshutter.errors import UsageError
from unshutter.options.fields import options_of
from unshutter.page.settings import ByHand, fields, read


def test_the_same_as_on_the_command_line() -> None:
    given = {"strength": "0.5", "edges": "crop", "roll-deg": "-2.5", "min-confidence": "0", "format": "png"}
    words = [word for name, value in given.items() for word in (f"--{name}", value)] + ["--moving"]
    expected = parse("rectify", RECTIFY, ["photo.jpg", *words])
    wanted = read(given | {"moving": "yes"}, Path)
    assert (wanted.find, wanted.undo, wanted.save) == (expected.find, expected.undo, expected.save)


def test_every_field_is_a_flag() -> None:
    by_hand = {option.name for option in options_of(ByHand)}  # which nobody does in a terminal
    for field in fields():
        if field.name in by_hand:
            continue
        value = [] if field.type is bool else [field.choices[0] if field.choices else "1"]
        try:
            parse("rectify", RECTIFY, ["photo.jpg", f"--{field.name}", *value])
        except UsageError as error:
            assert re.search("--before|must lie between", str(error))  # known, but for neighbours, or above 1


def test_nothing_given_is_the_default() -> None:
    expected = parse("rectify", RECTIFY, ["photo.jpg"])
    for wanted in (read({}, Path), read({"strength": "", "edges": ""}, Path)):
        assert (wanted.find, wanted.undo, wanted.save) == (expected.find, expected.undo, expected.save)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"strenght": "1"}, "unknown field 'strenght'"),
        ({"strength": "much"}, "field 'strength' takes a number"),
        ({"strength": "2.1"}, "strength must lie between 0 and 2"),
        ({"strength": "nan"}, "strength must lie between 0 and 2"),
        ({"moving": "perhaps"}, "field 'moving' takes one of yes, left"),
        ({"no-film": "perhaps"}, "field 'no-film' takes true or false"),
        ({"edges": "round"}, "field 'edges' takes one of auto"),
        ({"readout": "inwards"}, "field 'readout' takes one of"),
        ({"roll-deg": "90"}, "--roll-deg must lie between"),
        ({"quality": "1e9"}, "field 'quality' takes a number"),
        ({"motion": "/etc/passwd"}, "unknown field 'motion'"),
        ({"sequence": "true"}, "unknown field 'sequence'"),
        ({"edges": "borrow"}, "borrow needs a neighbour"),
        ({"before": "x", "roll-deg": "1"}, "are for single photos"),
        ({"keep-times": "true"}, "unknown field 'keep-times'"),
        ({"estimator": "segment-transformer@/etc/passwd"}, "your own weights work only on the command line"),
    ],
)
def test_what_is_refused(given: dict[str, str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        _ = read(given, Path).rectify
