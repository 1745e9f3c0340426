"""Places of photos and results: files, or objects behind an fsspec URL; no output of a run falls on an input.

A place is a ``Path`` or, for a URL, the ``UPath`` of universal-pathlib, which has the same interface: name, suffix,
parent, ``/`` and so on work for both. Only this file and ``journal.py`` distinguish the two in a batch: files are
written under a temporary name and renamed, objects uploaded with a single put, which stores make visible atomically.
Errors of any store become one line here.

Importing universal-pathlib takes 10 ms and its first URL another 70 ms, so it is imported only when a URL is used.

fsspec chains URLs: ``simplecache::s3://b/a.jpg`` is an object behind a cache, ``dir://a.jpg::file:///d`` a file in a
folder, ``zip://a.jpg::file:///d/b.zip`` a file in an archive. One file can have any number of such names, so names are
never compared, only the files that they lead to.
"""

from __future__ import annotations

import os
import posixpath
import stat
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypeAlias

from unshutter import version
from unshutter.errors import UnshutterError, UsageError
from unshutter.storage import files
from unshutter.storage.files import Times, check_target, exists, remove_leftovers, written_whole
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from upath import UPath


Place: TypeAlias = "Path | UPath"

# Fields of object metadata, in different stores, that change with the content.
_STAMPS = ("ETag", "etag", "md5Hash", "generation", "mtime", "LastModified", "last_modified", "updated", "created")


def place(text: str | os.PathLike[str]) -> Place:
    """Parses a path or an fsspec URL from the user; a URL of a file on this machine becomes that file's path."""
    if not isinstance(text, str) or "://" not in text:
        return Path(text)
    if (file := local_file(text)) is not None:
        return file
    with _one_line(text):
        from upath import UPath

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a store was not tested
            return UPath(text.rstrip("/"))


def absolute(where: Place) -> Place:
    """Returns the place in a form that other processes and machines can find."""
    return Path(os.path.abspath(where)) if isinstance(where, Path) else where


def way(folder: Place, where: Place) -> PurePosixPath | None:
    """Returns the relative path from a folder to a place in it (or the folder itself); None if it is elsewhere."""
    folder = absolute(folder)
    where = absolute(where)
    if isinstance(folder, Path) != isinstance(where, Path):
        return None
    try:
        return PurePosixPath(where.relative_to(folder).as_posix())  # type: ignore[arg-type]
    except ValueError:
        return None


def is_folder(where: Place) -> bool:
    """Whether the place is an existing folder, or a prefix (with a slash) of object names."""
    with _one_line(where):
        return where.is_dir()


def names_below(
    folder: Place, leave_out: Place | None, unreadable: list[tuple[str, str]]
) -> Iterator[tuple[PurePosixPath, str]]:
    """Yields the files below a folder, relative to it, in order, and the reason for skipping each; empty for none.

    A folder to leave out is skipped, unless it is the folder itself. Folders that cannot be read are added to
    ``unreadable``, with the error.
    """
    if not isinstance(folder, Path):
        left_out = (way(folder, leave_out) if leave_out is not None else None) or PurePosixPath("..")
        skipped = left_out.parts != ()
        yield from ((name, "") for name in objects_below(folder) if not (skipped and name.is_relative_to(left_out)))
        return
    results = os.path.realpath(leave_out) if isinstance(leave_out, Path) else None
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


def objects_below(folder: UPath) -> list[PurePosixPath]:
    """Lists all objects below a folder, relative to it, sorted."""
    with _one_line(folder):
        folder.fs.invalidate_cache()  # others may have written there
        root = folder.path.rstrip("/")
        paths = sorted(folder.fs.find(folder.path))
    return [PurePosixPath(path[len(root) :].lstrip("/")) for path in paths]


def fingerprint(where: Place) -> str | None:
    """Returns a string that changes with the content: size and time, or the store's metadata; None if none."""
    if isinstance(where, Path):
        try:
            status = where.stat()
        except (OSError, ValueError):
            return None
        return f"{status.st_size}:{status.st_mtime_ns}"
    with _one_line(where):
        try:
            info = where.fs.info(where.path)
        except FileNotFoundError:
            return None
    stamps = [str(info[name]) for name in _STAMPS if info.get(name) is not None]
    return ":".join([str(info.get("size")), *stamps[:1]])


def read_place(where: Place) -> bytes:
    """Reads all bytes of a file or an object."""
    with _one_line(where):
        return where.read_bytes()


def write_place(
    data: bytes, target: Place, overwrite: bool = True, mode_of: Place | None = None, times_ns: Times | None = None
) -> None:
    """Writes a file or an object atomically; without ``overwrite``, existing contents must be identical.

    A new file can get the permissions of another one, and times; objects cannot.
    """
    if isinstance(target, Path):
        with written_whole(target, overwrite, mode_of if isinstance(mode_of, Path) else None, times_ns) as part:
            part.write_bytes(data)
        return
    if not overwrite and fingerprint(target) is not None:
        if read_place(target) != data:
            raise exists(target)
        return
    with _one_line(target):
        target.fs.pipe_file(target.path, data)


def digest(where: Place) -> str | None:
    """Returns a hash of the contents of a file or an object; None if there is neither."""
    if isinstance(where, Path):
        return files.digest(where)
    return files.new_hash(read_place(where)).hexdigest() if fingerprint(where) is not None else None


def remove(where: Place) -> None:
    """Removes a file or object written by unshutter; failures are ignored."""
    with suppress(OSError, UnshutterError), _one_line(where):
        where.unlink(missing_ok=True)


def make_folder(folder: Place) -> None:
    """Creates a folder and its parents; object stores do not need them."""
    if isinstance(folder, Path):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnshutterError(f"cannot make folder {{folder}}: {error.strerror}", folder=folder) from None


def check_place(target: Place, overwrite: bool) -> None:
    """Checks a file as :func:`unshutter.storage.files.check_target` does, or an object."""
    if isinstance(target, Path):
        check_target(target, overwrite)
    elif not overwrite and fingerprint(target) is not None:
        raise exists(target)


@contextmanager
def _one_line(where: Place | str) -> Iterator[None]:
    """Converts any exception into an UnshutterError of one line that names the place."""
    try:
        yield
    except UnshutterError:
        raise
    except ImportError as error:
        raise UnshutterError(
            f"{{file}} needs a package that is missing: {error} ({version.extra('dask')})", file=where
        ) from None
    except FileNotFoundError:
        raise UnshutterError("cannot reach {file}: no such file or folder", file=where) from None
    except Exception as error:  # each store has its own exceptions
        raise UnshutterError(
            f"cannot reach {{file}}: {' '.join(str(error).split()) or type(error).__name__}", file=where
        ) from None


_LOCAL = ("file", "local")
_CACHES = ("simplecache", "filecache", "blockcache", "cached")  # caches use the names of the files behind them


def local_file(url: str) -> Path | None:
    """Returns the file on this machine that a URL stands for; None if it is elsewhere, or inside another file."""
    *links, last = url.split("::")
    path = _end(last)
    for link in reversed(links):
        protocol, _, name = link.partition("://")
        if path is None:
            break
        if protocol in _CACHES:
            path = Path(name) if name else path
        else:
            path = path / name.lstrip("/") if protocol == "dir" else None
    return path


def file_below(url: str) -> Path | None:
    """Returns the file on this machine that contains a URL's bytes, such as an archive; None if they are elsewhere."""
    return local_file(url) or _end(url.split("::")[-1])


def object_behind(where: UPath) -> tuple[str, str]:
    """Resolves a URL to the kind of store and the name in it."""
    from fsspec.implementations.dirfs import DirFileSystem

    name = where.path
    store = where.fs
    while (inner := getattr(store, "fs", None)) is not None:  # a cache or a folder
        name = posixpath.join(store.path, name.lstrip("/")) if isinstance(store, DirFileSystem) else name
        store = inner
    return type(store).__name__, posixpath.normpath(name).lstrip("/")


def _end(link: str) -> Path | None:
    """Returns the file named by the last link of a chain; None if it is elsewhere."""
    protocol, named, path = link.partition("://")
    if not named:
        return Path(link)
    return Path(path) if protocol in _LOCAL else None


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
        reads: Iterable[Place | Opened | None] = (),
        folders: Iterable[Place | None] = (),
    ):
        named = [value for each in options for _, value in _values(each, "input")]
        inputs = [each for each in (*reads, *named) if each is not None]
        redirected = Opened.behind(sys.stdin)  # the file that standard input comes from, if it is one
        self._opened = [each for each in (*inputs, redirected) if isinstance(each, Opened)]
        self._inputs = [each.path if isinstance(each, Opened) else each for each in inputs]
        self._folders = [each for each in folders if isinstance(each, Path)]
        self._looked_at: set[Place] = set()  # folders without links in their paths
        self._outputs: dict[_Name, str] = {}
        self._real_folder = cache(os.path.realpath)  # cached: most files share a few folders
        for flag, value in (pair for each in options for pair in _values(each, "output")):
            self.writes(flag, value)
            self.check(value)

    def writes(self, what: str, *targets: Place | None) -> None:
        """Adds outputs of one purpose, which differ from each other; :meth:`check` follows before writing."""
        for target in targets:
            for name in self._names(target) if target is not None else ():
                # regardless of case, as on some file systems
                other = self._outputs.setdefault(name.casefold() if isinstance(name, str) else name, what)
                if other != what:
                    raise UsageError(f"{target} would be both {other} and {what}: choose another name")

    def check(self, target: Place) -> None:
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

    def check_folder(self, folder: Place) -> None:
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

    def prepare(self, targets: Iterable[Place]) -> None:
        """Creates the folders that the user named, or those in them, and removes files left there by killed runs."""
        for folder in dict.fromkeys(target.parent for target in targets):
            try:
                self.check_folder(folder)
            except UnshutterError:  # reported by the check of each target
                continue
            if any(way(named, folder) is not None for named in self._folders):
                make_folder(folder)
            if isinstance(folder, Path):
                remove_leftovers(folder)

    def _is_input(self, target: Place) -> bool:
        if isinstance(target, Path):
            if not os.path.lexists(target):
                return False
            moved = any(each.is_at(target) for each in self._opened)
            return moved or not self._input_names.isdisjoint(self._names(target))
        archive = file_below(str(target))
        return object_behind(target) in self._input_names or (archive is not None and self._is_input(archive))

    @cached_property
    def _input_names(self) -> set[_Name]:
        """Names of the inputs, and of the archives that contain inputs."""
        archives = [file_below(str(each)) for each in self._inputs if not isinstance(each, Path)]
        return {name for each in (*self._inputs, *archives) if each is not None for name in self._names(each)}

    def _names(self, where: Place) -> Iterator[_Name]:
        """Yields everything by which a file is recognised; for a link, its own name and those of the file behind it."""
        if not isinstance(where, Path):
            yield object_behind(where)
            return
        path = os.path.join(self._real_folder(where.parent), where.name)
        yield os.path.normcase(path)
        if os.path.islink(path):
            yield os.path.normcase(os.path.realpath(path))
        with suppress(OSError, ValueError):
            status = os.stat(path)
            if status.st_ino:  # some file systems have none
                yield status.st_dev, status.st_ino


def _values(options: DataclassInstance, names: str) -> Iterator[tuple[str, Place]]:
    """Yields flag and value of the options that name inputs or outputs, including those of groups."""
    for each in fields(options):
        value = getattr(options, each.name)
        if is_dataclass(type(value)):
            yield from _values(value, names)
        elif each.metadata.get("names") == names and value is not None:
            for one in value if isinstance(value, list) else [value]:
                yield f"--{each.name.rstrip('_').replace('_', '-')}", place(one)
