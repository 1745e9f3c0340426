"""The exceptions that users see."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Self

from unshutter.reasons import Code, Reason

# Names of files and methods may hold line breaks, and codes that change a terminal.
_FIELD = re.compile(r"\{(\w+)\}")
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)}


def visible(text: str) -> str:
    """The text as one line: what would break it, or change a terminal, is spelled out."""
    return text.translate(_VISIBLE)


def suggestion(word: str, choices: Iterable[str]) -> str:
    """``did you mean rectify?`` for the choice most like a word; empty where none is like it."""
    import difflib  # not above: few words are wrong

    known = list(choices)
    close = [
        *difflib.get_close_matches(word, known, n=1, cutoff=0.7),
        *(each for each in known if each.startswith(word)),
    ]
    return f"did you mean {close[0]}?" if close else ""


class UnshutterError(Exception):
    """Something about the input makes the job impossible; the message is one line for the user (exit code 1).

    Files that a message mentions are fields of the error, so that each surface can call them by its own names: the
    command line shows paths, the page says "the photo".

        raise UnshutterError("{photo} is empty (0 bytes)", photo=path)

    Args:
        message: one line, with a field in braces for each file.
        more: further arguments of a subclass.
        files: field -> file.

    Attributes:
        files: field -> path, as text.
        subject: path of the file that was worked on; a message that does not mention it begins with it. Empty: none.
        names: path -> what the file is called instead.
    """

    def __init__(self, message: str = "", *more: object, **files: object):
        super().__init__(message, *more)
        self.files = {field: str(file) for field, file in files.items()}
        self.subject = ""
        self.names: dict[str, str] = {}

    @property
    def sentence(self) -> str:
        """The message, with the names of its files."""

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
    """A photo, a motion file or weights that are not there."""


class WeightsError(UnshutterError):
    """Weights that cannot be used, whatever the photo."""


class CropTooSmallError(UnshutterError):
    """A crop that would leave next to nothing of a picture.

    Attributes:
        share_left: share of the picture's area that it would leave; None: not known.
    """

    share_left: float | None = None

    @classmethod
    def leaving(cls, share_left: float, subject: str) -> CropTooSmallError:
        """With its message.

        Args:
            share_left: share of the area that the crop would leave.
            subject: what the picture is called: ``photo``, ``frame``.
        """
        percent = 100 * share_left
        error = cls(f"cropping would leave {percent:.0f} % of the {subject}: use other edges, keep or fill")
        error.share_left = share_left
        return error


class UsageError(UnshutterError):
    """The request itself is wrong, whatever the input (exit code 2)."""


class UnknownRatioError(UnshutterError):
    """Frames do not show the readout ratio of their camera, and the user has not given it.

    Attributes:
        reason: why they do not; its code is ``RATIO_UNKNOWN``, or ``READOUT_TIME_UNKNOWN`` for a clip.
        advice: what the user can do, in the words of the command line, of Python or of the page; each adds its own.
    """

    def __init__(self, message: str, reason: Reason | None = None, advice: str = ""):
        super().__init__(message, reason, advice)  # all three, so that other processes can pass it on
        self.advice = advice
        self.reason = Reason.stated(message) if reason is None else reason

    @property
    def sentence(self) -> str:
        """The message, and the advice."""
        return f"{super().sentence}: {self.advice}" if self.advice else super().sentence

    @classmethod
    def because(cls, cause: Reason) -> Self:
        """The error of frames that do not show the ratio for this cause."""
        return cls._of(Reason.of(Code.RATIO_UNKNOWN, because=str(cause.code), why=str(cause)))

    def of_clip(self) -> Self:
        """This error as it is reported of a whole clip."""
        return self._of(replace(self.reason, code=Code.READOUT_TIME_UNKNOWN))

    def with_advice(self, advice: str) -> Self:
        """This error with what the user can do about it."""
        return type(self)(self.args[0], self.reason, advice)

    @classmethod
    def _of(cls, reason: Reason) -> Self:
        return cls(str(reason), reason)


@contextmanager
def errors_in_one_line(subject: object = "", names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Errors in the block become UnshutterErrors about a file; UNSHUTTER_DEBUG=1 shows unexpected ones as they are.

    Args:
        subject: the file that the block works on, named by messages that do not mention it; empty: none.
        names: path -> what a file is called in messages instead.

    Raises:
        UnshutterError: whatever went wrong, but for a BrokenPipeError, which is not about the file.
    """
    try:
        yield
    except UnshutterError as error:
        error.subject = error.subject or str(subject)
        error.names.update(names or {})
        raise
    except BrokenPipeError:  # the reader of our output went away
        raise
    except MemoryError:
        raise _about("not enough memory", subject) from None
    except Exception as error:
        if os.environ.get("UNSHUTTER_DEBUG"):
            raise
        line = " ".join(str(error).split())
        if isinstance(error, OSError):  # a full disc, say
            raise _about(error.strerror or line, subject) from error
        unexpected = f"unexpected {type(error).__name__}: {line} (please report it; UNSHUTTER_DEBUG=1 shows more)"
        raise _about(unexpected, subject) from error


def _about(line: str, subject: object) -> UnshutterError:
    error = UnshutterError(line)
    error.subject = str(subject)
    return error
