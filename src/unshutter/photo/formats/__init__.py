"""The file formats: each is listed here and has one file in this folder."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from unshutter.errors import UsageError
from unshutter.options import PictureFormat
from unshutter.photo.formats.heif import Avif, Heic
from unshutter.photo.formats.jpeg import Jpeg
from unshutter.photo.formats.picture_format import Format, WrittenFormat
from unshutter.photo.formats.png import Png
from unshutter.photo.formats.raw import Raw
from unshutter.photo.formats.tiff import Tiff
from unshutter.photo.formats.webp import Webp

# Checked in this order: AVIF files may also claim to be HEIC, and most raw files to be TIFF.
FORMATS: dict[str, Format] = {format.name: format for format in (Jpeg(), Png(), Webp(), Avif(), Heic(), Raw(), Tiff())}
WRITTEN = {name: format for name in get_args(PictureFormat) if isinstance(format := FORMATS[name], WrittenFormat)}


def of_suffix(suffix: str) -> Format | None:
    """Returns the format of files with this extension; None if there is none."""
    return next((format for format in FORMATS.values() if suffix.lower() in format.suffixes), None)


def of_target(path: Path) -> WrittenFormat:
    """Returns the output format for a file name."""
    format = of_suffix(path.suffix)
    if isinstance(format, WrittenFormat):
        return format
    endings = ", ".join(suffix for written in WRITTEN.values() for suffix in written.suffixes)
    if format is not None:
        raise UsageError(
            f"cannot write '{path.name}': unshutter only reads such files; use one of these extensions: {endings}"
        )
    raise UsageError(f"cannot tell the picture format from '{path.name}': use one of these extensions: {endings}")
