"""Storage of open photos and clips in a temporary folder, deleted at exit or, after a crash, at the next start."""

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
from unshutter.serve.jobs.cache import Kind, OpenFile
from unshutter.serve.names import clean_name

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_PREFIX = "unshutter-serve-"
_LOCK = "lock"
_FILM = re.compile(r"\.[a-z0-9]{2,5}")  # plausible suffix of a clip


class Full(UnshutterError):
    """There is no room for another photo or clip."""


class Missing(UnshutterError):
    """The requested photo, clip or result does not exist or is no longer open."""


@dataclass
class Store:
    """Storage of all open photos and clips.

    Attributes:
        folder: folder of the files.
        most_files, most_bytes: largest number and total size of open files.
        max_pixels: largest photo allowed [px].
    """

    folder: Path
    most_files: int
    most_bytes: int
    max_pixels: int
    _open: dict[str, OpenFile] = field(default_factory=dict)
    _sizes: dict[str, int] = field(default_factory=dict)

    async def add(self, name: str, data: AsyncIterator[bytes], kind: Kind = "photo", size: int = 0) -> OpenFile:
        """Stores an uploaded file, piece by piece.

        Args:
            name: original name of the file.
            data: contents of the file.
            kind: whether the file is a photo or a clip.
            size: size of the file [bytes], or 0 if not known in advance.

        Raises:
            Full: there is no room for the file.
            UnshutterError: the file is empty, or cannot be written.
        """
        if len(self._sizes) >= self.most_files:
            raise Full(f"{self.most_files} files are open already: close some of them")
        if size > shutil.disk_usage(self.folder).free:
            raise Full(f"there is no room for it in {self.folder.parent}: set TMPDIR to a folder on a larger disc")
        id, name = secrets.token_urlsafe(9), clean_name(name, kind)
        suffix = PurePosixPath(name).suffix.lower()
        is_known = _FILM.fullmatch(suffix) if kind == "clip" else of_suffix(suffix)
        open_file = OpenFile(id, kind, name, self.folder / id / f"{kind}{suffix if is_known else ''}", self.max_pixels)
        self._sizes[id] = 0
        try:
            open_file.path.parent.mkdir()
            with open_file.path.open("xb") as file:
                async for piece in data:
                    file.write(piece)
                    self._sizes[id] += len(piece)
                    if sum(self._sizes.values()) > self.most_bytes:
                        raise Full(f"the open files have more than {self.most_bytes / 1e6:g} MB: close some of them")
            if not self._sizes[id]:
                raise UnshutterError(f"{name} is empty (0 bytes)")
        except OSError as error:
            self.remove(open_file)
            raise UnshutterError(f"cannot keep the {kind}: {error.strerror}") from None
        except BaseException:
            self.remove(open_file)
            raise
        self._open[id] = open_file
        return open_file

    def get(self, id: str) -> OpenFile:
        """Returns the photo or clip with this id.

        Raises:
            Missing: the file was closed, or the server was restarted.
        """
        if id not in self._open:
            raise Missing("this file is no longer open: drop it on the page again")
        return self._open[id]

    def remove(self, open_file: OpenFile) -> None:
        """Deletes a file along with its cache."""
        self._open.pop(open_file.id, None)
        self._sizes.pop(open_file.id, None)
        shutil.rmtree(open_file.path.parent, ignore_errors=True)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Creates a private temporary folder, after deleting those left behind by killed processes."""
    _remove_leftovers()
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        if fcntl is not None:
            with suppress(OSError):  # the file system does not support locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield folder
    finally:
        os.close(descriptor)
        shutil.rmtree(folder, ignore_errors=True)


def _remove_leftovers() -> None:
    """Deletes temporary folders of this user's processes that have ended."""
    if fcntl is None:
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            with (folder / _LOCK).open("rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while the owning process is running
                shutil.rmtree(folder, ignore_errors=True)
