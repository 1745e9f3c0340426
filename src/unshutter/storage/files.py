"""Files are written whole or not at all, never over an original, and never through a link.

A name in the way of a result may be anything: a photo of the same run, a link to one, a pipe. So nothing is opened for
writing under its final name. A file is made under a new name (``O_EXCL``) next to it and renamed when it is complete,
which replaces a link rather than what it leads to; without ``overwrite`` by a hard link, which fails where there is
anything at all. Only journals and logs are added to in place: ``plain_files.py`` refuses what is not a plain file.
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
except ImportError:  # Windows, where a file that is open can neither be replaced nor removed anyway
    fcntl = None

_PART = re.compile(r"\.unshutter-[0-9a-f]{16}\.part(\..*)?")
_LEFT_S = 3600  # without locks, a temporary file this old is nobody's
_NO_HARD_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
_parts: set[Path] = set()  # temporary files of this process

Times: TypeAlias = tuple[int, int]  # of the last access and the last change [ns]


def check_target(target: Path, overwrite: bool, *originals: Path | None) -> None:
    """Checks that a file may be written, before the work on what goes into it begins.

    Args:
        target: file to be written.
        overwrite: whether an existing file may be replaced.
        originals: files that are never replaced, whatever their names.

    Raises:
        UnshutterError: it may not be written, or cannot.
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
    """An empty temporary file next to ``target`` that takes its place when the block ends well, and goes otherwise.

    The bytes are on the disc before the name is, so that not even a power cut leaves a half-written file under it.

    Args:
        target: file to be written.
        overwrite: whether an existing file is replaced. Without, one with the very same bytes stays, and all is well:
            somebody has done the same work before.
        mode_of: file whose permissions the new one gets; by default those of any new file.
        times_ns: that it gets, where the file system can keep them; by default now.

    Raises:
        UnshutterError: the system refuses, the target is a link, or it exists and may not be replaced.
    """
    part = target.with_name(f".unshutter-{os.urandom(8).hex()}.part{target.suffix}")
    held = None
    try:
        mode = _permissions(mode_of)
        _parts.add(part)
        held = _make_and_hold(part, 0o666 if mode is None else 0o600)  # nobody reads along meanwhile
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
    """When a file was last read and changed [ns]; None where there is none."""
    with suppress(OSError, ValueError):
        status = path.stat()
        return status.st_atime_ns, status.st_mtime_ns
    return None


def remove_leftovers(folder: Path) -> int:
    """Removes the temporary files that killed runs left in a folder, not those of runs at work; returns how many."""
    removed = 0
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".unshutter-") and _PART.fullmatch(entry.name):
                with suppress(OSError, UnshutterError):
                    removed += _removed_if_left(Path(entry.path))
    return removed


def remove_own_parts() -> None:
    """Removes the temporary files of this process, which is about to be ended from outside."""
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
    """Makes an empty file and locks it for as long as this process lives, which is how others know that it does."""
    while True:
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | NEVER_FOLLOW, mode)
        if fcntl is None:
            os.close(descriptor)
            return None
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return descriptor
        os.close(descriptor)  # taken for a leftover between the two steps


def _to_disc(part: Path, mode: int | None, times_ns: Times | None) -> None:
    descriptor = os.open(part, os.O_RDWR | NEVER_FOLLOW)
    try:
        if mode is not None:
            with suppress(OSError):  # a file system without permissions
                os.chmod(part, mode)
        if times_ns is not None:
            with suppress(OSError, OverflowError):  # times that the file system cannot keep
                os.utime(part, ns=times_ns)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _take_name(part: Path, target: Path, overwrite: bool) -> None:
    """Gives the finished file its name."""
    if overwrite:
        if target.is_symlink():
            raise UnshutterError(
                "cannot write {target}: it is a link, and nothing is written through links", target=target
            )
        return os.replace(part, target)
    try:
        os.link(part, target)  # fails where there is anything; a rename would replace it
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
    """Removes a temporary file unless somebody still writes it."""
    if fcntl is not None:
        with open(open_plain(part, os.O_RDONLY), "rb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
            except OSError:
                pass  # a file system without locks: by age
            else:
                part.unlink()  # while the lock is held: a writer that has just made it finds out
                return True
    left = time.time() - part.stat().st_mtime > _LEFT_S
    if left:
        part.unlink()
    return left
