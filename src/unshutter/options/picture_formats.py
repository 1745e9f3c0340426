"""The table of picture formats: their names, endings and MIME types, and which of them are written.

A format is one row here, and one file in photo/formats, which reads its files and, if it is a :data:`PictureFormat`,
writes them. Everything else that depends on formats reads this table.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple, get_args

PictureFormat = Literal["jpeg", "png", "webp", "tiff", "avif"]  # those that are written


class FormatRow(NamedTuple):
    """A picture format."""

    name: str  # as in ``Photo.format`` and for ``--format``
    title: str  # in sentences
    codec: str  # its class: module in photo/formats, and name
    suffixes: tuple[str, ...]  # endings of file names in lower case, the usual one first
    mime_types: tuple[str, ...]
    written_as: PictureFormat  # format of results: its own name, or another one if it is read-only
    usual_quality: int | None = None  # 1-100, where neither the user nor the original states one; None: lossless
    has_subsampling: bool = False  # whether chroma may have half resolution

    @property
    def is_written(self) -> bool:
        """Whether unshutter writes it."""
        return self.written_as == self.name


_RAW = "dng 3fr arw cr2 cr3 crw erf fff iiq kdc mef mos mrw nef nrw orf pef raf rw2 rwl sr2 srf srw x3f"
_RAW_SUFFIXES = tuple(f".{name}" for name in _RAW.split())
_RAW_TYPES = ("image/x-adobe-dng", "image/x-canon-cr2", "image/x-canon-cr3", "image/x-nikon-nef", "image/x-sony-arw")
_RAW_TYPES += ("image/x-fuji-raf",)

# In the order in which files are recognised: AVIF files may also claim to be HEIC, and most raw files to be TIFF.
TABLE = (
    FormatRow("jpeg", "JPEG", "jpeg:Jpeg", (".jpg", ".jpeg", ".jpe", ".jfif"), ("image/jpeg",), "jpeg", 95, True),
    FormatRow("png", "PNG", "png:Png", (".png",), ("image/png",), "png"),
    FormatRow("webp", "WebP", "webp:Webp", (".webp",), ("image/webp",), "webp", 90),
    FormatRow("avif", "AVIF", "heif:Avif", (".avif",), ("image/avif",), "avif", 80, True),
    FormatRow("heic", "HEIC", "heif:Heic", (".heic", ".heif", ".hif"), ("image/heic", "image/heif"), "avif"),
    FormatRow("raw", "raw", "raw:Raw", _RAW_SUFFIXES, _RAW_TYPES, "tiff"),
    FormatRow("tiff", "TIFF", "tiff:Tiff", (".tif", ".tiff"), ("image/tiff",), "tiff"),
)
BY_NAME = {row.name: row for row in TABLE}
SUFFIXES = frozenset(suffix for row in TABLE for suffix in row.suffixes)

SEVERAL_PICTURES = ".mpo"  # from stereo cameras; its first bytes are those of a JPEG
OTHER_PICTURES = frozenset({".bmp", ".jp2", ".jxl", ".psd", SEVERAL_PICTURES})  # endings of formats that are not read


def of_suffix(suffix: str) -> FormatRow | None:
    """Returns the format of files with this ending; None if there is none."""
    return next((row for row in TABLE if suffix.lower() in row.suffixes), None)


def in_words(rows: Iterable[FormatRow] = TABLE, last: str = "and") -> str:
    """Lists formats for a sentence, those that are written first: ``JPEG, PNG and raw``."""
    written = get_args(PictureFormat)
    ordered = sorted(rows, key=lambda row: written.index(row.name) if row.is_written else len(written))
    *others, final = (row.title for row in ordered)
    return f"{', '.join(others)} {last} {final}" if others else final
