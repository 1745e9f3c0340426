"""The ways in which unshutter says no."""

from __future__ import annotations

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
