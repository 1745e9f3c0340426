"""The exceptions that users see."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Self

from unshutter.reasons import Code, Reason

# Names of files and methods may contain line breaks and terminal control codes.
_FIELD = re.compile(r"\{(--)?(\w[\w-]*)\}")  # of a message: an option or a file
_NOT_TEXT = re.compile("[\ud800-\udc7f\udd00-\udfff]")  # surrogates, other than those for bytes in names of files
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)}


stand_ins: dict[str, str] = {}  # path -> what messages and logs call it: a URL, ``standard input``


def visible(text: str) -> str:
    """Escapes line breaks and control characters, so that the text fits on one line and cannot affect a terminal."""
    return _NOT_TEXT.sub(lambda found: ascii(found[0])[1:-1], with_stand_ins(text).translate(_VISIBLE))


def with_stand_ins(text: str) -> str:
    """Returns a text that calls paths by what they stand for."""
    for path in sorted(stand_ins, key=len, reverse=True):
        text = text.replace(path, stand_ins[path])
    return text


_LONGEST_VALUE = 60  # characters


def shortened(value: object) -> str:
    """Returns a value for a message: its beginning and end if it is long."""
    text = str(value)
    half = _LONGEST_VALUE // 2
    return text if len(text) <= _LONGEST_VALUE else f"{text[:half]}...{text[-half:]}"


def suggestion(word: str, choices: Iterable[str]) -> str:
    """Suggests the choice closest to a mistyped word, ``did you mean rectify?``; empty if none is close."""
    known = list(choices)
    close = similar(word, known, 1) or [k for k in known if k.startswith(word)]
    return f"did you mean {close[0]}?" if close else ""


def similar(word: str, known: Iterable[str], most: int) -> list[str]:
    """Returns the known words that are spelled most like one, if any are close."""
    import difflib  # imported here because it is rarely needed

    return difflib.get_close_matches(word, list(known), most, 0.7)


def as_flag(option: str) -> str:
    """Spells the name of an option as on the command line: ``--readout-ms``."""
    return f"--{option}"


def as_keyword(option: str) -> str:
    """Spells the name of an option as in Python: ``readout_ms``."""
    return option.replace("-", "_")


def with_options(text: str, spell: Callable[[str], str] = as_flag) -> str:
    """Spells the options that a text names in braces, ``{--readout-ms}``."""
    return _FIELD.sub(lambda field: spell(field[2]) if field[1] else field[0], text)


class UnshutterError(Exception):
    """The input cannot be processed; the message is one line for the user (exit code 1).

    Files that a message mentions are fields of the error (``files``: field -> path), so that each interface can show
    its own ``names`` (path -> name) for them: the command line shows paths, the page says "the photo".

        raise UnshutterError("{photo} is empty (0 bytes)", photo=path)

    Options are fields, too, with two dashes; each interface sets how it spells them (``spell``):

        raise UsageError("give {--readout-ms} or {--readout-ratio}, not both")

    ``subject`` is the path of the file being processed: a message that does not mention it is prefixed with it.
    """

    def __init__(self, message: str = "", *more: object, **files: object):
        super().__init__(message, *more)
        self.files = {field: str(file) for field, file in files.items()}
        self.subject = ""
        self.names: dict[str, str] = {}
        self.spell = as_flag

    @property
    def _template(self) -> str:
        """The message with its fields."""
        return str(self.args[0]) if self.args else ""

    @property
    def pieces(self) -> list[str]:
        """The line with the names of its files, split into text and names of options, in turn."""
        pieces = [self._start]
        at = 0
        message = self._template
        for field in _FIELD.finditer(message):
            pieces[-1] += message[at : field.start()]
            at = field.end()
            if field[1]:
                pieces += [field[2], ""]
            else:
                path = self.files.get(field[2])
                pieces[-1] += field[0] if path is None else self.names.get(path, path)
        pieces[-1] += message[at:]
        return pieces

    @property
    def _start(self) -> str:
        """The name of the subject and a colon; empty if the message mentions it."""
        starts = self.subject and self.subject not in self.files.values()
        return f"{self.names.get(self.subject, self.subject)}: " if starts else ""

    @property
    def _line(self) -> str:
        return "".join(self.spell(piece) if k % 2 else piece for k, piece in enumerate(self.pieces))

    @property
    def sentence(self) -> str:
        """The message with the names of its files and options, without the subject in front."""
        return self._line.removeprefix(self._start)

    def __str__(self) -> str:
        return visible(self._line)


class MissingFileError(UnshutterError, FileNotFoundError):
    """A photo, a motion file or weights do not exist."""


class WeightsError(UnshutterError):
    """The weights cannot be used for any photo."""


class UsageError(UnshutterError):
    """The request itself is invalid, regardless of the input (exit code 2)."""


class UnknownRatioError(UnshutterError):
    """The frames do not show their camera's readout ratio, and the user has not specified it."""

    def __init__(self, message: str, reason: Reason | None = None, advice: str = ""):
        super().__init__(message, reason, advice)  # all three, so that the error can be pickled
        self.advice = advice
        self.reason = Reason.stated(message) if reason is None else reason

    @property
    def _template(self) -> str:
        """The message followed by the advice."""
        return f"{super()._template}: {self.advice}" if self.advice else super()._template

    @classmethod
    def because(cls, cause: Reason) -> Self:
        """Creates the error for frames that do not show the ratio, with the cause."""
        return cls._of(Reason.of(Code.RATIO_UNKNOWN, because=str(cause.code), why=str(cause)))

    def of_clip(self) -> Self:
        """Returns the error as reported for a whole clip."""
        return self._of(replace(self.reason, code=Code.READOUT_TIME_UNKNOWN))

    def with_advice(self, advice: str) -> Self:
        """Returns the error with advice for the user."""
        advised = type(self)(self.args[0], self.reason, advice)
        advised.files = self.files
        advised.subject = self.subject
        advised.names = self.names
        return advised

    @classmethod
    def _of(cls, reason: Reason) -> Self:
        return cls(str(reason), reason)


@contextmanager
def errors_in_one_line(subject: object = "", names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Converts errors in the block to UnshutterErrors about a file; UNSHUTTER_DEBUG=1 lets unexpected ones through.

    The subject is added to messages that do not mention it, and shown by its name in ``names`` (path -> name).
    """
    try:
        yield
    except UnshutterError as error:
        error.subject = error.subject or str(subject)
        error.names.update(names or {})
        raise
    except BrokenPipeError:  # the process reading our output has exited
        raise
    except MemoryError:
        raise _about("not enough memory", subject) from None
    except Exception as error:
        if os.environ.get("UNSHUTTER_DEBUG"):
            raise
        line = " ".join(str(error).split())
        if isinstance(error, OSError):  # for example, a full disc
            raise _about(error.strerror or line, subject) from error
        unexpected = f"unexpected {type(error).__name__}: {line} (please report it; UNSHUTTER_DEBUG=1 shows more)"
        raise _about(unexpected, subject) from error


def _about(line: str, subject: object) -> UnshutterError:
    error = UnshutterError(line)
    error.subject = str(subject)
    return error
