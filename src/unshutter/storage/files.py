"""Files are written whole or not at all, and never over an original."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from unshutter.errors import UnshutterError

try:
    import fcntl
except ImportError:  # Windows, where a file that is open can neither be replaced nor removed anyway
    fcntl = None

_PART = re.compile(r"\.unshutter-[0-9a-f]{16}\.part(\..*)?")
_LEFT_S = 3600  # without locks, a temporary file this old is nobody's


def check_target(target: Path, overwrite: bool, original: Path | None = None) -> None:
    """Checks that a file may be written, before the work on what goes into it begins.

    Args:
        target: file to be written.
        overwrite: whether an existing file may be replaced.
        original: a file that is never replaced, not even through a link.

    Raises:
        UnshutterError: it may not be written, or cannot.
    """
    try:
        if original is not None and target.exists() and original.exists() and target.samefile(original):
            raise UnshutterError(f"{target} is the original, which is never overwritten: choose another name")
        if target.is_dir():
            raise UnshutterError(f"cannot write {target}: it is a folder")
        if not overwrite and (target.exists() or target.is_symlink()):
            raise UnshutterError(f"{target} exists already: use --overwrite to replace it")
        if not Path(os.path.realpath(target)).parent.is_dir():
            raise UnshutterError(f"cannot write {target}: there is no folder {target.parent}")
    except (OSError, ValueError) as error:
        told = error.strerror if isinstance(error, OSError) else error
        raise UnshutterError(f"cannot write {str(target)!r}: {told}") from None


@contextmanager
def written_whole(target: Path) -> Iterator[Path]:
    """An empty temporary file beside ``target`` that takes its place when the block ends well, and goes otherwise.

    A symbolic link stays one: what it points to is replaced. The bytes are on the disc before the name is, so that
    not even a power cut leaves a half-written file under it.

    Raises:
        UnshutterError: the system refuses.
    """
    whole = Path(os.path.realpath(target))
    part = whole.with_name(f".unshutter-{os.urandom(8).hex()}.part{whole.suffix}")
    held = None
    try:
        held = _make_and_hold(part)
        yield part
        _to_disc(part)
        os.replace(part, whole)
    except OSError as error:
        raise UnshutterError(f"cannot write {target}: {error.strerror}") from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if held is not None:
            os.close(held)


def remove_leftovers(folder: Path) -> int:
    """Removes the temporary files that killed runs left in a folder, not those of runs at work; returns how many."""
    removed = 0
    with suppress(OSError):
        for path in folder.iterdir():
            if _PART.fullmatch(path.name):
                with suppress(OSError):
                    removed += _removed_if_left(path)
    return removed


def _make_and_hold(part: Path) -> int | None:
    """Makes an empty file and locks it for as long as this process lives, which is how others know that it does."""
    while True:
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        if fcntl is None:
            os.close(descriptor)
            return None
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return descriptor
        os.close(descriptor)  # taken for a leftover between the two steps


def _removed_if_left(part: Path) -> bool:
    """Removes a temporary file unless somebody still writes it."""
    if fcntl is not None:
        with part.open("rb") as stream:
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


def _to_disc(part: Path) -> None:
    descriptor = os.open(part, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
