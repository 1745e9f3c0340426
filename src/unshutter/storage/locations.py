"""Where the files of a run lie: listing folders, and RunFiles, which keeps outputs from falling on inputs."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypeAlias

from unshutter.errors import UnshutterError, UsageError
from unshutter.storage import objects
from unshutter.storage.files import make_folder, remove_leftovers
from unshutter.storage.objects import is_object, path_of
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def absolute(path: Path) -> Path:
    """Returns a path that other processes find, whatever their working folder."""
    return Path(os.path.abspath(path))


def full_name(path: Path) -> str:
    """Returns the absolute path of a file, with slashes, or the URL of an object."""
    return objects.url_of(path) if is_object(path) else absolute(path).as_posix()


def way(folder: Path, path: Path) -> PurePosixPath | None:
    """Returns the relative path from a folder to a file in it (or the folder itself); None if it is elsewhere."""
    try:
        return PurePosixPath(absolute(path).relative_to(absolute(folder)).as_posix())
    except ValueError:
        return None


def is_folder(path: Path) -> bool:
    """Whether a path is an existing folder, or a prefix (with a slash) of names of objects."""
    with objects.one_line(path):
        return objects.is_prefix(path) if is_object(path) else path.is_dir()


def names_below(
    folder: Path, leave_out: Path | None, unreadable: list[tuple[str, str]]
) -> Iterator[tuple[PurePosixPath, str]]:
    """Yields the files below a folder, relative to it, in order, and the reason for skipping each; empty for none.

    A folder to leave out is skipped, unless it is the folder itself. Folders that cannot be read are added to
    ``unreadable``, with the error.
    """
    if is_object(folder):
        results = leave_out if leave_out != folder else None
        yield from ((name, "") for name in objects.objects_below(folder) if results not in (folder / name).parents)
        return
    results = os.path.realpath(leave_out) if leave_out is not None else None
    if results == os.path.realpath(folder):
        results = None

    def note(error: OSError) -> None:
        unreadable.append((str(error.filename), error.strerror or str(error)))

    for top, folders, names in os.walk(folder, onerror=note):
        relative = PurePosixPath(Path(top).relative_to(folder).as_posix())
        folders[:] = sorted(name for name in folders if os.path.realpath(Path(top, name)) != results)
        for name in [*folders]:
            if name.startswith(".") or os.path.islink(Path(top, name)):
                yield PurePosixPath("folder"), "hidden" if name.startswith(".") else "links to folders"
                folders.remove(name)
        for name in sorted(names):
            try:
                reason = "" if stat.S_ISREG(Path(top, name).stat().st_mode) else "pipes or devices"
            except OSError:
                reason = "broken links"
            yield relative / name, reason


_Name: TypeAlias = "str | tuple[int, int] | tuple[str, str]"  # real path, device and inode, or store and object


class RunFiles:
    """The files of one run, known before any work begins.

    All commands use this rule. Two names refer to the same file if they have the same device and inode (independent of
    case and links) or the same real path; URLs are resolved to the file or object that they lead to. Inputs are
    examined only when a result's name exists.

    Inputs and outputs that options name (options/fields.py) are collected, and the outputs checked: UnshutterError if
    one is an input or behind a link, UsageError if two are one file. ``reads`` are other files that the run reads;
    those that were opened already are recognised under any name that they have been given since. So is the file that
    standard input is redirected from.
    Below the output folders that the user named, links are not followed; links above them are part of the name that the
    user chose.
    """

    def __init__(
        self,
        *options: DataclassInstance,
        reads: Iterable[Path | Opened | None] = (),
        folders: Iterable[Path | None] = (),
    ):
        named = [value for each in options for _, value in _values(each, "input")]
        inputs = [each for each in (*reads, *named) if each is not None]
        redirected = Opened.behind(sys.stdin)  # the file that standard input comes from, if it is one
        self._opened = [each for each in (*inputs, redirected) if isinstance(each, Opened)]
        self._inputs = [each.path if isinstance(each, Opened) else each for each in inputs]
        self._folders = [each for each in folders if each is not None]
        self._looked_at: set[Path] = set()  # folders without links in their paths
        self._outputs: dict[_Name, str] = {}
        self._real_folder = cache(os.path.realpath)  # cached: most files share a few folders
        for flag, value in (pair for each in options for pair in _values(each, "output")):
            self.writes(flag, value)
            self.check(value)

    def writes(self, what: str, *targets: Path | None) -> None:
        """Adds outputs of one purpose, which differ from each other; :meth:`check` follows before writing."""
        for target in targets:
            for name in self._names(target) if target is not None else ():
                # regardless of case, as on some file systems
                other = self._outputs.setdefault(name.casefold() if isinstance(name, str) else name, what)
                if other != what:
                    raise UsageError(f"{target} would be both {other} and {what}: choose another name")

    def check(self, target: Path) -> None:
        """Checks a place before it is written."""
        if self._is_input(target):
            raise UnshutterError(
                f"{target} is an original (an input of this run), which is never overwritten: choose another name"
            )
        self.check_folder(target.parent)

    def check_all_in(self, folder: Path) -> None:
        """Checks that a folder that will receive files of arbitrary names contains no input."""
        with suppress(OSError):  # the folder does not exist yet
            for name in sorted(os.listdir(folder)):
                if self._is_input(folder / name):
                    raise UnshutterError(
                        f"{folder / name} is an input of this run: choose another folder for its results"
                    )

    def check_folder(self, folder: Path) -> None:
        """Checks a folder before it is created or written to."""
        if folder in self._looked_at:
            return
        for named in self._folders:
            inside = way(named, folder)
            for part in [inside, *inside.parents][:-1] if inside is not None else ():
                if os.path.islink(named / part):
                    reason = f"{named / part} is a link, and nothing is written through links"
                    raise UnshutterError(f"cannot write to {folder}: {reason}")
        self._looked_at.add(folder)

    def prepare(self, targets: Iterable[Path]) -> None:
        """Creates the folders that the user named, or those in them, and removes files left there by killed runs."""
        for folder in dict.fromkeys(target.parent for target in targets):
            try:
                self.check_folder(folder)
            except UnshutterError:  # reported by the check of each target
                continue
            if any(way(named, folder) is not None for named in self._folders):
                make_folder(folder)
            remove_leftovers(folder)

    def _is_input(self, target: Path) -> bool:
        if is_object(target):
            archive = objects.archive_around(target)
            return objects.identity(target) in self._input_names or (archive is not None and self._is_input(archive))
        if not os.path.lexists(target):
            return False
        moved = any(each.is_at(target) for each in self._opened)
        return moved or not self._input_names.isdisjoint(self._names(target))

    @cached_property
    def _input_names(self) -> set[_Name]:
        """Names of the inputs, and of the archives that contain inputs."""
        archives = [objects.archive_around(each) for each in self._inputs if is_object(each)]
        return {name for each in (*self._inputs, *archives) if each is not None for name in self._names(each)}

    def _names(self, file: Path) -> Iterator[_Name]:
        """Yields everything by which a file is recognised; for a link, its own name and those of the file behind it."""
        if is_object(file):
            yield objects.identity(file)
            return
        path = os.path.join(self._real_folder(file.parent), file.name)
        yield os.path.normcase(path)
        if os.path.islink(path):
            yield os.path.normcase(os.path.realpath(path))
        with suppress(OSError, ValueError):
            status = os.stat(path)
            if status.st_ino:  # some file systems have none
                yield status.st_dev, status.st_ino


def _values(options: DataclassInstance, names: str) -> Iterator[tuple[str, Path]]:
    """Yields flag and value of the options that name inputs or outputs, including those of groups."""
    for each in fields(options):
        value = getattr(options, each.name)
        if is_dataclass(type(value)):
            yield from _values(value, names)
        elif each.metadata.get("names") == names and value is not None:
            for one in value if isinstance(value, list) else [value]:
                yield f"--{each.name.rstrip('_').replace('_', '-')}", path_of(one)
