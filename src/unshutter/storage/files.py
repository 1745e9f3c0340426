"""Reads and writes files and objects: whole or not at all, never over an original or through a link.

An existing file of the result's name may be anything: a photo of the same run, a link to one, a pipe. Therefore nothing
is opened for writing under its final name. A file is created under a new name (``O_EXCL``) next to it and renamed
when complete, which replaces a link rather than its target; without ``overwrite``, a hard link is used, which fails if
the name exists. Only journals and logs are appended to in place (:func:`open_plain`). An object is written as a
temporary file on this machine, which is then sent (storage/objects.py).
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import IO, TYPE_CHECKING, TypeAlias

from unshutter.errors import UnshutterError, UsageError, with_stand_ins
from unshutter.storage import objects
from unshutter.storage.objects import is_object

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

if TYPE_CHECKING:
    pass


# Do not follow links, do not wait for pipes, do not translate line ends.
NEVER_FOLLOW = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def open_plain(path: Path, flags: int) -> int:
    """Opens a file in place and returns its descriptor; never blocks, as a pipe could."""
    writing = flags & (os.O_WRONLY | os.O_RDWR)
    doing = "write" if writing else "read"
    check_name(path)
    try:
        if path.is_symlink():
            raise UnshutterError(
                f"cannot {doing} {{file}}: it is a link, and nothing is written through links", file=path
            )
        if path.exists() and not path.is_file():
            raise UnshutterError(f"cannot {doing} {{file}}: it is not a plain file", file=path)
        descriptor = os.open(path, flags | NEVER_FOLLOW, 0o666)
    except FileNotFoundError:
        if flags & os.O_CREAT:
            raise UnshutterError(
                "cannot write {file}: there is no folder {folder}", folder=path.parent, file=path
            ) from None
        raise
    except OSError as error:
        raise UnshutterError(f"cannot {doing} {{file}}: {error.strerror}", file=path) from None
    status = os.fstat(descriptor)
    is_plain = stat.S_ISREG(status.st_mode)
    if is_plain and not (writing and status.st_nlink > 1):
        return descriptor
    os.close(descriptor)
    what = "it has a second name (a hard link)" if is_plain else "it is not a plain file"
    raise UnshutterError(f"cannot {doing} {{file}}: {what}", file=path)


def write_all(descriptor: int, data: bytes) -> None:
    """Writes all bytes to an open file; raises OSError if that fails."""
    while data:
        data = data[os.write(descriptor, data) :]


@contextmanager
def added_to(path: Path) -> Iterator[int]:
    """Opens a file in place to append to it, creating it if necessary; yields its descriptor."""
    descriptor = open_plain(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
    try:
        yield descriptor
    except OSError as error:
        raise UnshutterError(f"cannot write {{file}}: {error.strerror}", file=path) from None
    finally:
        os.close(descriptor)


def add_text(path: Path, text: str) -> None:
    """Appends text to a file, creating it if necessary."""
    with added_to(path) as descriptor:
        write_all(descriptor, text.encode())


def is_torn(descriptor: int) -> bool:
    """Whether a text file, open for reading, ends without a line break, for example after a full disc."""
    size = os.lseek(descriptor, 0, os.SEEK_END)
    if not size:
        return False
    os.lseek(descriptor, size - 1, os.SEEK_SET)
    return os.read(descriptor, 1) != b"\n"


_FIRST_WORDS = b'{"event":'  # at the start of every log


class JsonLog:
    """A log to append to, created if missing; any other file of that name, such as a photo, is left unchanged.

    Raises UnshutterError if the file cannot be written, or is not such a log.
    """

    def __init__(self, path: Path):
        self._path = path
        with added_to(path) as descriptor:
            if os.read(descriptor, len(_FIRST_WORDS)) not in (b"", _FIRST_WORDS):
                raise UnshutterError(f"{path} is not an unshutter log: choose another name for {{--json-log}}")
            if is_torn(descriptor):
                write_all(descriptor, b"\n")

    def add(self, event: str, **about: object) -> None:
        """Appends an event."""
        named = {key: with_stand_ins(value) if isinstance(value, str) else value for key, value in about.items()}
        add_text(self._path, json.dumps({"event": event, **named}) + "\n")


def check_name(path: Path) -> None:
    """Raises UnshutterError for a name that no file can have."""
    try:
        known = b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        known = False
    if not known:
        raise UnshutterError("no file can have the name {file}: a character in it is not text", file=path)


def check_plain(path: Path) -> None:
    """Checks that reading a file comes to an end; pipes and devices may block indefinitely."""
    check_name(path)
    with suppress(OSError, ValueError):
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UnshutterError("cannot read {file}: it is a pipe or a device, not a file", file=path)


def read_text(path: Path, most: int = 64_000_000) -> str:  # bytes; a motion of 20,000 rows takes 3 million
    """Returns the contents of a text file that a user named."""
    check_plain(path)
    if path.stat().st_size > most:
        raise UnshutterError(f"cannot read {{file}}: it is larger than {most / 1e6:.0f} MB", file=path)
    return path.read_bytes().decode("utf-8-sig")


def fingerprint(path: Path) -> str | None:
    """Returns a string that changes with the content: size and time, or a store's metadata; None if there is none."""
    if is_object(path):
        return objects.stamp(path)
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return f"{status.st_size}:{status.st_mtime_ns}"


def digest(path: Path) -> str | None:
    """Returns a hash of the content of a plain file or an object; None if there is neither."""
    if is_object(path):
        return new_hash(objects.read_object(path)).hexdigest() if fingerprint(path) is not None else None
    try:
        try:  # allowed only for the file's owner, and only on some systems: an access time may be a copy of a photo's
            descriptor = open_plain(path, os.O_RDONLY | getattr(os, "O_NOATIME", 0))
        except UnshutterError:
            descriptor = open_plain(path, os.O_RDONLY)
        with open(descriptor, "rb") as stream:
            content = new_hash()
            while piece := stream.read(1 << 20):
                content.update(piece)
            return content.hexdigest()
    except (OSError, UnshutterError):
        return None


def new_hash(data: bytes = b""):
    """Returns a hash of bytes; its ``hexdigest()`` equals the :func:`digest` of a file with these contents."""
    from hashlib import blake2b  # imported here: it takes 15 ms, and a single photo does not need it

    return blake2b(data, digest_size=16)


SPILL_BYTES = 1 << 31  # larger arrays are kept in a file


def nameless_file() -> IO[bytes]:
    """Opens a temporary file that is removed once it is neither open nor mapped, however its process ends."""
    return TemporaryFile(prefix="unshutter-")


def lock(descriptor: int, wait: bool = False) -> bool | None:
    """Locks an open file until it is closed, however its process ends; returns whether nobody else has locked it.

    None if the file system does not support locks.
    """
    if sys.platform == "win32":
        os.lseek(descriptor, 1 << 30, os.SEEK_SET)  # beyond the content: locked bytes cannot be read
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError:
            return False
    else:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return None
    return True


_PART = re.compile(r"\.unshutter-[0-9a-f]{16}\.part(\..*)?")
_NO_HARD_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
_parts: set[Path] = set()  # temporary files of this process

Times: TypeAlias = tuple[int, int]  # of the last access and the last modification [ns]


def check_target(target: Path, overwrite: bool) -> None:
    """Checks that a file or an object may be written, before its contents are computed."""
    if is_object(target):
        if not overwrite and fingerprint(target) is not None:
            raise _exists(target)
        return
    check_name(target)
    try:
        if target.is_dir():
            raise UnshutterError("cannot write {target}: it is a folder", target=target)
        _check_no_link(target)
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


def check_motion_name(name: str) -> None:
    """Raises UsageError if a motion file to be written is not called ``.json``: a video may have the name."""
    if not name.lower().endswith(".json"):
        raise UsageError(f"a motion is a .json file, not {name}: choose another name")


def check_gyro_name(name: str) -> None:
    """Raises UsageError if a gyro log to be written is not called ``.gcsv``."""
    if not name.lower().endswith(".gcsv"):
        raise UsageError(f"a gyro log is a .gcsv file, not {name}: choose another name")


@contextmanager
def written_whole(
    target: Path,
    overwrite: bool = True,
    mode_of: Path | None = None,
    times_ns: Times | None = None,
    is_wanted: Callable[[], bool] | None = None,
) -> Iterator[Path]:
    """Creates an empty temporary file that replaces ``target`` if the block succeeds, and is removed otherwise.

    The contents are flushed to disc before renaming, so that not even a power cut leaves a partial file of this name.
    Without ``overwrite``, an existing file with identical bytes is kept without an error, because the same work has
    already been done. Permissions can be those of another file, and times [ns] are set if the file system can store
    them; by default both are those of any new file. ``is_wanted`` is asked at the end whether there is to be a file.
    An object has neither; its file is sent at the end.
    """
    part = _part_of(target)
    held = mode = None
    try:
        if mode_of is not None:
            with suppress(OSError):
                mode = mode_of.stat().st_mode & 0o777
        _parts.add(part)
        held = _make_and_hold(part, 0o666 if mode is None else 0o600)  # unreadable to others until complete
        yield part
        if is_wanted is not None and not is_wanted():
            return
        if is_object(target):
            _send(part, target, overwrite)
        else:
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


def write_file(data: bytes, target: Path, overwrite: bool = True, mode_of: Path | None = None) -> None:
    """Writes bytes as :func:`written_whole` does."""
    with written_whole(target, overwrite, mode_of) as part:
        part.write_bytes(data)


def remove(path: Path) -> None:
    """Removes a file or an object written by unshutter; failures are ignored."""
    if is_object(path):
        objects.remove_object(path)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def make_folder(folder: Path) -> None:
    """Creates a folder and its parents; stores do not need them."""
    if is_object(folder):
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnshutterError(f"cannot make folder {{folder}}: {error.strerror}", folder=folder) from None


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


def _check_no_link(target: Path) -> None:
    if target.is_symlink():
        raise UnshutterError("cannot write {target}: it is a link, and nothing is written through links", target=target)


def _exists(target: Path) -> UnshutterError:
    """Returns the error for an output that exists and may not be replaced."""
    return UnshutterError("{target} exists already: use {--overwrite} to replace it", target=target)


def _part_of(target: Path) -> Path:
    """Returns a new name for the temporary file of a result: next to it, or on this machine for an object."""
    name = f".unshutter-{os.urandom(8).hex()}.part{target.suffix}"
    if not is_object(target):
        return target.with_name(name)
    return Path(gettempdir(), name)


def _make_and_hold(part: Path, mode: int) -> int | None:
    """Creates an empty file and locks it for the lifetime of this process, which shows others that it is in use."""
    while True:
        descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | NEVER_FOLLOW, mode)
        if sys.platform == "win32":  # where open files can be neither replaced nor removed anyway
            os.close(descriptor)
            return None
        lock(descriptor, wait=True)
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
        _check_no_link(target)
        return os.replace(part, target)
    try:
        return os.link(part, target)  # fails if the name exists, where a rename would replace the file
    except OSError as error:
        if not isinstance(error, FileExistsError):
            if error.errno not in _NO_HARD_LINKS:
                raise
            if not os.path.lexists(target):
                return os.rename(part, target)
    with suppress(OSError):
        if not target.is_symlink() and part.stat().st_size == target.stat().st_size and digest(part) == digest(target):
            return None
    raise _exists(target)


def _send(part: Path, target: Path, overwrite: bool) -> None:
    """Sends the finished file of an object."""
    data = part.read_bytes()
    if overwrite or fingerprint(target) is None:
        objects.send(data, target)
    elif objects.read_object(target) != data:
        raise _exists(target)


def _removed_if_left(part: Path) -> bool:
    """Removes a temporary file unless it is still being written."""
    if sys.platform != "win32":
        with open(open_plain(part, os.O_RDONLY), "rb") as stream:
            is_left = lock(stream.fileno())
            if is_left:
                part.unlink()  # while holding the lock, so that a writer that has just created the file notices
            if is_left is not None:
                return is_left
    left = time.time() - part.stat().st_mtime > 3600  # without locks, a temporary file of this age counts as abandoned
    if left:
        part.unlink()
    return left
