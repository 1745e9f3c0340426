"""Clips stored as numbered pictures in a folder: ``frames/00001.png``, ``frames/00002.png`` ..."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage.plain_files import check_plain

_NAME = re.compile(r"(.*?)(\d+)(\.[A-Za-z]+)", re.ASCII)
_PATTERN = re.compile(r"((?:[^%]|%%)*)%(?:0?(\d{1,2}))?d((?:[^%]|%%)*)")
ENDINGS = {".png": "png", ".jpg": "mjpeg", ".jpeg": "mjpeg", ".tif": "tiff", ".tiff": "tiff"}


@dataclass(frozen=True)
class PictureSequence:
    """A sequence of pictures that forms a clip.

    Attributes:
        pattern: pattern of their paths, with any other ``%`` written as ``%%``, in the folder's name too.
        first: number of the first one.
    """

    pattern: str
    first: int

    @classmethod
    def at(cls, path: str | os.PathLike[str]) -> PictureSequence | None:
        """Returns the pictures at a path, or None for a film or a missing file.

        Args:
            path: a file, a folder of numbered pictures, or a pattern like ``frames/%05d.png``.

        Raises:
            UnshutterError: there are no pictures, several kinds of them, gaps in their numbers, or one is not a file.
        """
        place = Path(path)
        if place.is_dir():
            folder, (stem, digits, ending) = place, _only_kind(place)
        elif is_pattern(os.fspath(path)) and not place.is_file() and (match := _PATTERN.fullmatch(place.name)):
            folder, digits = place.parent, int(match[2] or 1)
            stem, ending = match[1].replace("%%", "%"), match[3].replace("%%", "%")
        else:
            return None
        numbers = _numbers(folder, stem, digits, ending)
        if not numbers:
            raise UnshutterError(f"there is no picture {place}")
        pattern = f"{_escaped(os.fspath(folder))}{os.sep}{_escaped(stem)}%0{digits}d{_escaped(ending)}"
        for before, after in pairwise(numbers):
            if after != before + 1:
                raise UnshutterError(f"{pattern % (before + 1)} is missing: number the pictures without gaps")
        for number in numbers:
            check_plain(Path(pattern % number))
        return cls(pattern, numbers[0])


def files_of(place: str) -> list[Path]:
    """Returns the files of a clip: the film, or the folder and all numbered pictures that it is read from."""
    path = Path(place)
    if path.is_dir():
        folder, name = path, _NAME
    elif (match := _PATTERN.fullmatch(path.name)) and not path.is_file():
        stem, ending = (re.escape(part.replace("%%", "%")) for part in (match[1], match[3]))
        folder, name = path.parent, re.compile(rf"{stem}\d+{ending}", re.ASCII)
    else:
        return [path]
    names = os.listdir(folder) if folder.is_dir() else []
    return [folder, *(folder / each for each in names if name.fullmatch(each))]


def is_pattern(place: str) -> bool:
    """Whether a name stands for a sequence of pictures."""
    return bool(_PATTERN.fullmatch(Path(place).name))


def _only_kind(folder: Path) -> tuple[str, int, str]:
    """Returns the text before the numbers of a folder's pictures, their fewest digits, and the text after them."""
    numbers: dict[tuple[str, str], list[str]] = {}
    for name in os.listdir(folder):
        if (match := _NAME.fullmatch(name)) and match[3].lower() in ENDINGS:
            numbers.setdefault((match[1], match[3]), []).append(match[2])
    kinds = {(stem, fewest, ending) for (stem, ending), texts in numbers.items() for fewest in _digits(texts)}
    if len(kinds) != 1:
        what = "several kinds of numbered pictures" if kinds else "no numbered pictures (00001.png ...)"
        stem, digits, ending = min(kinds, default=("", 5, ".png"))
        pattern = f"{folder}/{stem.replace('%', '%%')}%0{digits}d{ending}"
        raise UnshutterError(f"{folder} has {what} in it: say which with a pattern, such as {pattern}")
    return kinds.pop()


def _digits(numbers: list[str]) -> set[int]:
    """Returns the padded lengths of numbers: one if 9, 10 or 0009, 10000 follow each other; otherwise all lengths."""
    fewest = min(map(len, numbers))
    filled = any(len(number) > fewest and number.startswith("0") for number in numbers)
    return set(map(len, numbers)) if filled else {fewest}


def _numbers(folder: Path, stem: str, digits: int, ending: str) -> list[int]:
    """Returns the numbers of a folder's pictures with this name, in order."""
    name = re.compile(rf"{re.escape(stem)}(\d{{{digits},18}}){re.escape(ending)}", re.ASCII)
    try:
        numbers = [match[1] for each in os.listdir(folder) if (match := name.fullmatch(each))]
    except OSError:
        return []
    return sorted(int(each) for each in numbers if each == f"{int(each):0{digits}d}")


def _escaped(name: str) -> str:
    return name.replace("%", "%%")


# ---- output ---------------------------------------------------------------------------------------------


def folder_and_name(target: Path, like: PictureSequence | None) -> tuple[Path, str]:
    """Returns the folder of the output pictures and the pattern of their names.

    Args:
        target: a folder, or a pattern.
        like: input pictures, whose names are used if the target is a folder.

    Raises:
        UnshutterError: pictures with this file ending cannot be written.
    """
    if is_pattern(str(target)):
        folder, name = target.parent, target.name
    else:
        folder, name = target, "%05d.png" if like is None else Path(like.pattern).name
    if Path(name).suffix.lower() not in ENDINGS:
        raise UnshutterError(f"cannot write pictures called {name}: choose .png, .jpg or .tif")
    return folder, name
