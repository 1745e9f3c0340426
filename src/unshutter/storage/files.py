"""Writes files atomically, never over an original and never through a link.

An existing file of the result's name may be anything: a photo of the same run, a link to one, a pipe. Therefore nothing
is opened for writing under its final name. A file is created under a new name (``O_EXCL``) next to it and renamed
when complete, which replaces a link rather than its target; without ``overwrite``, a hard link is used, which fails if
the name exists. Only journals and logs are appended to in place: ``plain_files.py`` rejects anything but plain files.
"""

from __future__ import annotations

import errno
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

from unshutter.errors import UnshutterError
from unshutter.storage.plain_files import NEVER_FOLLOW, open_plain, same_bytes

try:
    import fcntl
except ImportError:  # Windows, where open files can be neither replaced nor removed anyway
    fcntl = None

_PART = re.compile(r"\.unshutter-[0-9a-f]{16}\.part(\..*)?")
_LEFT_S = 3600  # without locks, a temporary file of this age counts as abandoned
_NO_HARD_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
_parts: set[Path] = set()  # temporary files of this process

Times: TypeAlias = tuple[int, int]  # of the last access and the last modification [ns]


def check_target(target: Path, overwrite: bool, *originals: Path | None) -> None:
    """Checks that a file may be written, before its contents are computed.

    Args:
        target: file to write.
        overwrite: whether an existing file may be replaced.
        originals: files that are never replaced, under any name.

    Raises:
        UnshutterError: the file cannot be written or must not be replaced.
    """
    try:
        for original in originals:
            if original is not None and target.exists() and original.exists() and target.samefile(original):
                raise UnshutterError(
                    "{target} is the original, which is never overwritten: choose another name", target=target
                )
        if target.is_dir():
            raise UnshutterError("cannot write {target}: it is a folder", target=target)
        if target.is_symlink():
            raise UnshutterError(
                "cannot write {target}: it is a link, and nothing is written through links", target=target
            )
        if target.exists() and not target.is_file():
            raise UnshutterError("cannot write {target}: it is not a plain file", target=target)
        if not overwrite and target.exists():
            raise _exists(target)
        if not target.parent.is_dir():
            raise UnshutterError(
                "cannot write {target}: there is no folder {folder}", folder=target.parent, target=target
            )
    except (OSError, ValueError) as error:
        cause = error.strerror if isinstance(error, OSError) else error
        raise UnshutterError(f"cannot write {{target}}: {cause}", target=target) from None


@contextmanager
def written_whole(
    target: Path, overwrite: bool = True, mode_of: Path | None = None, times_ns: Times | None = None
) -> Iterator[Path]:
    """Creates an empty temporary file that replaces ``target`` if the block succeeds, and is removed otherwise.

    The contents are flushed to disc before renaming, so that not even a power cut leaves a partial file of this name.

    Args:
        target: file to write.
        overwrite: whether an existing file is replaced. If not, an existing file with identical bytes is kept without
            an error, because the same work has already been done.
        mode_of: file whose permissions are copied; by default those of any new file.
        times_ns: times to set, if the file system can store them; by default the current time.

    Raises:
        UnshutterError: the system refuses, the target is a link, or it exists and must not be replaced.
    """
    part = target.with_name(f".unshutter-{os.urandom(8).hex()}.part{target.suffix}")
    held = None
    try:
        mode = _permissions(mode_of)
        _parts.add(part)
        held = _make_and_hold(part, 0o666 if mode is None else 0o600)  # unreadable to others until complete
        yield part
        _to_disc(part, mode, times_ns)
        _take_name(part, target, overwrite)
    except OSError as error:
        raise UnshutterError(f"cannot write {{target}}: {error.strerror}", target=target) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        _parts.discard(part)
        if held is not None:
            os.close(held)


def times_of(path: Path) -> Times | None:
    """Returns the times of a file's last access and modification [ns]; None if there is no file."""
    with suppress(OSError, ValueError):
        status = path.stat()
        return status.st_atime_ns, status.st_mtime_ns
    return None


def remove_leftovers(folder: Path) -> int:
    """Removes temporary files left by killed runs, but not those of active runs; returns their number."""
    removed = 0
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".unshutter-") and _PART.fullmatch(entry.name):
                with suppress(OSError, UnshutterError):
                    removed += _removed_if_left(Path(entry.path))
    return removed


def remove_own_parts() -> None:
    """Removes the temporary files of this process, which is about to be terminated."""
    for part in list(_parts):
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _exists(target: Path) -> UnshutterError:
    return UnshutterError("{target} exists already: use --overwrite to replace it", target=target)


def _permissions(model: Path | None) -> int | None:
    with suppress(OSError):
        return None if model is None else model.stat().st_mode & 0o777
    return None


def _make_and_hold(part: Path, mode: int) -> int | None:
    """Creates an empty file and locks it for the lifetime of this process, which shows others that it is in use."""
    while True:
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | NEVER_FOLLOW, mode)
        if fcntl is None:
            os.close(descriptor)
            return None
        with suppress(OSError):  # the file system does not support locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return descriptor
        os.close(descriptor)  # removed as a leftover between the two steps


def _to_disc(part: Path, mode: int | None, times_ns: Times | None) -> None:
    descriptor = os.open(part, os.O_RDWR | NEVER_FOLLOW)
    try:
        if mode is not None:
            with suppress(OSError):  # the file system does not support permissions
                os.chmod(part, mode)
        if times_ns is not None:
            with suppress(OSError, OverflowError):  # the file system cannot store these times
                os.utime(part, ns=times_ns)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _take_name(part: Path, target: Path, overwrite: bool) -> None:
    """Renames the finished file."""
    if overwrite:
        if target.is_symlink():
            raise UnshutterError(
                "cannot write {target}: it is a link, and nothing is written through links", target=target
            )
        return os.replace(part, target)
    try:
        os.link(part, target)  # fails if the name exists, where a rename would replace the file
    except FileExistsError:
        if not same_bytes(part, target):
            raise _exists(target) from None
    except OSError as error:
        if error.errno not in _NO_HARD_LINKS:
            raise
        if os.path.lexists(target):
            if not same_bytes(part, target):
                raise _exists(target) from None
        else:
            os.rename(part, target)


def _removed_if_left(part: Path) -> bool:
    """Removes a temporary file unless it is still being written."""
    if fcntl is not None:
        with open(open_plain(part, os.O_RDONLY), "rb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
            except OSError:
                pass  # the file system does not support locks: decide by age
            else:
                part.unlink()  # while holding the lock, so that a writer that has just created the file notices
                return True
    left = time.time() - part.stat().st_mtime > _LEFT_S
    if left:
        part.unlink()
    return left
