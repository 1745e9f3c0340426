"""The exceptions that users see."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Self

from unshutter.reasons import Code, Reason

# Names of files and methods may contain line breaks and terminal control codes.
_FIELD = re.compile(r"\{(\w+)\}")
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)}


def visible(text: str) -> str:
    """Escapes line breaks and control characters, so that the text fits on one line and cannot affect a terminal."""
    return text.translate(_VISIBLE)


def suggestion(word: str, choices: Iterable[str]) -> str:
    """Suggests the choice closest to a mistyped word, ``did you mean rectify?``; empty if none is close."""
    import difflib  # imported here because it is rarely needed

    known = list(choices)
    close = [
        *difflib.get_close_matches(word, known, n=1, cutoff=0.7),
        *(each for each in known if each.startswith(word)),
    ]
    return f"did you mean {close[0]}?" if close else ""


class UnshutterError(Exception):
    """The input cannot be processed; the message is one line for the user (exit code 1).

    Files that a message mentions are fields of the error, so that each interface can use its own names for them: the
    command line shows paths, the page says "the photo".

        raise UnshutterError("{photo} is empty (0 bytes)", photo=path)

    Args:
        message: one line, with a field in braces for each file.
        more: further arguments of a subclass.
        files: field -> file.

    Attributes:
        files: field -> path, as text.
        subject: path of the file being processed; a message that does not mention it is prefixed with it. Empty: none.
        names: path -> name to show instead.
    """

    def __init__(self, message: str = "", *more: object, **files: object):
        super().__init__(message, *more)
        self.files = {field: str(file) for field, file in files.items()}
        self.subject = ""
        self.names: dict[str, str] = {}

    @property
    def sentence(self) -> str:
        """The message with its fields replaced by file names."""

        def name(field: re.Match[str]) -> str:
            path = self.files.get(field[1])
            return field[0] if path is None else self.names.get(path, path)

        message = str(self.args[0]) if self.args else ""
        return _FIELD.sub(name, message) if self.files else message

    def __str__(self) -> str:
        starts = self.subject and self.subject not in self.files.values()
        about = self.names.get(self.subject, self.subject)
        return visible(f"{about}: {self.sentence}" if starts else self.sentence)


class MissingFileError(UnshutterError, FileNotFoundError):
    """A photo, a motion file or weights do not exist."""


class WeightsError(UnshutterError):
    """The weights cannot be used for any photo."""


class CropTooSmallError(UnshutterError):
    """Cropping would leave almost nothing of the picture.

    Attributes:
        share_left: share of the picture's area that would be left; None: unknown.
    """

    share_left: float | None = None

    @classmethod
    def leaving(cls, share_left: float, subject: str) -> CropTooSmallError:
        """Creates the error with its message.

        Args:
            share_left: share of the area that the crop would leave.
            subject: word for the picture in the message: ``photo``, ``frame``.
        """
        percent = 100 * share_left
        error = cls(f"cropping would leave {percent:.0f} % of the {subject}: use other edges, keep or fill")
        error.share_left = share_left
        return error


class UsageError(UnshutterError):
    """The request itself is invalid, regardless of the input (exit code 2)."""


class UnknownRatioError(UnshutterError):
    """The frames do not show their camera's readout ratio, and the user has not specified it.

    Attributes:
        reason: why the frames do not show it; its code is ``RATIO_UNKNOWN``, or ``READOUT_TIME_UNKNOWN`` for a clip.
        advice: what the user can do, phrased for the command line, Python or the page; each adds its own.
    """

    def __init__(self, message: str, reason: Reason | None = None, advice: str = ""):
        super().__init__(message, reason, advice)  # all three, so that the error can be pickled
        self.advice = advice
        self.reason = Reason.stated(message) if reason is None else reason

    @property
    def sentence(self) -> str:
        """The message followed by the advice."""
        return f"{super().sentence}: {self.advice}" if self.advice else super().sentence

    @classmethod
    def because(cls, cause: Reason) -> Self:
        """Creates the error for frames that do not show the ratio, with the cause."""
        return cls._of(Reason.of(Code.RATIO_UNKNOWN, because=str(cause.code), why=str(cause)))

    def of_clip(self) -> Self:
        """Returns the error as reported for a whole clip."""
        return self._of(replace(self.reason, code=Code.READOUT_TIME_UNKNOWN))

    def with_advice(self, advice: str) -> Self:
        """Returns the error with advice for the user."""
        return type(self)(self.args[0], self.reason, advice)

    @classmethod
    def _of(cls, reason: Reason) -> Self:
        return cls(str(reason), reason)


@contextmanager
def errors_in_one_line(subject: object = "", names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Converts errors in the block to UnshutterErrors about a file; UNSHUTTER_DEBUG=1 lets unexpected ones through.

    Args:
        subject: the file that the block processes; added to messages that do not mention it. Empty: none.
        names: path -> name to show in messages instead.

    Raises:
        UnshutterError: for any error except BrokenPipeError, which is not about the file.
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
