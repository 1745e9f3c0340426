"""The next photo is read and decoded while the one before is worked on."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

from unshutter.batch.places import Place, open_photo
from unshutter.photo import Photo


class ReadAhead:
    """Reads and decodes the next photo while the one before is worked on; two are held at a time."""

    def __init__(self, files: list[Place], max_pixels: int):
        self._max_pixels = max_pixels
        self._files = iter(files)
        self._left = set(files)
        self._reader = ThreadPoolExecutor(1)
        self._coming: dict[Place, Future[Photo]] = {}
        self._start_next()

    def photo(self, path: Place) -> Photo:
        """The photo, decoded. Those that come in the order of the list are read ahead; it may leave some out."""
        if path not in self._coming:
            if path not in self._left:
                return _decoded(path, self._max_pixels)
            self._coming.clear()
            self._start_next(path)
        coming = self._coming.pop(path)
        self._start_next()
        return coming.result()

    def _start_next(self, wanted: Place | None = None) -> None:
        for path in self._files:
            self._left.discard(path)
            if wanted in (None, path):
                self._coming[path] = self._reader.submit(_decoded, path, self._max_pixels)
                break


def _decoded(path: Place, max_pixels: int) -> Photo:
    photo = open_photo(path, max_pixels)
    _ = photo.image  # decoded here, kept there
    return photo
