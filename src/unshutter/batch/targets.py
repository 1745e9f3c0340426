"""Assigns each result of a batch a place of its own."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from unshutter.batch.inputs import FILM_SUFFIXES, PHOTO_SUFFIXES, RECTIFIED, Inputs
from unshutter.errors import UsageError
from unshutter.photo.formats import WRITTEN, of_suffix
from unshutter.storage.places import Place, place

# Names with these extensions are meant as files, even if a folder is needed.
_FILE_SUFFIXES = {*PHOTO_SUFFIXES, *FILM_SUFFIXES, ".json", ".gif", ".bmp", ".jp2", ".jxl", ".psd", ".mpo", ".zip"}


def picture_name(photo: Place, format: str | None = None, keep: bool = False) -> str:
    """Returns the name of a photo's result: ``a.jpg`` -> ``a.rectified.jpg``.

    A result in another format keeps the whole name, ``a.heic`` -> ``a.heic.rectified.avif``, because cameras write
    ``a.jpg`` next to it.

    Args:
        photo: the photo.
        format: format of the result; by default the photo's, or the output format for a photo in a read-only format.
        keep: whether to keep the name: ``a.jpg`` -> ``a.jpg``, and in another format ``a.heic`` -> ``a.avif``.
    """
    own = of_suffix(photo.suffix)
    kind = format or (own.written_as if own else "")
    same = not kind or (own and kind == own.name)
    if keep:
        return photo.name if same else f"{photo.stem}{WRITTEN[kind].suffixes[0]}"
    if same:
        return f"{photo.stem}{RECTIFIED}{photo.suffix}"
    return f"{photo.name}{RECTIFIED}{WRITTEN[kind].suffixes[0]}"


def motion_names(inputs: Inputs) -> Callable[[Place], str]:
    """Returns a function that names photos' motion files: ``a.jpg`` -> ``a.json``; ``a.heic`` -> ``a.heic.json``.

    If ``a.jpg`` and ``a.png`` go to the same folder, both keep their whole names, as in ``a.jpg.json``, regardless of
    their order. Names are compared case-insensitively, as some file systems do.
    """
    asked = Counter(
        (inside, name.casefold())
        for photo, inside in inputs.photos.items()
        for name in {_short_name(photo), f"{photo.name}.json"}
    )

    def name(photo: Place) -> str:
        short = _short_name(photo)
        return short if asked[inputs.photos[photo], short.casefold()] == 1 else f"{photo.name}.json"

    return name


def _short_name(photo: Place) -> str:
    own = of_suffix(photo.suffix)
    return f"{photo.stem if own is None or own.name in WRITTEN else photo.name}.json"


def plan_targets(inputs: Inputs, output: str | os.PathLike[str], name: Callable[[Place], str]) -> dict[Place, Place]:
    """Assigns each photo's result a place: a file, or one in a folder that mirrors the folders of photos.

    Raises:
        UsageError: two photos would share a result, or a folder is needed but there is a file.
    """
    goal = place(output)
    if not is_folder(goal, inputs.many):
        return {next(iter(inputs.photos)): goal}
    check_is_folder(goal, output, "several photos need")
    targets = {photo: goal / (inside / name(photo)) for photo, inside in inputs.photos.items()}
    return _all_different(targets)


def mask_targets(inputs: Inputs, folder: str, pictures: dict[Place, Place]) -> dict[Place, Place]:
    """Assigns each result's mask a place: the picture's whole name plus ``.png``, as COLMAP expects.

    Raises:
        UsageError: there is a file instead of the folder.
    """
    goal = place(folder)
    check_is_folder(goal, folder, "masks need")
    return {photo: goal / inside / f"{pictures[photo].name}.png" for photo, inside in inputs.photos.items()}


def next_to_photos(inputs: Inputs, name: Callable[[Place], str]) -> dict[Place, Place]:
    """Assigns each result a place next to its photo."""
    return _all_different({photo: photo.with_name(name(photo)) for photo in inputs.photos})


def is_folder(goal: Place, many: bool) -> bool:
    """Whether a place is a folder for results rather than a single result; a name without extension means a folder."""
    return many or not goal.suffix or (isinstance(goal, Path) and goal.is_dir())


def check_is_folder(goal: Place, named: str | os.PathLike[str], what: str) -> None:
    """Checks that a place is meant as a folder.

    Args:
        goal: the place.
        named: as the user wrote it; a trailing slash means a folder.
        what: the contents, with a verb for the message: ``masks need``.

    Raises:
        UsageError: there is a file, or the name is that of a file.
    """
    there = isinstance(goal, Path) and goal.is_dir()
    if isinstance(goal, Path) and goal.exists() and not there:
        raise UsageError(f"{what} a folder to go to, but {goal} is a file")
    if goal.suffix.lower() in _FILE_SUFFIXES and not there and not os.fspath(named).endswith(("/", os.sep)):
        raise UsageError(f"{what} a folder to go to, but {goal.name} is the name of a file: leave out {goal.suffix}")


def check_named_once(named: Iterable[tuple[str, Place | None]]) -> None:
    """Checks that no place was named for two purposes, one of which would overwrite the other.

    Args:
        named: (purpose, place) of outputs, and of inputs that are not photos.

    Raises:
        UsageError: a place was named twice.
    """
    real_folder = cache(os.path.realpath)  # cached: most files share a few folders
    taken: dict[str, str] = {}
    for what, where in named:
        if where is not None:
            path = os.path.join(real_folder(where.parent), where.name) if isinstance(where, Path) else str(where)
            if taken.setdefault(path, what) != what:
                raise UsageError(f"{where} was named twice, for {taken[path]} and for {what}: choose another name")


def _all_different(targets: dict[Place, Place]) -> dict[Place, Place]:
    taken: dict[Place, Place] = {}
    for photo, target in targets.items():
        if target in taken:
            raise UsageError(f"{photo} and {taken[target]} would both be written to {target}")
        taken[target] = photo
    return targets
