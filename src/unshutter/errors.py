"""The exceptions that users see."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

from unshutter.reasons import Code, Reason

# Names of files and methods may hold line breaks, and codes that change a terminal.
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*range(0x20), *range(0x7F, 0xA0), 0x2028, 0x2029)}


def visible(text: str) -> str:
    """The text as one line: what would break it, or change a terminal, is spelled out."""
    return text.translate(_VISIBLE)


class UnshutterError(Exception):
    """Something about the input makes the job impossible; the message is one line for the user (exit code 1)."""

    def __str__(self) -> str:
        return visible(super().__str__())


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
        self.message, self.advice = message, advice
        self.reason = Reason.stated(message) if reason is None else reason

    def __str__(self) -> str:
        return visible(f"{self.message}: {self.advice}" if self.advice else self.message)

    @classmethod
    def because(cls, cause: Reason) -> Self:
        """The error of frames that do not show the ratio for this cause."""
        return cls._of(Reason.of(Code.RATIO_UNKNOWN, because=str(cause.code), why=str(cause)))

    def of_clip(self) -> Self:
        """This error as it is reported of a whole clip."""
        return self._of(replace(self.reason, code=Code.READOUT_TIME_UNKNOWN))

    def with_advice(self, advice: str) -> Self:
        """This error with what the user can do about it."""
        return type(self)(self.message, self.reason, advice)

    @classmethod
    def _of(cls, reason: Reason) -> Self:
        return cls(str(reason), reason)
