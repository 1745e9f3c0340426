"""From a dataclass to a command line."""

from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from unshutter.cli import command_named, main, summaries
from unshutter.cli.arguments import Command, parse
from unshutter.errors import UsageError
from unshutter.options import option
from unshutter.options.fields import positional


@dataclass(frozen=True)
class Group:
    """What belongs together."""

    tilt_deg: float | None = option(None, "An angle, 100 % real.")
    edges: Literal["keep", "crop"] = option("keep", "Edges.")

    def __post_init__(self) -> None:
        if self.tilt_deg is not None and self.tilt_deg > 90:
            raise UsageError("too steep")


@dataclass(frozen=True)
class Arguments:
    """All kinds of arguments."""

    photos: list[Path] = positional("Photos.", "input")
    output: Path = option(MISSING, "Where to.", names="output", short="-o")
    jobs: int | None = option(None, "How many.")
    again: bool = option(False, "Once more.")
    word: str = option("auto", "One of several.", choices=("auto", "manual"))
    group: Group = field(default_factory=Group)


COMMAND = Command("Tries it.", Arguments, lambda given: 0)


def parsed(*words: str) -> Arguments:
    return parse("try", COMMAND, words)


def test_each_field_is_an_argument() -> None:
    assert parsed("a.jpg", "-o", "out") == Arguments([Path("a.jpg")], Path("out"))
    words = ("--jobs", "3", "--tilt-deg", "-12.5", "--edges=crop", "--again", "--word", "manual", "--output", "out")
    assert parsed("a.jpg", *words) == Arguments([Path("a.jpg")], Path("out"), 3, True, "manual", Group(-12.5, "crop"))


def test_photos_may_stand_before_between_and_after_options() -> None:
    assert parsed("a", "-o", "out", "b", "--jobs", "2", "c").photos == [Path("a"), Path("b"), Path("c")]
    assert parsed("-o", "out", "./-strange.jpg").photos == [Path("-strange.jpg")]


def test_words_after_two_dashes_are_names() -> None:
    names = ("-o.jpg", "--help.jpg", "--help", "--unknown")
    assert parsed("a", "-o", "out", "--", *names).photos == [Path(name) for name in ("a", *names)]
    assert parsed("-o", "out", "--", *names).photos == [Path(name) for name in names]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("-o", "out"), "required: PHOTOS"),
        (("a",), "required: --output"),
        (("a", "-o", "out", "--jobs", "many"), "--jobs takes a whole number, not 'many'"),
        (("a", "-o", "out", "--edges", "round"), "--edges takes keep, crop, not 'round'"),
        (("a", "-o", "out", "--job", "2"), "--job"),  # no abbreviations: they would change their meaning one day
        (("a", "-o"), "--output/-o: needs a value"),
        (("a", "-o", "-"), "--output: '-' is not accepted"),
        (("a", "-o", "out", "--tilt-deg", "91"), "too steep"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(words: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(UsageError) as caught:
        parsed(*words)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_path_may_be_a_url_of_this_machine_only() -> None:
    assert parsed("local:///d/a.jpg", "-o", "dir://out::file:///d") == Arguments([Path("/d/a.jpg")], Path("/d/out"))
    with pytest.raises(UsageError, match="s3://b/out is a URL"):  # rather than a folder called s3:
        parsed("a.jpg", "-o", "s3://b/out")


def test_a_path_that_does_not_say_what_it_names() -> None:
    @dataclass(frozen=True)
    class Forgetful:
        output: Path | None = option(None, "Where to.")

    with pytest.raises(TypeError, match="say what the option 'output' names"):
        parse("try", Command("Tries it.", Forgetful, lambda given: 0), [])


def test_help_names_every_option_under_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed("--help-all")
    text = capsys.readouterr().out
    for word in ("usage: unshutter try PHOTOS ... [options]", "What belongs together:", "100 % real", "-o", "--again"):
        assert word in text


@pytest.mark.parametrize("name", sorted(summaries()))  # in one order, whatever order their packages are found in
def test_every_command_has_help_that_ends_its_sentences(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    assert f"usage: unshutter {name}" in capsys.readouterr().out
    assert command_named(name).description.rstrip().endswith(".")


def test_without_a_command_the_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["--help"], ["-h"]):
        assert main(words) == 0
        text = capsys.readouterr().out
        assert all(f"  {name}" in text for name in summaries())
