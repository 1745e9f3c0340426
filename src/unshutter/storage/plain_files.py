"""Opens files in place, refusing anything but plain files: no links, pipes or devices."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

from unshutter.errors import UnshutterError

# Do not follow links, do not wait for pipes, do not translate line ends.
NEVER_FOLLOW = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def open_plain(path: Path, flags: int) -> int:
    """Opens a file in place and returns its descriptor; never blocks, as a pipe could.

    Raises:
        FileNotFoundError: the file does not exist, and ``flags`` do not create it.
        UnshutterError: it is a link, a pipe, a device or a folder; it is opened for writing and has a second name (a
            hard link); or the system refuses.
    """
    writing = flags & (os.O_WRONLY | os.O_RDWR)
    doing = "write" if writing else "read"
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
    if stat.S_ISREG(status.st_mode) and not (writing and status.st_nlink > 1):
        return descriptor
    os.close(descriptor)
    what = "it has a second name (a hard link)" if stat.S_ISREG(status.st_mode) else "it is not a plain file"
    raise UnshutterError(f"cannot {doing} {{file}}: {what}", file=path)


def add_bytes(descriptor: int, data: bytes) -> None:
    """Writes all bytes to an open file; raises OSError if that fails."""
    while data:
        data = data[os.write(descriptor, data) :]


def is_torn(descriptor: int) -> bool:
    """Whether a text file, open for reading, ends without a line break, for example after a full disc."""
    size = os.lseek(descriptor, 0, os.SEEK_END)
    if not size:
        return False
    os.lseek(descriptor, size - 1, os.SEEK_SET)
    return os.read(descriptor, 1) != b"\n"


def add_text(path: Path, text: str) -> None:
    """Appends text to a file, creating it if necessary.

    Raises:
        UnshutterError: it is not a plain file, or the system refuses.
    """
    descriptor = open_plain(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    try:
        add_bytes(descriptor, text.encode())
    except OSError as error:
        raise UnshutterError(f"cannot write {{file}}: {error.strerror}", file=path) from None
    finally:
        os.close(descriptor)


def check_plain(path: Path) -> None:
    """Checks that reading a file comes to an end; pipes and devices may block indefinitely.

    Raises:
        UnshutterError: it is a pipe, a socket or a device. (A missing file is reported when it is opened.)
    """
    with suppress(OSError, ValueError):
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UnshutterError("cannot read {file}: it is a pipe or a device, not a file", file=path)


def digest(path: Path) -> str | None:
    """Returns a hash of a plain file's contents; None if there is no such file."""
    from hashlib import file_digest  # imported here: it takes 15 ms, and a single photo does not need it

    try:
        with open(_open_unnoticed(path), "rb") as stream:
            return file_digest(stream, _new_hash).hexdigest()
    except (OSError, UnshutterError):
        return None


def digest_of(data: bytes) -> str:
    """Returns a hash of bytes, equal to that of a file with these contents."""
    digest = _new_hash()
    digest.update(data)
    return digest.hexdigest()


def _open_unnoticed(path: Path) -> int:
    """Opens a file for reading, if possible without updating its access time, which may be a copy of its photo's."""
    with suppress(UnshutterError):  # allowed only for the file's owner, and only on some systems
        return open_plain(path, os.O_RDONLY | getattr(os, "O_NOATIME", 0))
    return open_plain(path, os.O_RDONLY)


def _new_hash():
    from hashlib import blake2b

    return blake2b(digest_size=16)


def same_bytes(one: Path, other: Path) -> bool:
    """Whether both are plain files with identical contents."""
    try:
        with open(open_plain(one, os.O_RDONLY), "rb") as first, open(open_plain(other, os.O_RDONLY), "rb") as second:
            if os.fstat(first.fileno()).st_size != os.fstat(second.fileno()).st_size:
                return False
            while chunk := first.read(1 << 20):
                if second.read(len(chunk)) != chunk:
                    return False
            return True
    except (OSError, UnshutterError):
        return False
