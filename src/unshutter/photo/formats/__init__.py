"""The codecs of the picture formats: each has one file in this folder, named in options/picture_formats.py."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import get_args

from unshutter.errors import UsageError
from unshutter.options.picture_formats import BY_NAME, TABLE, FormatRow, PictureFormat, of_suffix
from unshutter.photo.formats.picture_format import Format, WrittenFormat


def _codec(row: FormatRow) -> Format:
    module, _, name = row.codec.partition(":")
    return getattr(import_module(f"{__name__}.{module}"), name)(row)


FORMATS = {row.name: _codec(row) for row in TABLE}
WRITTEN = {name: format for name, format in FORMATS.items() if isinstance(format, WrittenFormat)}


def of_target(path: Path) -> WrittenFormat:
    """Returns the output format for a file name."""
    row = of_suffix(path.suffix)
    if row is not None and row.is_written:
        return WRITTEN[row.name]
    endings = ", ".join(suffix for name in get_args(PictureFormat) for suffix in BY_NAME[name].suffixes)
    if row is not None:
        raise UsageError(
            f"cannot write '{path.name}': unshutter only reads such files; use one of these extensions: {endings}"
        )
    raise UsageError(f"cannot tell the picture format from '{path.name}': use one of these extensions: {endings}")
