"""The file formats: each has a line here and a file in this folder."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from unshutter.errors import UsageError
from unshutter.options import PictureFormat
from unshutter.photo.format import Format, WrittenFormat
from unshutter.photo.formats.avif import Avif
from unshutter.photo.formats.heic import Heic
from unshutter.photo.formats.jpeg import Jpeg
from unshutter.photo.formats.png import Png
from unshutter.photo.formats.raw import Raw
from unshutter.photo.formats.tiff import Tiff
from unshutter.photo.formats.webp import Webp

# Asked in this order whether a file is theirs: AVIF files may call themselves HEIC, too, and most raw files TIFF.
FORMATS: dict[str, Format] = {
    format.name: format
    for format in (
        Jpeg(),
        Png(),
        Webp(),
        Avif(),
        Heic(),
        Raw(),
        Tiff(),
    )
}
WRITTEN = {name: format for name in get_args(PictureFormat) if isinstance(format := FORMATS[name], WrittenFormat)}


def of_suffix(suffix: str) -> Format | None:
    """The format of files with this ending, if there is one."""
    return next((format for format in FORMATS.values() if suffix.lower() in format.suffixes), None)


def of_target(path: Path) -> WrittenFormat:
    """The format that a file name asks to be written.

    Raises:
        UsageError: the ending names none, or one that is only read.
    """
    format = of_suffix(path.suffix)
    if isinstance(format, WrittenFormat):
        return format
    endings = ", ".join(suffix for written in WRITTEN.values() for suffix in written.suffixes)
    if format is not None:
        raise UsageError(f"cannot write '{path.name}': such files are only read; end the name in one of {endings}")
    raise UsageError(f"cannot tell the picture format from '{path.name}': end the name in one of {endings}")
