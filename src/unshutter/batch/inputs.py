"""Finds the photos named by the user, and records which files were skipped and why."""

from __future__ import annotations

import os
import stat
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo.formats import FORMATS
from unshutter.photo.header import SEVERAL_PICTURES
from unshutter.storage import places
from unshutter.storage.places import Place, objects_below, place, way

PHOTO_SUFFIXES = {suffix for format in FORMATS.values() for suffix in format.suffixes}
FILM_SUFFIXES = frozenset(
    (
        *(".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".3gp", ".3g2"),
        *(".ts", ".mts", ".m2ts", ".mpg", ".mpeg", ".wmv", ".flv"),
    )
)
RECTIFIED = ".rectified"
_OURS = "unshutter-manifest"
_NO_PHOTOS = "no photos"  # reason for skipping files in a folder, as counted in logs


@dataclass
class Inputs:
    """The photos to process.

    Attributes:
        photos: photo -> its folder relative to the given one (``.`` for photos named one by one).
        many: whether the user named several photos or a folder.
        unreadable: (folder, error) of each folder that cannot be read.
        passed_over: files in the given folders that were skipped: reason -> number of files with each extension.
    """

    photos: dict[Place, PurePosixPath] = field(default_factory=dict)
    many: bool = False
    unreadable: list[tuple[str, str]] = field(default_factory=list)
    passed_over: dict[str, Counter[str]] = field(default_factory=dict)

    def pass_over(self, reason: str, name: PurePosixPath) -> None:
        """Records a file that is skipped."""
        self.passed_over.setdefault(reason, Counter())[name.suffix.lower()] += 1

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
        return f"not taken: {'; '.join(text)}" if text else ""


def find_photos(sources: Iterable[str | os.PathLike[str]], leave_out: Place | None = None) -> Inputs:
    """Finds the photos to process, expanding folders recursively; the contents of a folder are sorted.

    Skipped in folders are hidden files and folders, links to folders, pictures that unshutter wrote next to their
    originals (``*.rectified.*``), and the output folder.

    Args:
        sources: photos and folders; paths or fsspec URLs.
        leave_out: the output folder.

    Raises:
        UnshutterError: a folder contains no photos.
        UsageError: there are no sources.
    """
    inputs = Inputs()
    for source in map(place, sources):
        if source.suffix.lower() in FILM_SUFFIXES and not places.is_folder(source):
            raise UsageError(f"{source} is a film, not a photo: unshutter video {source}")
        may_be_folder = isinstance(source, Path) or not source.suffix  # queries to a store are slow
        if not (may_be_folder and places.is_folder(source)):
            inputs.photos.setdefault(source, PurePosixPath())
            continue
        inputs.many = True
        inside = _in_folder(source, leave_out, inputs)
        meant = [relative for relative in inside if _is_meant(relative, inputs)]
        if not meant:
            if inputs.unreadable:
                folder, cause = inputs.unreadable[0]
                raise UnshutterError(f"cannot read folder {folder}: {cause}")
            text = f"no photos in folder {source} (looked for JPEG, PNG, WebP, TIFF, AVIF, HEIC and raw files)"
            raise UnshutterError(f"{text}; {inputs.not_taken()}" if inputs.passed_over else text)
        for relative in meant:
            inputs.photos.setdefault(source / relative, relative.parent)
    if not inputs.photos:
        raise UsageError("no photo given")
    inputs.many = inputs.many or len(inputs.photos) > 1
    return inputs


def _in_words(reason: str, count: int) -> str:
    """Phrases the reason why ``count`` files were skipped."""
    if reason == _NO_PHOTOS:
        return "is not a photo" if count == 1 else "are not photos"
    if reason == "films":
        return f"{'film' if count == 1 else 'films'}, see unshutter video"
    return reason


def _is_meant(relative: PurePosixPath, inputs: Inputs) -> bool:
    suffix = relative.suffix.lower()
    if any(part.startswith(".") for part in relative.parts):
        reason = "hidden"
    elif relative.stem.endswith(RECTIFIED) or relative.parts[0].startswith(_OURS):
        reason = "made by unshutter"
    elif suffix == SEVERAL_PICTURES:
        reason = "with several pictures in one file"
    elif suffix in FILM_SUFFIXES:
        reason = "films"
    elif suffix not in PHOTO_SUFFIXES:
        reason = _NO_PHOTOS
    else:
        return True
    inputs.pass_over(reason, relative)
    return False


def _in_folder(folder: Place, leave_out: Place | None, inputs: Inputs) -> list[PurePosixPath]:
    """Lists all files below a folder, relative to it, in order."""
    if not isinstance(folder, Path):
        results = way(folder, leave_out) if leave_out is not None else None
        if results == PurePosixPath():
            results = None  # results are next to the originals and recognised by their names
        return [name for name in objects_below(folder) if results is None or not name.is_relative_to(results)]
    paths: list[PurePosixPath] = []
    results = os.path.realpath(leave_out) if isinstance(leave_out, Path) else None
    if results == os.path.realpath(folder):
        results = None  # results are next to the originals

    def note(error: OSError) -> None:
        inputs.unreadable.append((str(error.filename), error.strerror or str(error)))

    for top, folders, files in os.walk(folder, onerror=note):
        relative = PurePosixPath(Path(top).relative_to(folder).as_posix())
        folders[:] = sorted(name for name in folders if os.path.realpath(Path(top, name)) != results)
        for name in [*folders]:
            if name.startswith(".") or os.path.islink(Path(top, name)):
                inputs.pass_over("hidden" if name.startswith(".") else "links to folders", PurePosixPath("folder/"))
                folders.remove(name)
        for name in sorted(files):
            if reason := _no_file(Path(top, name)):
                inputs.pass_over(reason, relative / name)
            else:
                paths.append(relative / name)
    return paths


def _no_file(path: Path) -> str:
    """Explains why a path is not a readable file; empty if it is one."""
    try:
        return "" if stat.S_ISREG(path.stat().st_mode) else "pipes or devices"
    except OSError:
        return "links that lead nowhere"
