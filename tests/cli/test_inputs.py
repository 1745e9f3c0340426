"""Whatever an option is given as an input, the command ends at once, with one line."""

import os
import signal
from collections.abc import Iterator
from dataclasses import MISSING
from pathlib import Path

import pytest

from support.covering import covering
from unshutter.cli import command_named, main, summaries
from unshutter.options.fields import options_of

pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs pipes and devices that have names")
LIMIT_S = 30  # importing torch takes seconds on a busy machine


def inputs() -> Iterator[tuple[str, str]]:
    for name in sorted(summaries()):
        for each in options_of(command_named(name).arguments):
            if each.more.get("names") == "input":
                yield name, each.key


INPUTS = list(inputs())


def test_the_inputs_are_found() -> None:
    assert {("rectify", "motion"), ("estimate", "lines"), ("video", "gyro"), ("points", "table")} <= set(INPUTS)


def words_of(command: str, key: str, odd: Path, photo: Path, out: Path) -> list[str]:
    """A command whose arguments are all in order, but for one."""
    words, kind = [command], command_named(command).arguments
    for each in options_of(kind):
        is_needed = each.default is MISSING and each.more["names"] == "input"
        is_needed |= (command, each.key) == ("evaluate", "data")  # by all protocols but one
        if is_needed or each.key == key:
            words += [] if each.more.get("positional") else [f"--{each.name}"]
            words += [str(odd if each.key == key else photo)]
    return words + (["-o", str(out)] if any(each.key == "output" for each in options_of(kind)) else [])


@pytest.fixture
def odd(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    places = {"endless": Path("/dev/zero"), "no name": tmp_path / ("x" * 300)}
    place = places.get(request.param, tmp_path / request.param)
    if request.param == "pipe":
        os.mkfifo(place)
    elif request.param == "folder":
        place.mkdir()
    elif request.param == "empty":
        place.touch()
    return place


@pytest.mark.parametrize(
    ("given", "odd"), covering(INPUTS, ["pipe", "endless", "folder", "empty", "no name"]), indirect=["odd"]
)
def test_an_odd_input_ends_the_command_with_one_line(
    given: tuple[str, str], odd: Path, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def late(*_: object) -> None:
        pytest.fail(f"not done after {LIMIT_S} s")

    before, out = signal.signal(signal.SIGALRM, late), tmp_path / "out.json"
    signal.alarm(LIMIT_S)
    try:
        code = main(words_of(*given, odd, photo, out))
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    message = capsys.readouterr().err
    lines = message.removesuffix("unshutter: 1 of 1 photos failed\n").splitlines()
    assert code in (1, 2) and len(lines) == 1 and "Traceback" not in message, message
    if odd.name in ("pipe", "zero"):
        assert "it is a pipe or a device, not a file" in message or "is not a folder" in message
    assert not out.is_file()
