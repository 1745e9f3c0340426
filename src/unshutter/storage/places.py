"""Where photos come from and results go: files, or objects behind an fsspec URL (``s3://``, ``gs://``, ``memory://``).

A place is a ``Path`` or a :class:`Remote`; the functions here do for both what a batch needs. Objects are written
with one put, which the object stores make visible whole or not at all.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.photo.formats import of_target
from unshutter.storage.files import check_target, written_whole

if TYPE_CHECKING:
    from unshutter.options import Subsampling
    from unshutter.rectification import Rectified

# What file systems call that which changes when an object does.
_STAMPS = ("ETag", "etag", "md5Hash", "generation", "mtime", "LastModified", "last_modified", "updated", "created")


@dataclass(frozen=True)
class Remote:
    """An object or folder behind an fsspec URL; the parts of ``pathlib``'s interface that a batch uses."""

    url: str

    def __str__(self) -> str:
        return self.url

    def __truediv__(self, relative: str | PurePosixPath) -> Remote:
        inside = PurePosixPath(relative).as_posix()
        return self if inside == "." else Remote(f"{self.url}/{inside}")

    @property
    def _pure(self) -> PurePosixPath:
        return PurePosixPath(self.url.partition("://")[2])

    @property
    def name(self) -> str:
        """The last part."""
        return self._pure.name

    @property
    def stem(self) -> str:
        """The name without its ending."""
        return self._pure.stem

    @property
    def suffix(self) -> str:
        """The name's ending with its dot."""
        return self._pure.suffix

    @property
    def parent(self) -> Remote:
        """The folder."""
        return Remote(self.url.rpartition("/")[0])

    def with_name(self, name: str) -> Remote:
        """Another object of the same folder."""
        return self.parent / name

    def open(self) -> tuple[Any, str]:
        """(the fsspec file system, the path on it).

        Raises:
            UnshutterError: fsspec or the protocol's package is missing, or the URL makes no sense.
        """
        with _reaching(self):
            from fsspec.core import url_to_fs

            return url_to_fs(self.url)

    def read(self) -> bytes:
        """The object's bytes.

        Raises:
            UnshutterError: it cannot be read.
        """
        fs, path = self.open()
        with _reaching(self):
            return fs.cat_file(path)

    def write(self, data: bytes) -> None:
        """Puts the bytes there, replacing what is there.

        Raises:
            UnshutterError: it cannot be written.
        """
        fs, path = self.open()
        with _reaching(self):
            fs.pipe_file(path, data)

    def remove(self) -> None:
        """Removes the object, if it is there.

        Raises:
            UnshutterError: the file system refuses.
        """
        fs, path = self.open()
        with _reaching(self):
            if fs.exists(path):
                fs.rm_file(path)

    def is_dir(self) -> bool:
        """Whether there is a folder of this name, or objects whose names begin with it and a slash."""
        fs, path = self.open()
        with _reaching(self):
            return fs.isdir(path)

    def files(self) -> list[str]:
        """Everything below this folder, relative to it."""
        fs, path = self.open()
        with _reaching(self):
            fs.invalidate_cache()
            root = fs._strip_protocol(path).rstrip("/")
            return sorted(found[len(root) :].lstrip("/") for found in fs.find(path))

    def fingerprint(self) -> str | None:
        """Size and what else changes with the content; None where there is nothing."""
        fs, path = self.open()
        with _reaching(self):
            try:
                info = fs.info(path)
            except FileNotFoundError:
                return None
        stamps = [str(info[name]) for name in _STAMPS if info.get(name) is not None]
        return ":".join([str(info.get("size")), *stamps[:1]])


Place = Path | Remote


@contextmanager
def _reaching(remote: Remote) -> Iterator[None]:
    try:
        yield
    except UnshutterError:
        raise
    except ImportError as error:
        raise UnshutterError(f"{remote} needs a package that is missing: {error} (see unshutter[dask])") from None
    except FileNotFoundError:
        raise UnshutterError(f"cannot reach {remote}: no such file or folder") from None
    except Exception as error:  # every store has its own
        raise UnshutterError(f"cannot reach {remote}: {' '.join(str(error).split()) or type(error).__name__}") from None


def place(text: str | os.PathLike[str]) -> Place:
    """What the user named: a path, or an fsspec URL."""
    if isinstance(text, str) and "://" in text:
        return Path(text.removeprefix("file://")) if text.startswith("file://") else Remote(text.rstrip("/"))
    return Path(text)


def absolute(where: Place) -> Place:
    """The place as other processes and machines can find it."""
    return where if isinstance(where, Remote) else Path(os.path.abspath(where))


def fingerprint(where: Place) -> str | None:
    """Changes when the content does: size and time, or what an object store has; None where there is nothing."""
    if isinstance(where, Remote):
        return where.fingerprint()
    try:
        status = where.stat()
    except (OSError, ValueError):
        return None
    return f"{status.st_size}:{status.st_mtime_ns}"


def open_photo(where: Place, max_pixels: int) -> Photo:
    """The photo of a place.

    Raises:
        UnshutterError: see ``Photo.open``.
    """
    return Photo.from_bytes(where.read(), max_pixels) if isinstance(where, Remote) else Photo.open(where, max_pixels)


def check_place(target: Place, overwrite: bool, original: Place) -> None:
    """As ``check_target``, for both kinds of places."""
    if isinstance(target, Path):
        return check_target(target, overwrite, original if isinstance(original, Path) else None)
    if target == original:
        raise UnshutterError(f"{target} is the original, which is never overwritten: choose another name")
    if not overwrite and target.fingerprint() is not None:
        raise UnshutterError(f"{target} exists already: use --overwrite to replace it")


def make_folder(folder: Place) -> None:
    """Makes a folder and those above it; object stores need none.

    Raises:
        UnshutterError: the system refuses.
    """
    if isinstance(folder, Path):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnshutterError(f"cannot make folder {folder}: {error.strerror}") from None


def remove(where: Place) -> None:
    """Removes a file of ours; what cannot be removed stays."""
    with suppress(OSError, UnshutterError):
        if isinstance(where, Remote):
            where.remove()
        else:
            where.unlink(missing_ok=True)


def save_picture(
    result: Rectified, target: Place, overwrite: bool, quality: int | None, subsampling: Subsampling | None
) -> None:
    """Writes a result; the format is that of the name's ending.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    if isinstance(target, Path):
        result.save(target, overwrite=overwrite, quality=quality, subsampling=subsampling)
    else:
        target.write(result.photo.to_bytes(of_target(Path(target.name)).name, quality, subsampling))


def save_text(text: str, target: Place) -> None:
    """Writes text, replacing what is there.

    Raises:
        UnshutterError: it cannot be written.
    """
    if isinstance(target, Remote):
        return target.write(text.encode())
    with written_whole(target) as part:
        part.write_text(text, encoding="utf-8")
