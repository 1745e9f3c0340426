"""Errors: one line each, with files by names that suit the reader, also from another process."""

import ast
import pickle
import re
from pathlib import Path

import pytest

from unshutter import UnshutterError, UsageError
from unshutter.cli import COMMANDS, command_named
from unshutter.errors import MissingFileError, UnknownRatioError, errors_in_one_line
from unshutter.options.fields import errors_in_python, options_of
from unshutter.page.settings import refusal
from unshutter.reasons import Code, Reason

ROOT = Path(__file__).parent.parent
PHOTO, OTHER = Path("photos/a {x}.jpg"), Path("photos/b.jpg")


def _sent(error: UnshutterError) -> UnshutterError:
    """As another process hands it on."""
    return pickle.loads(pickle.dumps(error))


@pytest.mark.parametrize("kind", [UnshutterError, UsageError, MissingFileError])
def test_files_go_by_their_names(kind: type[UnshutterError]) -> None:
    error = kind("{photo} has {4} bits but {other} has 8\n", photo=PHOTO, other=OTHER)
    assert str(error) == "photos/a {x}.jpg has {4} bits but photos/b.jpg has 8\\n"
    with (
        pytest.raises(kind) as raised,
        errors_in_one_line(names={str(PHOTO): "the photo", str(OTHER): "its neighbour"}),
    ):
        raise error
    for each in (raised.value, _sent(raised.value)):
        assert str(each) == "the photo has {4} bits but its neighbour has 8\\n" and type(each) is kind


def test_text_of_other_packages_is_left_alone() -> None:
    assert str(UnshutterError("{photo} is {}")) == "{photo} is {}" and str(UnshutterError()) == ""
    assert str(MissingFileError("cannot read x")) == "cannot read x"


def test_a_message_begins_with_its_photo_unless_it_mentions_it() -> None:
    for error, line in (
        (UnshutterError("too small"), "photos/a {x}.jpg: too small"),
        (UnshutterError("{photo} is too small", photo=PHOTO), "photos/a {x}.jpg is too small"),
        (UnshutterError("cannot write {target}", target=OTHER), "photos/a {x}.jpg: cannot write photos/b.jpg"),
    ):
        with pytest.raises(UnshutterError) as raised, errors_in_one_line(PHOTO):
            raise error
        assert str(_sent(raised.value)) == line


def test_the_subject_goes_by_its_name_too() -> None:
    with pytest.raises(UnshutterError) as raised, errors_in_one_line(PHOTO, {str(PHOTO): "the motion"}):
        raise UnshutterError("not a motion file")
    assert str(_sent(raised.value)) == "the motion: not a motion file"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (MemoryError(), "b.jpg: not enough memory"),
        (OSError(28, "No space left on device"), "b.jpg: No space left on device"),
        (ZeroDivisionError("a\nb"), "b.jpg: unexpected ZeroDivisionError: a b (please report it; UNSHUTTER_DEBUG=1"),
    ],
)
def test_what_nobody_foresaw_is_one_line(error: Exception, line: str) -> None:
    with pytest.raises(UnshutterError) as raised, errors_in_one_line("b.jpg"):
        raise error
    assert str(raised.value).startswith(line)


def test_a_reason_goes_along() -> None:
    error = UnknownRatioError.because(Reason.of(Code.STOOD_STILL))
    with pytest.raises(UnknownRatioError) as raised, errors_in_one_line("b.jpg"):
        raise error.with_advice("say it")
    sent = _sent(raised.value)
    assert isinstance(sent, UnknownRatioError) and sent.reason == error.reason
    assert str(sent).startswith("b.jpg: the readout ratio cannot be found") and str(sent).endswith(": say it")
    later = raised.value.with_advice("say more")  # of an error that has its subject
    assert str(later).startswith("b.jpg: the readout ratio cannot be found") and str(later).endswith(": say more")


def test_no_message_is_rewritten_or_asked() -> None:
    """The program looks at types and fields of errors; text is for people."""
    bad = re.compile(r"type\(error\)\(|str\(error\)\.(replace|remove)|in str\(error\)|str\(error\) ==")
    for file in sorted((ROOT / "src").rglob("*.py")):
        assert not bad.search(file.read_text(encoding="utf-8")), file


def test_options_are_spelled_as_each_interface_spells_them() -> None:
    error = UsageError("{--min-confidence} must lie between 0 and 1, not as in {photo}", photo=Path("{--jobs}.jpg"))
    assert str(error) == "--min-confidence must lie between 0 and 1, not as in {--jobs}.jpg"
    with pytest.raises(UsageError) as raised, errors_in_python():
        raise error
    assert str(_sent(raised.value)) == "min_confidence must lie between 0 and 1, not as in {--jobs}.jpg"
    answer = refusal(UsageError("give {--readout-ms}, or see {--max-mb}\n"))
    assert answer == {
        "error": "give readout-ms, or see --max-mb\\n",
        "said": ["give ", "readout-ms", ", or see ", "max-mb", "\\n"],
    }


def test_errors_name_options_as_fields() -> None:
    """A flag in the text of an error would be shown to people who have no command line."""
    commands = [command_named(name) for name in COMMANDS]
    known = {option.name for command in commands for option in options_of(command.arguments)}
    for file in sorted((ROOT / "src").rglob("*.py")):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = getattr(call.func, "id", getattr(call.func, "attr", "")) if isinstance(call, ast.Call) else ""
            if name.endswith("Error") or name in ("with_advice", "option"):
                texts = [each.value for each in ast.walk(call) if isinstance(each, ast.Constant)]
                said = re.sub(r"`[^`]*`|\(see .*--help\)|pip install.*", "", "".join(map(str, texts)))
                assert not re.search(r"(?<!\{)--[a-z]{2,}", said.replace("shtab knows no : ", "")), (file, said)
                named = set(re.findall(r"\{--([a-z-]+)\}", said))
                assert named <= known, (file, named - known)
