"""Which files are meant, and where the result of each goes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo.formats import FORMATS, WRITTEN, of_suffix
from unshutter.storage import places
from unshutter.storage.places import Place, objects_below, place, way

PHOTO_SUFFIXES = {suffix for format in FORMATS.values() for suffix in format.suffixes}
RECTIFIED = ".rectified"


@dataclass
class Inputs:
    """The photos that were meant.

    Attributes:
        photos: each with its folder inside the given one (``.`` for photos named one by one).
        many: whether several were meant.
        unreadable: folders that could not be looked into, and why.
    """

    photos: dict[Place, PurePosixPath] = field(default_factory=dict)
    many: bool = False
    unreadable: list[tuple[str, str]] = field(default_factory=list)


def find_photos(given: Iterable[str | os.PathLike[str]], leave_out: Place | None = None) -> Inputs:
    """The photos that were meant, folders expanded with all that is below them, sorted.

    In folders are passed over: hidden files and folders, links to folders, pictures that unshutter wrote beside
    their originals (``*.rectified.*``), and the folder that results go to.

    Args:
        given: photos and folders; paths or fsspec URLs.
        leave_out: folder that results go to.

    Raises:
        UnshutterError: a folder without photos.
        UsageError: nothing given.
    """
    inputs = Inputs()
    for source in map(place, given):
        may_be_folder = isinstance(source, Path) or not source.suffix  # asking a store takes a while
        if not (may_be_folder and places.is_folder(source)):
            inputs.photos.setdefault(source, PurePosixPath())
            continue
        inputs.many = True
        inside = _in_folder(source, leave_out, inputs.unreadable)
        meant = [relative for relative in inside if _is_meant(relative)]
        if not meant:
            raise UnshutterError(f"no photos in folder {source} (looked for {', '.join(sorted(PHOTO_SUFFIXES))})")
        for relative in meant:
            inputs.photos.setdefault(source / relative, relative.parent)
    if not inputs.photos:
        raise UsageError("no photo given")
    inputs.many = inputs.many or len(inputs.photos) > 1
    return inputs


def _is_meant(relative: PurePosixPath) -> bool:
    hidden = any(part.startswith(".") for part in relative.parts)
    return relative.suffix.lower() in PHOTO_SUFFIXES and not hidden and not relative.stem.endswith(RECTIFIED)


def _in_folder(folder: Place, leave_out: Place | None, unreadable: list[tuple[str, str]]) -> list[PurePosixPath]:
    """All files below a folder, relative to it, in order."""
    if not isinstance(folder, Path):
        results = way(folder, leave_out) if leave_out is not None else None
        if results == PurePosixPath():
            results = None  # beside the originals: known by their names
        return [name for name in objects_below(folder) if results is None or not name.is_relative_to(results)]
    found: list[PurePosixPath] = []
    results = os.path.realpath(leave_out) if isinstance(leave_out, Path) else None
    if results == os.path.realpath(folder):
        results = None  # beside the originals: known by their names

    def note(error: OSError) -> None:
        unreadable.append((str(error.filename), error.strerror or str(error)))

    for top, folders, files in os.walk(folder, onerror=note):
        folders[:] = sorted(f for f in folders if not f.startswith(".") and os.path.realpath(Path(top, f)) != results)
        relative = PurePosixPath(Path(top).relative_to(folder).as_posix())
        found += [relative / name for name in sorted(files) if Path(top, name).is_file()]
    return found


def picture_name(photo: Place, format: str | None = None) -> str:
    """Name of a photo's result: ``a.jpg`` -> ``a.rectified.jpg``.

    A result in another format keeps the whole name, ``a.heic`` -> ``a.heic.rectified.avif``: cameras write ``a.jpg``
    beside it.

    Args:
        photo: which photo.
        format: of the result; by default the photo's, or the one that follows a format that is only read.
    """
    own = of_suffix(photo.suffix)
    wanted = format or (own.written_as if own else "")
    if not wanted or (own and wanted == own.name):
        return f"{photo.stem}{RECTIFIED}{photo.suffix}"
    return f"{photo.name}{RECTIFIED}{WRITTEN[wanted].suffixes[0]}"


def motion_name(photo: Place) -> str:
    """Name of a photo's motion file: ``a.jpg`` -> ``a.json``; ``a.heic`` -> ``a.heic.json``."""
    own = of_suffix(photo.suffix)
    return f"{photo.stem if own is None or own.name in WRITTEN else photo.name}.json"


def plan_targets(inputs: Inputs, output: str | os.PathLike[str], name: Callable[[Place], str]) -> dict[Place, Place]:
    """Where each photo's result goes: a file, or a folder that takes on the structure of the given ones.

    Raises:
        UsageError: two photos would share a result, or a folder is wanted where there is a file.
    """
    goal = place(output)
    if not is_folder(goal, inputs.many):
        return {next(iter(inputs.photos)): goal}
    if isinstance(goal, Path) and goal.exists() and not goal.is_dir():
        raise UsageError(f"several photos need a folder to go to, but {goal} is a file")
    targets = {photo: goal / (inside / name(photo)) for photo, inside in inputs.photos.items()}
    return _all_different(targets)


def beside(inputs: Inputs, name: Callable[[Place], str]) -> dict[Place, Place]:
    """Results beside their photos."""
    return _all_different({photo: photo.with_name(name(photo)) for photo in inputs.photos})


def is_folder(goal: Place, many: bool) -> bool:
    """Whether results go into it rather than become it; a name without an ending is meant as a folder."""
    return many or not goal.suffix or (isinstance(goal, Path) and goal.is_dir())


def _all_different(targets: dict[Place, Place]) -> dict[Place, Place]:
    taken: dict[Place, Place] = {}
    for photo, target in targets.items():
        if target in taken:
            raise UsageError(f"{photo} and {taken[target]} would both be written to {target}")
        taken[target] = photo
    return targets
