"""Finds the photos named by the user, and names their results."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path, PurePath, PurePosixPath

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options.picture_formats import BY_NAME, SEVERAL_PICTURES, SUFFIXES, PictureFormat, in_words, of_suffix
from unshutter.photo.boxes import has_gain_map
from unshutter.photo.embedded_video import videos_beside
from unshutter.storage.locations import is_folder, names_below
from unshutter.storage.objects import is_object, path_of

RECTIFIED = ".rectified"
_RESULT = re.compile(rf"(.+){re.escape(RECTIFIED)}(?:-(\d+))?")  # stem of a result
MADE_BY_US = "made by unshutter"
_OURS = "unshutter-manifest"
_NO_PHOTOS = "no photos"
# reasons for skipping files in a folder, as counted in logs
_REASONS: dict[str, Callable[[PurePosixPath], bool]] = {
    "hidden": lambda name: any(part.startswith(".") for part in name.parts),
    MADE_BY_US: lambda name: _RESULT.fullmatch(name.stem) is not None or name.parts[0].startswith(_OURS),
    "with several pictures in one file": lambda name: name.suffix.lower() == SEVERAL_PICTURES,
    "films": lambda name: name.suffix.lower() in VIDEO_FORMATS,
    _NO_PHOTOS: lambda name: name.suffix.lower() not in SUFFIXES,
}


@dataclass
class Inputs:
    """The photos to process."""

    # photo -> its folder relative to the given one (``.`` for photos named one by one)
    photos: dict[Path, PurePosixPath] = field(default_factory=dict)
    many: bool = False  # whether the user named several photos or a folder
    # (folder, error) of each folder that cannot be read
    unreadable: list[tuple[str, str]] = field(default_factory=list)
    # files in the given folders that were skipped: reason -> number of files with each extension
    passed_over: dict[str, Counter[str]] = field(default_factory=dict)

    @property
    def files(self) -> list[Path]:
        """The photos, and where a video next to each may be."""
        beside = (videos_beside(photo) for photo in self.photos if not is_object(photo))
        return [*self.photos, *chain.from_iterable(beside)]

    def pass_over(self, reason: str, suffix: str) -> None:
        """Counts a file as skipped."""
        self.passed_over.setdefault(reason, Counter())[suffix.lower()] += 1

    def counts(self) -> dict[str, int]:
        """Returns the number of skipped files by reason."""
        return {reason: endings.total() for reason, endings in self.passed_over.items()}

    def not_taken(self) -> str:
        """Describes the skipped files in a line; empty if there are none."""
        text = []
        for reason, endings in sorted(self.passed_over.items(), key=lambda item: (-item[1].total(), item[0])):
            names = [ending or "no extension" for ending, _ in endings.most_common(5)]
            more = ", ..." if len(endings) > 5 else ""
            count = endings.total()
            text.append(f"{count} {_in_words(reason, count)} ({', '.join(names)}{more})")
        return f"skipped: {'; '.join(text)}" if text else ""


def find_photos(sources: Iterable[str | os.PathLike[str]], leave_out: Path | None = None) -> Inputs:
    """Finds the photos to process, expanding folders recursively; the contents of a folder are sorted.

    Skipped in folders are hidden files and folders, links to folders, pictures that unshutter wrote next to their
    originals (``*.rectified.*``), and the output folder.
    """
    inputs = Inputs()
    for source in map(path_of, sources):
        if source.suffix.lower() in VIDEO_FORMATS and not is_folder(source):
            raise UsageError(f"{source} is a video, not a photo: use unshutter video {source}")
        may_be_folder = not (is_object(source) and source.suffix)  # queries to a store are slow
        if not (may_be_folder and is_folder(source)):
            inputs.photos.setdefault(source, PurePosixPath())
            continue
        inputs.many = True
        is_empty = True
        for name, reason in names_below(source, leave_out, inputs.unreadable):
            reason = reason or next((why for why, applies in _REASONS.items() if applies(name)), "")
            if reason:
                inputs.pass_over(reason, name.suffix)
            else:
                inputs.photos.setdefault(source / name, name.parent)
                is_empty = False
        if is_empty and inputs.unreadable:
            folder, cause = inputs.unreadable[0]
            raise UnshutterError(f"cannot read folder {folder}: {cause}")
        if is_empty:
            text = f"no photos in folder {source} (looked for {in_words()} files)"
            raise UnshutterError(f"{text}; {inputs.not_taken()}" if inputs.passed_over else text)
    if not inputs.photos:
        raise UsageError("no photo given")
    inputs.many = inputs.many or len(inputs.photos) > 1
    return inputs


def _in_words(reason: str, count: int) -> str:
    """Phrases the reason why ``count`` files were skipped."""
    if reason == _NO_PHOTOS:
        return "is not a photo" if count == 1 else "are not photos"
    if reason == "films":
        return f"{'video' if count == 1 else 'videos'}, see unshutter video"
    return reason


MOST_BYTES = 255  # longest file name in UTF-8; file systems that encrypt names may allow less
_JOINER = "\u200d"


def picture_name(photo: PurePath, format: str | None = None, keep: bool = False) -> str:
    """Returns the name of a photo's result: ``a.jpg`` -> ``a.rectified.jpg``, or its own name if that is kept.

    A result in another format keeps the whole name, ``a.heic`` -> ``a.heic.rectified.avif``, because cameras write
    ``a.jpg`` next to it; a name that is kept changes its extension, ``a.heic`` -> ``a.avif``. Read-only formats have an
    output format by default, see :func:`usual_format`. A photo that is itself a result gets a number:
    ``a.rectified-2.jpg``.
    """
    own = of_suffix(photo.suffix)
    kind = format or (own.written_as if own else "")
    same = not kind or (own and kind == own.name)
    suffix = photo.suffix if same else BY_NAME[kind].suffixes[0]
    if keep:
        return photo.name if same else f"{photo.stem}{suffix}"
    return _marked(photo, photo.stem if same else photo.name, suffix)


def usual_format(photo: Path) -> PictureFormat | None:
    """Returns the format of a photo's result if none is asked for; None if its name tells.

    A HEIC with a gain map becomes a JPEG: its results then are HDR, which an AVIF would lose.
    """
    own = of_suffix(photo.suffix)
    if own is not None and own.name == "heic" and not is_object(photo):
        with suppress(OSError), photo.open("rb") as file:
            return "jpeg" if has_gain_map(file) else None
    return None


def unchanged_name(photo: PurePath, format: str | None = None, keep: bool = False) -> str:
    """Returns the name of a photo that is left unchanged: its own, unless another format is requested.

    Then the whole name is kept, ``a.heic`` -> ``a.heic.jpg``, or only the stem, as by :func:`picture_name`.
    """
    own = of_suffix(photo.suffix)
    if format is None or (own is not None and own.name == format):
        return photo.name
    suffix = BY_NAME[format].suffixes[0]
    return _cut(photo.stem if keep else photo.name, MOST_BYTES - len(suffix)) + suffix


def video_name(video: PurePath) -> str:
    """Returns the name of a video's result: ``walk.mp4`` -> ``walk.rectified.mp4``."""
    return _marked(video, video.stem, video.suffix)


def _marked(source: PurePath, stem: str, suffix: str) -> str:
    """Returns a result's name; if the source is a result itself, it gets the next number instead of a second mark."""
    earlier = _RESULT.fullmatch(source.stem)
    if earlier is None:
        return fitting(f"{stem}{RECTIFIED}{suffix}")
    return fitting(f"{earlier[1]}{RECTIFIED}{suffix}", f"-{int(earlier[2] or 1) + 1}")


def motion_name(stem: str) -> str:
    """Returns the name of a motion file: ``street`` -> ``street.json``."""
    return _cut(stem, MOST_BYTES - len(".json")) + ".json"


def fitting(result: str, number: str = "", most: int = MOST_BYTES) -> str:
    """Adds a number such as ``-2`` to the name of a result, and shortens it to fit the file system.

    Whole characters are cut, until the name has at most ``most`` bytes in UTF-8.
    """
    stem, mark, ending = result.rpartition(RECTIFIED)
    if not mark:  # the name of a photo that is left unchanged
        stem = PurePath(result).stem
        ending = PurePath(result).suffix
    tail = f"{mark}{number}{ending}"
    return _cut(stem, most - _size(tail)) + tail


def _cut(text: str, most: int) -> str:
    """Truncates a text to a number of bytes in UTF-8, without splitting accents and the like from their letters."""
    if _size(text) <= most:
        return text
    # whether each character extends the previous one: accents, vowel signs, joined emoji, Korean syllables
    extends = [unicodedata.category(c)[0] == "M" or c == _JOINER or "\u1160" <= c <= "\u11ff" for c in text]
    end = len(text) - 1
    while end > 0 and (_size(text[:end]) > most or extends[end] or text[end - 1] == _JOINER):
        end -= 1
    return text[:end].rstrip(" .")


def _size(text: str) -> int:
    return len(text.encode("utf-8", "surrogateescape"))  # names of files may have bytes that are not text
