"""A photo that is decoded before anybody has asked for it: while the command line is still being imported.

Decoding needs no Python and imports need one processor: side by side, a single photo is ready sooner.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from unshutter.photo.libvips import libvips
from unshutter.photo.photo import Photo

_begun: dict[tuple[Path, int, int], Future[Photo]] = {}  # one at most


def begin(path: Path) -> None:
    """Opens the photo and decodes it in a thread; what goes wrong is told when it is opened again."""
    libvips()  # here: two threads that import at once mostly wait for each other
    reader = ThreadPoolExecutor(1)
    _begun.clear()
    _begun[_as_it_is(path)] = reader.submit(_opened, path)
    reader.shutdown(wait=False)
    import numpy  # noqa: F401 (what the decoder needs next)


def take(path: Path) -> Photo | None:
    """The photo, its pixels on the way, if it was begun, could be opened, and is still the same; given away once."""
    begun = _begun.pop(_as_it_is(path), None) if _begun and path.is_file() else None
    return None if begun is None or begun.exception() else begun.result()


def _opened(path: Path) -> Photo:
    photo = Photo.open(path)
    photo.start_decoding()
    return photo


def _as_it_is(path: Path) -> tuple[Path, int, int]:
    state = path.stat()
    return path, state.st_size, state.st_mtime_ns
