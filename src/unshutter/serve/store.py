"""The photos that are open, in a temporary folder that goes with the process, or with the next one if it was killed."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from unshutter.errors import UnshutterError
from unshutter.photo.formats import of_suffix

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_PREFIX = "unshutter-serve-"
_LOCK = "lock"
_UNUSUAL = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"|?*\u200e\u200f\u202a-\u202e\u2066-\u2069]')
_LONGEST_NAME, _LONGEST_SUFFIX = 120, 10


class Full(UnshutterError):
    """No room for another photo."""


class Missing(UnshutterError):
    """No such photo is open."""


@dataclass(frozen=True)
class Stored:
    """An open photo.

    Attributes:
        id: by which the page calls it.
        name: of the file, as far as it may be used as one.
        path: where it lies, alone in its folder.
    """

    id: str
    name: str
    path: Path


@dataclass
class Store:
    """All open photos.

    Attributes:
        folder: where they lie.
        most_photos, most_bytes: that there is room for.
    """

    folder: Path
    most_photos: int
    most_bytes: int
    _photos: dict[str, Stored] = field(default_factory=dict)
    _sizes: dict[str, int] = field(default_factory=dict)

    async def add(self, name: str, data: AsyncIterator[bytes]) -> Stored:
        """Takes a photo in, piece by piece.

        Raises:
            Full: there is no room for it.
            UnshutterError: it is empty, or the disc is full.
        """
        if len(self._sizes) >= self.most_photos:
            raise Full(f"{self.most_photos} photos are open already: close some of them")
        id, name = secrets.token_urlsafe(9), clean_name(name)
        suffix = PurePosixPath(name).suffix.lower()
        stored = Stored(id, name, self.folder / id / f"photo{suffix if of_suffix(suffix) else ''}")
        self._sizes[id] = 0
        try:
            stored.path.parent.mkdir()
            with stored.path.open("xb") as file:
                async for piece in data:
                    file.write(piece)
                    self._sizes[id] += len(piece)
                    if sum(self._sizes.values()) > self.most_bytes:
                        raise Full(f"the open photos have more than {self.most_bytes / 1e6:g} MB: close some of them")
            if not self._sizes[id]:
                raise UnshutterError(f"{name} is empty (0 bytes)")
        except OSError as error:
            self.remove(stored)
            raise UnshutterError(f"cannot keep the photo: {error.strerror}") from None
        except BaseException:
            self.remove(stored)
            raise
        self._photos[id] = stored
        return stored

    def get(self, id: str) -> Stored:
        """The photo of that id.

        Raises:
            Missing: it was closed, or the program was started anew.
        """
        if id not in self._photos:
            raise Missing("this photo is not open any more: drop it on the page again")
        return self._photos[id]

    def remove(self, stored: Stored) -> None:
        """Forgets a photo and all that was found about it."""
        self._photos.pop(stored.id, None)
        self._sizes.pop(stored.id, None)
        shutil.rmtree(stored.path.parent, ignore_errors=True)


def clean_name(name: str) -> str:
    """The last part of a file's name, without what could lead elsewhere or is no text; ``photo`` if nothing is left."""
    last = re.split(r"[/\\]", name)[-1]
    last = _UNUSUAL.sub("", last.encode("utf-8", "ignore").decode()).strip()
    stem, _, suffix = last.rpartition(".")
    if not suffix or len(suffix) > _LONGEST_SUFFIX or last == suffix:
        stem, suffix = last, ""
    stem = stem.lstrip(".")[: _LONGEST_NAME - len(suffix)].strip() or "photo"
    return f"{stem}.{suffix}" if suffix else stem


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder that nobody else can read; those that killed processes left are removed first."""
    _remove_leftovers()
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        if fcntl is not None:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield folder
    finally:
        os.close(descriptor)
        shutil.rmtree(folder, ignore_errors=True)


def _remove_leftovers() -> None:
    """Removes the folders of this user's processes that live no more."""
    if fcntl is None:
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            with (folder / _LOCK).open("rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while its process lives
                shutil.rmtree(folder, ignore_errors=True)
