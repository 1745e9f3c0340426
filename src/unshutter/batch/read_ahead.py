"""The next photo is opened, decoded and looked at while the one before is warped and written."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from unshutter import early
from unshutter.errors import UnshutterError
from unshutter.options import MAX_PIXELS
from unshutter.photo import Photo
from unshutter.storage.places import Place, open_photo

Look = Callable[[Photo, Executor], None]


class ReadAhead:
    """Opens and decodes the next photo while the one before is worked on; two are held at a time.

    Args:
        files: the photos.
        max_pixels: see ``Photo.open``.
        grey, whole: what will be wanted of them, see ``Photo.start_decoding``.

    Attributes:
        look: begins, in the executor, with what else is wanted of photos that are read from now on.
    """

    def __init__(self, files: list[Place], max_pixels: int, grey: bool = True, whole: bool = True):
        self._max_pixels, self._wanted = max_pixels, (768 if grey else None, whole)
        self._files = iter(files)
        self._left = set(files)
        self._reader, self._looker = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        self._coming: dict[Place, Future[Photo]] = {}
        self.look: Look | None = None
        self._start_next()

    def photo(self, path: Place) -> Photo:
        """The photo, open, its pixels on the way.

        Those that come in the order of the list are read ahead; it may leave some out.
        """
        if path not in self._coming:
            if path not in self._left:
                return self._opened(path)
            self._coming.clear()
            self._start_next(path)
        coming = self._coming.pop(path)
        self._start_next()
        return coming.result()

    def _start_next(self, wanted: Place | None = None) -> None:
        for path in self._files:
            self._left.discard(path)
            if wanted in (None, path):
                self._coming[path] = self._reader.submit(self._opened, path)
                break

    def _opened(self, path: Place) -> Photo:
        begun = early.take(path) if isinstance(path, Path) and self._max_pixels == MAX_PIXELS else None
        photo = begun or open_photo(path, self._max_pixels)
        photo.start_decoding(self._reader, *self._wanted)
        if self.look is not None:
            with suppress(UnshutterError):  # told again where it is wanted
                self.look(photo, self._looker)
        return photo
