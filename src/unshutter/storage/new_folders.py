"""Folders that get their final name when complete; leftovers of killed runs are removed by the next run."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from unshutter.errors import UnshutterError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_PART = re.compile(r"\.unshutter-[0-9a-f]{16}\.part")
_LEFT_S = 3600  # without locks, a temporary folder unchanged for this long counts as abandoned
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Creates a temporary folder that replaces ``folder`` if the block succeeds, and is removed otherwise.

    Raises:
        UnshutterError: the name exists, or the folder cannot be created.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not folder.is_symlink() and not os.listdir(folder)):
        raise UnshutterError(f"{folder} exists already: pictures go into a new folder")
    part, held = folder.with_name(f".unshutter-{os.urandom(8).hex()}.part"), None
    try:
        held = _make_and_hold(part)
        yield part
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    except OSError as error:
        raise UnshutterError(f"cannot write {folder}: {error.strerror}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if held is not None:
            os.close(held)


def remove_left_folders(folder: Path) -> int:
    """Removes leftovers of killed runs next to a folder to be created, but not the folders of active runs.

    Args:
        folder: folder to be created. Leftovers of version 1.0, which contain its name, are removed as well.

    Returns:
        The number of folders removed.
    """
    removed, older = 0, re.compile(rf"\.{re.escape(folder.name)}\.[0-9a-f]{{8}}\.part")
    with suppress(OSError), os.scandir(folder.parent) as entries:
        for entry in entries:
            if entry.name.endswith(".part") and entry.is_dir(follow_symlinks=False):
                with suppress(OSError):
                    if _PART.fullmatch(entry.name):
                        removed += _removed_if_left(Path(entry.path))
                    elif older.fullmatch(entry.name):
                        removed += _removed_if_old(Path(entry.path))
    return removed


def _make_and_hold(part: Path) -> int | None:
    """Creates a folder and locks it for the lifetime of this process, which shows others that it is in use."""
    while True:
        part.mkdir()
        if fcntl is None:
            return None
        descriptor = os.open(part, _FOLDER)
        with suppress(OSError):  # the file system does not support locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), part.stat()):
                return descriptor
        os.close(descriptor)  # removed as a leftover between the two steps


def _removed_if_left(part: Path) -> bool:
    """Removes a temporary folder unless it is still being filled."""
    if fcntl is None:
        return _removed_if_old(part)
    descriptor = os.open(part, _FOLDER)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # the file system does not support locks
        return _removed_if_old(part)
    else:
        shutil.rmtree(part)  # while holding the lock, so that a process that has just created the folder notices
        return True
    finally:
        os.close(descriptor)


def _removed_if_old(part: Path) -> bool:
    newest = max([part.stat().st_mtime, *(each.stat().st_mtime for each in os.scandir(part))])
    if time.time() - newest <= _LEFT_S:
        return False
    shutil.rmtree(part)
    return True
