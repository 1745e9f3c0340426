"""A photo that is decoded, and its motion looked for, before anybody has asked: the command line is still imported.

Decoding and estimating hardly need Python, imports need one processor: side by side, a single photo is ready sooner.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from unshutter.default_estimator import DEFAULT_ESTIMATOR
from unshutter.errors import UnshutterError
from unshutter.photo.libvips import libvips
from unshutter.photo.photo import Photo

_begun: dict[tuple[Path, int, int], Future[Photo]] = {}  # one at most


def begin(path: Path, estimator: str | None = None) -> None:
    """Opens the photo and decodes it in a thread; what goes wrong is told when it is opened again.

    Args:
        path: the photo.
        estimator: which is likely to be asked for its motion, and told nothing about it; None: none.
    """
    libvips()  # here: two threads that import at once mostly wait for each other
    reader = ThreadPoolExecutor(1)
    _begun.clear()
    photo = _begun[_as_it_is(path)] = reader.submit(_opened, path, estimator)
    reader.shutdown(wait=False)
    import numpy  # noqa: F401 (what the decoder needs next)

    if estimator is not None:
        from unshutter.estimators import ahead
        from unshutter.estimators.base import View

        looker = ThreadPoolExecutor(1)
        with suppress(UnshutterError):
            ahead.of(estimator).begin(View(photo.result()), looker)
            ahead.of(estimator).prepare()  # here: a third thread would be one too many for two processors
        looker.shutdown(wait=False)


def take(path: Path) -> Photo | None:
    """The photo, its pixels on the way, if it was begun, could be opened, and is still the same; given away once."""
    begun = _begun.pop(_as_it_is(path), None) if _begun and path.is_file() else None
    return None if begun is None or begun.exception() else begun.result()


def _opened(path: Path, estimator: str | None) -> Photo:
    photo = Photo.open(path)
    # For the default's sake the rest waits until it is asked for: decoding all would hold up what it does alone.
    is_default = estimator == DEFAULT_ESTIMATOR
    photo.start_decoding(grey=is_default, whole=not is_default)
    return photo


def _as_it_is(path: Path) -> tuple[Path, int, int]:
    state = path.stat()
    return path, state.st_size, state.st_mtime_ns
