"""The next photo is read and decoded while the one before is worked on."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from unshutter.photo import Photo


class ReadAhead:
    """Reads and decodes the next photo while the one before is worked on; two are held at a time."""

    def __init__(self, files: list[Path]):
        self._files = iter(files)
        self._reader = ThreadPoolExecutor(1)
        self._coming: dict[Path, Future[Photo]] = {}
        self._start_next()

    def photo(self, path: Path) -> Photo:
        """The photo, decoded. Paths must come in the order of the list; they may leave some out."""
        while path not in self._coming:
            self._start_next()
        coming = self._coming[path]
        self._coming.clear()
        self._start_next()
        return coming.result()

    def _start_next(self) -> None:
        path = next(self._files, None)
        if path is not None:
            self._coming[path] = self._reader.submit(_decoded, path)


def _decoded(path: Path) -> Photo:
    photo = Photo.open(path)
    _ = photo.image  # decoded here, kept there
    return photo
