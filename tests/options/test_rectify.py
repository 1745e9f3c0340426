"""What follows from options for others."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from unshutter.errors import UsageError
from unshutter.options import Camera, Clock, DecisionOptions, Find, Neighbours, Rectify, Undo

SEQUENCE = Neighbours(sequence=True)


def test_a_value_has_the_options_that_it_was_made_with() -> None:
    choices: list[dict[str, Any]] = [
        {"motion": Path("m.json")},
        {"neighbours": SEQUENCE},
        {"undo": Undo(min_confidence=0)},
    ]
    for options in choices:
        made = Rectify(**options)
        assert all(getattr(made, name) == value for name, value in options.items())
        assert (made.find, made.undo) == (Find(), options.get("undo", Undo()))


def test_what_follows_from_options_for_others() -> None:
    assert Rectify(motion=Path("m.json")).settled().undo == Undo(min_confidence=0)
    assert Rectify(neighbours=SEQUENCE).settled().undo == Undo(edges="keep")
    assert Rectify(neighbours=SEQUENCE, undo=Undo(edges="crop")).settled().undo == Undo(edges="crop")
    assert Rectify(undo=Undo(min_confidence=0)).settled().find == Find(decision=DecisionOptions(least_confidence=0))
    assert Rectify().settled() == Rectify()


def test_a_given_motion_has_no_least_confidence() -> None:
    with pytest.raises(UsageError, match="leave out --min-confidence"):
        Rectify(motion=Path("m.json"), undo=Undo(min_confidence=0.5)).settled()


def test_a_sequence_needs_both_numbers_of_its_readout_or_none() -> None:
    burst = replace(SEQUENCE, fallback=True)
    for camera, clock in ((Camera(readout_ms=20), Clock()), (Camera(), Clock(fps=30))):
        with pytest.raises(UsageError, match="give both"):
            Rectify(find=Find(camera=camera), neighbours=replace(SEQUENCE, clock=clock)).settled()
        Rectify(find=Find(camera=camera), neighbours=replace(burst, clock=clock)).settled()
