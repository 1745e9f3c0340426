"""Objects in stores (``s3://bucket/photo.jpg``): the one door between fsspec and a run, which knows only paths.

A run calls an object by a path below a folder that cannot exist. It has a name, an extension and a parent, so results
are named as those of files are. What is read is brought into memory; what is written is a temporary file first
(storage/files.py) and is sent by a single put, which stores make visible as a whole. Any process can find the object of
a path, workers on other machines included. Messages show URLs. Whatever goes wrong in a store becomes one line.

fsspec chains URLs: ``simplecache::s3://b/a.jpg`` is an object behind a cache, ``dir://a.jpg::file:///d`` a file in a
folder, ``zip://a.jpg::file:///d/b.zip`` a file in an archive. One file can have any number of such names, so names are
never compared, only what they lead to.

fsspec is imported only when a URL is used: that takes 30 ms.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, stand_ins
from unshutter.version import extra

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

_OBJECTS = Path(os.path.abspath(os.devnull))  # nothing can exist below it
_BESIDE_NAME = "\t"  # between what precedes an object's name in a URL and what follows it
# fields of object metadata, in different stores, that change with the content
_STAMPS = ("ETag", "etag", "md5Hash", "generation", "mtime", "LastModified", "last_modified", "updated", "created")
_LOCAL = ("file", "local")
_CACHES = ("simplecache", "filecache", "blockcache", "cached")  # caches use the names of the files behind them


def path_of(text: str | os.PathLike[str]) -> Path:
    """Returns the path of a file or folder that the user named, also by a URL.

    Raises:
        UnshutterError: fsspec does not know such a URL, or a package for it is missing.
    """
    if (file := local_file(os.fspath(text))) is not None:
        return file
    protocols, _, rest = os.fspath(text).partition("://")
    named, end, around = rest.partition("::")
    start = f"{protocols}://{named[: len(named) - len(named.lstrip('/'))]}"
    store = _OBJECTS / f"{start}{_BESIDE_NAME}{end}{around}".encode().hex()
    stand_ins[f"{store}/"] = start
    path = store / named.strip("/")
    _located(path)
    return path


def is_object(path: Path) -> bool:
    """Whether a path is that of an object."""
    return _OBJECTS in path.parents


def url_of(path: Path) -> str:
    """Returns the URL of an object."""
    store, *names = path.relative_to(_OBJECTS).parts
    start, _, end = bytes.fromhex(store).decode().partition(_BESIDE_NAME)
    return f"{start}{'/'.join(names)}{end}"


def is_prefix(path: Path) -> bool:
    """Whether a path is that of a folder of objects: a prefix of their names, with a slash."""
    store, name = _located(path)
    with one_line(path):
        return store.isdir(name)


def objects_below(folder: Path) -> list[PurePosixPath]:
    """Lists all objects below a folder, relative to it, sorted."""
    store, name = _located(folder)
    with one_line(folder):
        store.invalidate_cache()  # others may have written there
        paths = sorted(store.find(name))
    root = name.rstrip("/")
    return [PurePosixPath(path[len(root) :].lstrip("/")) for path in paths]


def stamp(path: Path) -> str | None:
    """Returns a string that changes with the content of an object; None if there is no such object."""
    store, name = _located(path)
    with one_line(path):
        try:
            info = store.info(name)
        except FileNotFoundError:
            return None
    stamps = [str(info[field]) for field in _STAMPS if info.get(field) is not None]
    return ":".join([str(info.get("size")), *stamps[:1]])


def read_object(path: Path) -> bytes:
    """Returns the content of an object."""
    store, name = _located(path)
    with one_line(path):
        data = store.cat_file(name)
        assert isinstance(data, bytes)
    return data


def send(data: bytes, path: Path) -> None:
    """Writes an object, as a whole."""
    store, name = _located(path)
    with one_line(path):
        store.pipe_file(name, data)


def remove_object(path: Path) -> None:
    """Removes an object; failures are ignored."""
    with suppress(UnshutterError, FileNotFoundError):
        store, name = _located(path)
        with one_line(path):
            store.rm_file(name)


def identity(path: Path) -> tuple[str, str]:
    """Resolves the path of an object to the kind of store and the name in it."""
    from fsspec.implementations.dirfs import DirFileSystem

    store, name = _located(path)
    while (inner := getattr(store, "fs", None)) is not None:  # a cache or a folder
        name = posixpath.join(store.path, name.lstrip("/")) if isinstance(store, DirFileSystem) else name
        store = inner
    return type(store).__name__, posixpath.normpath(name).lstrip("/")


def archive_around(path: Path) -> Path | None:
    """Returns the file on this machine that contains an object, such as an archive; None if it is elsewhere."""
    return _end(url_of(path).split("::")[-1])


def local_file(text: str) -> Path | None:
    """Returns the file on this machine that a name or URL stands for; None if it is elsewhere, or in another file."""
    *links, last = text.split("::") if "://" in text else [text]
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


def _end(link: str) -> Path | None:
    """Returns the file named by the last link of a chain; None if it is elsewhere."""
    protocol, named, path = link.partition("://")
    if not named:
        return Path(link)
    return Path(path) if protocol in _LOCAL else None


def _located(path: Path) -> tuple[AbstractFileSystem, str]:
    """Returns the store of an object and the name in it."""
    with one_line(path):
        from fsspec.core import url_to_fs

        return url_to_fs(url_of(path))


@contextmanager
def one_line(path: Path) -> Iterator[None]:
    """Converts any exception into an UnshutterError of one line that names the file or object."""
    try:
        yield
    except UnshutterError:
        raise
    except ImportError as error:
        needs = f"{{file}} needs a package that is missing: {error} ({extra('dask')})"
        raise UnshutterError(needs, file=path) from None
    except FileNotFoundError:
        raise UnshutterError("cannot reach {file}: no such file or folder", file=path) from None
    except Exception as error:  # each store has its own exceptions
        cause = " ".join(str(error).split()) or type(error).__name__
        raise UnshutterError(f"cannot reach {{file}}: {cause}", file=path) from None
