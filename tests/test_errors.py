"""Errors: one line each, with files by names that suit the reader, also from another process."""

import pickle
import re
from pathlib import Path

import pytest

from unshutter import UnshutterError, UsageError
from unshutter.errors import MissingFileError, UnknownRatioError, errors_in_one_line
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


def test_no_message_is_rewritten_or_asked() -> None:
    """The program looks at types and fields of errors; text is for people."""
    bad = re.compile(r"type\(error\)\(|str\(error\)\.(replace|remove)|in str\(error\)|str\(error\) ==")
    for file in sorted((ROOT / "src").rglob("*.py")):
        assert not bad.search(file.read_text(encoding="utf-8")), file
