"""What a URL leads to once caches and folders are taken out of it: a file of this machine, or an object of a store.

fsspec chains URLs: ``simplecache::s3://b/a.jpg`` is an object behind a cache, ``dir://a.jpg::file:///d`` a file of a
folder, ``zip://a.jpg::file:///d/b.zip`` one in an archive. The same file has any number of such names, so names are
never compared, only what they lead to.
"""

from __future__ import annotations

import posixpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upath import UPath

_LOCAL = ("file", "local")
_CACHES = ("simplecache", "filecache", "blockcache", "cached")  # of the same names as what is behind them


def local_file(url: str) -> Path | None:
    """The file of this machine that a URL stands for; None where it is elsewhere, or inside another file."""
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
    """The file of this machine that a URL's bytes lie in, such as an archive; None where they are elsewhere."""
    return local_file(url) or _end(url.split("::")[-1])


def object_behind(where: UPath) -> tuple[str, str]:
    """What a URL leads to: the kind of store, and the name in it."""
    name = where.path
    store: Any = where.fs
    while (inner := getattr(store, "fs", None)) is not None:  # a cache, or a folder
        name = posixpath.join(store.path, name.lstrip("/")) if "dir" in _protocols(store) else name
        store = inner
    return type(store).__name__, posixpath.normpath(name).lstrip("/")


def _end(link: str) -> Path | None:
    """The file that the last link of a chain names."""
    protocol, named, path = link.partition("://")
    if not named:
        return Path(link)
    return Path(path) if protocol in _LOCAL else None


def _protocols(store) -> tuple[str, ...]:
    return (store.protocol,) if isinstance(store.protocol, str) else tuple(store.protocol)
