"""The next photo is opened and decoded while the one before is worked on."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from unshutter.batch.places import Place, open_photo
from unshutter.photo import Photo, early
from unshutter.photo.photo import MAX_PIXELS


class ReadAhead:
    """Opens and decodes the next photo while the one before is worked on; two are held at a time.

    Args:
        files: the photos.
        max_pixels: see ``Photo.open``.
        whole: all their pixels will be wanted; otherwise only a grey copy.
    """

    def __init__(self, files: list[Place], max_pixels: int, whole: bool = True):
        self._max_pixels, self._whole = max_pixels, whole
        self._files = iter(files)
        self._left = set(files)
        self._reader = ThreadPoolExecutor(1)
        self._coming: dict[Place, Future[Photo]] = {}
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
        photo.start_decoding(self._reader, self._whole)
        return photo
