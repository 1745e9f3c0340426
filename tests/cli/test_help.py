"""Help that fits a screen, and messages that say what was meant."""

import pytest

from unshutter.cli import main
from unshutter.errors import suggestion


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The smallest that is common: 80 columns, 24 rows."""
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("command", ["rectify", "estimate", "map", "points", "serve", "video"])
def test_help_fits_a_screen(command: str, terminal: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 24
    assert all(len(line) <= 80 for line in lines)


def test_the_rest_is_in_help_all(terminal: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rectify", "-h"]) == 0
    short = capsys.readouterr().out
    assert "--scheduler" not in short and "unshutter rectify --help-all" in short
    assert main(["rectify", "--help-all"]) == 0
    assert "--scheduler" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["rectfy", "a.jpg"], "unknown command 'rectfy': did you mean rectify?"),
        (["modls"], "did you mean models?"),
        (
            ["rectify", "a.jpg", "--edges", "crp"],
            "fill, borrow, not 'crp': did you mean crop?",
        ),
        (["rectify", "a.jpg", "--strength", "half"], "--strength takes a number, not 'half'"),
        (["rectify", "a.jpg", "--estimator", "segment-manhatan"], "did you mean segment-manhattan?"),
        (["rectify", "a.jpg", "--stregth", "0.5"], "unknown option --stregth: did you mean --strength?"),
        (["rectify", "a.jpg", "--min-conf=0"], "unknown option --min-conf: did you mean --min-confidence?"),
        (["--strength", "0.5", "a.jpg"], "options come after the command: unshutter rectify PHOTO --strength"),
    ],
)
def test_did_you_mean(words: list[str], hint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    message = capsys.readouterr().err
    assert hint in message and message.count("\n") == 1


def test_nothing_is_suggested_that_is_not_alike() -> None:
    assert suggestion("straighten", ["rectify", "train"]) == ""
    assert suggestion("xyzzy", ["rectify", "video"]) == ""
