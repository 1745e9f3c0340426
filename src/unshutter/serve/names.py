"""File names: sanitises names sent by browsers, and derives names for results that are unique and not too long."""

from __future__ import annotations

import os
import re
import unicodedata
import zipfile
from pathlib import Path, PurePosixPath

from unshutter.batch.inputs import RECTIFIED
from unshutter.batch.targets import picture_name
from unshutter.errors import UsageError
from unshutter.photo.formats import of_suffix
from unshutter.video.pictures import is_pattern

MOST_BYTES = 255  # longest file name in UTF-8; file systems that encrypt names may allow less

_UNUSUAL = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"|?*\u200e\u200f\u202a-\u202e\u2066-\u2069]')
_LONGEST_NAME, _LONGEST_SUFFIX = 120, 10  # characters
_JOINER = "\u200d"

# Suffixes of single-file video formats. Excludes picture formats, for which FFmpeg writes one file per frame, and
# playlists (.m3u8, .mpd), next to which it writes the video in segments.
_FILM = re.compile(
    r"\.(3g2|3gp|asf|avi|dv|f4v|flv|gif|h264|hevc|ivf|lrv|m1v|m2t|m2ts|m2v|m4v|mj2|mjpeg|mk3d|mkv|mov|mp4|mpe?g|mts|mxf|nut|"
    r"obu|og[gv]|ts|vob|webm|wmv|wtv|y4m)",
    re.IGNORECASE,
)


def clean_name(name: str, otherwise: str = "photo") -> str:
    """Returns the last component of a file name, without path separators or characters that are not text.

    Args:
        name: any text.
        otherwise: name to use if nothing is left.
    """
    last = re.split(r"[/\\]", name)[-1]
    last = _UNUSUAL.sub("", last.encode("utf-8", "ignore").decode()).strip()
    stem, _, suffix = last.rpartition(".")
    if not suffix or len(suffix) > _LONGEST_SUFFIX or last == suffix:
        stem, suffix = last, ""
    stem = stem.lstrip(".")[: _LONGEST_NAME - len(suffix)].strip() or otherwise
    return f"{stem}.{suffix}" if suffix else stem


def photo_result(name: str, format: str | None) -> str:
    """Returns the name of a photo's result, as on the command line: ``street.rectified.jpg``.

    Args:
        name: name of the photo.
        format: format of the result, or None for that of the photo.

    Raises:
        UsageError: the photo's name does not indicate its format.
    """
    pure = PurePosixPath(name)
    if of_suffix(pure.suffix) is None and format is None:
        raise UsageError(f"the name '{name}' does not say the picture's format: choose one for the result")
    return fitting(picture_name(pure, format))  # pyright: ignore[reportArgumentType]


def clip_result(name: str) -> str:
    """Returns the name of a clip's result: ``walk.rectified.mp4``.

    Raises:
        UsageError: the clip's name does not indicate its format.
    """
    pure = PurePosixPath(name)
    if not _FILM.fullmatch(pure.suffix):
        raise UsageError(f"the name '{name}' does not say what kind of film it is: give it an extension such as .mp4")
    result = f"{pure.stem}{RECTIFIED}{pure.suffix}"
    if is_pattern(result):  # FFmpeg would write an image sequence, x00001.mp4 ...
        result = result.replace("%", "_")
    return fitting(result)


def motion_name(name: str) -> str:
    """Returns the name of a photo's motion file: ``street.json``."""
    ending = ".json"
    return _cut(PurePosixPath(name).stem, MOST_BYTES - len(ending)) + ending


def free_name(folder: Path, name: str, archive: Path | None = None) -> Path:
    """Returns an unused path for a result in a folder: ``a.rectified.jpg``, or else ``a.rectified-2.jpg``.

    Args:
        folder: folder of the result.
        name: preferred name of the result.
        archive: zip file in which the name must be unused, too.
    """
    most, occupied, number = _most_bytes(folder), _names_in(archive), 1
    path = folder / fitting(name, most=most)
    while _comparable(path.name) in occupied or path.exists() or path.is_symlink():
        number += 1
        path = folder / fitting(name, f"-{number}", most)
    return path


def fitting(result: str, number: str = "", most: int = MOST_BYTES) -> str:
    """Adds a number to the name of a result, and shortens it by whole characters to fit the file system.

    Args:
        result: name such as ``street.rectified.jpg``.
        number: text to insert before the suffix, such as ``-2``.
        most: longest name in UTF-8 [bytes].
    """
    stem, mark, ending = result.rpartition(RECTIFIED)
    tail = f"{mark}{number}{ending}"
    return _cut(stem, most - len(tail.encode())) + tail


def _cut(text: str, most: int) -> str:
    """Truncates a text to a number of bytes in UTF-8, without splitting accents and the like from their letters."""
    end = len(text.encode()[: max(most, 0)].decode("utf-8", "ignore"))
    while 0 < end < len(text) and (_continues(text[end]) or text[end - 1] == _JOINER):
        end -= 1
    return text[:end] if end == len(text) else text[:end].rstrip(" .")


def _continues(character: str) -> bool:
    """Returns whether a character extends the previous one: accents, vowel signs, joined emoji, Korean syllables."""
    return unicodedata.category(character)[0] == "M" or character == _JOINER or "\u1160" <= character <= "\u11ff"


def _most_bytes(folder: Path) -> int:
    try:
        return min(os.pathconf(folder, "PC_NAME_MAX"), MOST_BYTES)
    except (AttributeError, OSError, ValueError):  # Windows, and file systems that do not report it
        return MOST_BYTES


def _names_in(archive: Path | None) -> set[str]:
    if archive is None or not archive.exists():
        return set()
    with zipfile.ZipFile(archive) as packed:
        return {_comparable(name) for name in packed.namelist()}


def _comparable(name: str) -> str:
    """Normalises a name, so that names that some file systems treat as identical are equal."""
    return unicodedata.normalize("NFC", name).casefold()
