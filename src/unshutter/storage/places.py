"""Places of photos and results: files, or objects behind an fsspec URL (``s3://``, ``gs://``, ``memory://``).

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
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeAlias

from unshutter import installation
from unshutter.errors import UnshutterError
from unshutter.storage import plain_files
from unshutter.storage.files import Times, check_target, written_whole

if TYPE_CHECKING:
    from upath import UPath

Place: TypeAlias = "Path | UPath"

# Fields of object metadata, in different stores, that change with the content.
_STAMPS = ("ETag", "etag", "md5Hash", "generation", "mtime", "LastModified", "last_modified", "updated", "created")


def place(text: str | os.PathLike[str]) -> Place:
    """Parses a path or an fsspec URL from the user; a URL of a file on this machine becomes that file's path.

    Raises:
        UnshutterError: universal-pathlib is missing, or does not support the protocol.
    """
    if not isinstance(text, str) or "://" not in text:
        return Path(text)
    if (file := local_file(text)) is not None:
        return file
    with _one_line(text):
        from upath import UPath

        return UPath(text.rstrip("/"))


def absolute(where: Place) -> Place:
    """Returns the place in a form that other processes and machines can find."""
    return Path(os.path.abspath(where)) if isinstance(where, Path) else where


def way(folder: Place, where: Place) -> PurePosixPath | None:
    """Returns the relative path from a folder to a place in it (or the folder itself); None if it is elsewhere."""
    folder, where = absolute(folder), absolute(where)
    if isinstance(folder, Path) != isinstance(where, Path):
        return None
    try:
        return PurePosixPath(where.relative_to(folder).as_posix())  # type: ignore[arg-type]
    except ValueError:
        return None


def is_folder(where: Place) -> bool:
    """Whether the place is an existing folder, or a prefix (with a slash) of object names.

    Raises:
        UnshutterError: the store cannot be reached.
    """
    if isinstance(where, Path):
        return where.is_dir()
    with _one_line(where):
        return where.is_dir()


def objects_below(folder: UPath) -> list[PurePosixPath]:
    """Lists all objects below a folder, relative to it, sorted.

    Raises:
        UnshutterError: the store cannot be reached.
    """
    with _one_line(folder):
        folder.fs.invalidate_cache()  # others may have written there
        root = folder.path.rstrip("/")
        paths = sorted(folder.fs.find(folder.path))
    return [PurePosixPath(path[len(root) :].lstrip("/")) for path in paths]


def fingerprint(where: Place) -> str | None:
    """Returns a string that changes with the content: size and time, or the store's metadata; None if nothing exists.

    Raises:
        UnshutterError: the store cannot be reached.
    """
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
    """Reads all bytes of a file or an object.

    Raises:
        UnshutterError: the place cannot be read.
    """
    with _one_line(where):
        return where.read_bytes()


def write_place(
    data: bytes, target: Place, overwrite: bool = True, mode_of: Place | None = None, times_ns: Times | None = None
) -> None:
    """Writes a file or an object atomically.

    Args:
        data: its contents.
        target: the place.
        overwrite: whether existing contents may be replaced; identical bytes are accepted in any case.
        mode_of: file whose permissions a new file gets.
        times_ns: times for a new file; objects cannot be given any.

    Raises:
        UnshutterError: the place cannot be written, or exists and must not be replaced.
    """
    if isinstance(target, Path):
        with written_whole(target, overwrite, mode_of if isinstance(mode_of, Path) else None, times_ns) as part:
            part.write_bytes(data)
        return
    if not overwrite and fingerprint(target) is not None:
        if read_place(target) != data:
            raise UnshutterError("{target} exists already: use --overwrite to replace it", target=target)
        return
    with _one_line(target):
        target.fs.pipe_file(target.path, data)


def digest(where: Place) -> str | None:
    """Returns a hash of the contents of a file or an object; None if there is neither.

    Raises:
        UnshutterError: the store cannot be reached.
    """
    if isinstance(where, Path):
        return plain_files.digest(where)
    return plain_files.digest_of(read_place(where)) if fingerprint(where) is not None else None


def remove(where: Place) -> None:
    """Removes a file or object written by unshutter; failures are ignored."""
    with suppress(OSError, UnshutterError), _one_line(where):
        where.unlink(missing_ok=True)


def make_folder(folder: Place) -> None:
    """Creates a folder and its parents; object stores do not need them.

    Raises:
        UnshutterError: the system refuses.
    """
    if isinstance(folder, Path):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnshutterError(f"cannot make folder {{folder}}: {error.strerror}", folder=folder) from None


def check_place(target: Place, overwrite: bool, original: Place | None = None) -> None:
    """Checks a file as :func:`unshutter.storage.files.check_target` does, or an object."""
    if isinstance(target, Path):
        return check_target(target, overwrite, original if isinstance(original, Path) else None)
    if target == original:
        raise UnshutterError("{target} is the original, which is never overwritten: choose another name", target=target)
    if not overwrite and fingerprint(target) is not None:
        raise UnshutterError("{target} exists already: use --overwrite to replace it", target=target)


@contextmanager
def _one_line(where: Place | str) -> Iterator[None]:
    """Converts any exception into an UnshutterError of one line that names the place."""
    try:
        yield
    except UnshutterError:
        raise
    except ImportError as error:
        raise UnshutterError(
            f"{{file}} needs a package that is missing: {error} ({installation.extra('dask')})", file=where
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
    name = where.path
    store: Any = where.fs
    while (inner := getattr(store, "fs", None)) is not None:  # a cache or a folder
        name = posixpath.join(store.path, name.lstrip("/")) if "dir" in _protocols(store) else name
        store = inner
    return type(store).__name__, posixpath.normpath(name).lstrip("/")


def _end(link: str) -> Path | None:
    """Returns the file named by the last link of a chain; None if it is elsewhere."""
    protocol, named, path = link.partition("://")
    if not named:
        return Path(link)
    return Path(path) if protocol in _LOCAL else None


def _protocols(store) -> tuple[str, ...]:
    return (store.protocol,) if isinstance(store.protocol, str) else tuple(store.protocol)
