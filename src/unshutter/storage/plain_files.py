"""Files that are opened under the name they have: nothing but a file, and nothing that leads to another."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

from unshutter.errors import UnshutterError

# A link is not followed, a pipe not waited for, a line end not translated.
NEVER_FOLLOW = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def open_plain(path: Path, flags: int) -> int:
    """Opens a file in place and returns its descriptor; never waits, as a pipe would.

    Raises:
        FileNotFoundError: it is not there, and ``flags`` do not say that it is to be made.
        UnshutterError: it is a link, a pipe, a device or a folder; it has a second name (a hard link) and would be
            written under that, too; or the system refuses.
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
    """Adds bytes to a file, all of them; OSError, with the system's reason, where they find no room."""
    while data:
        data = data[os.write(descriptor, data) :]


def is_torn(descriptor: int) -> bool:
    """Whether a file of lines, open to be read, ends in the middle of one, as after a full disc."""
    size = os.lseek(descriptor, 0, os.SEEK_END)
    if not size:
        return False
    os.lseek(descriptor, size - 1, os.SEEK_SET)
    return os.read(descriptor, 1) != b"\n"


def add_text(path: Path, text: str) -> None:
    """Adds text to a file, which is made where there is none.

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
    """Checks that reading a file would come to an end: a pipe may wait indefinitely, and so may a device.

    Raises:
        UnshutterError: it is a pipe, a socket or a device. (What is missing, says who opens it.)
    """
    with suppress(OSError, ValueError):
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UnshutterError("cannot read {file}: it is a pipe or a device, not a file", file=path)


def digest(path: Path) -> str | None:
    """A hash of a plain file's content; None where there is no such file."""
    from hashlib import file_digest  # not above: it takes 15 ms, and a single photo does without

    try:
        with open(_open_unnoticed(path), "rb") as stream:
            return file_digest(stream, _new_hash).hexdigest()
    except (OSError, UnshutterError):
        return None


def digest_of(data: bytes) -> str:
    """A hash of bytes, equal to that of a file with this content."""
    digest = _new_hash()
    digest.update(data)
    return digest.hexdigest()


def _open_unnoticed(path: Path) -> int:
    """Opens a file to be read without a new access time, which it may have from its photo; where that is allowed."""
    with suppress(UnshutterError):  # only its owner may, and only where the system can
        return open_plain(path, os.O_RDONLY | getattr(os, "O_NOATIME", 0))
    return open_plain(path, os.O_RDONLY)


def _new_hash():
    from hashlib import blake2b

    return blake2b(digest_size=16)


def same_bytes(one: Path, other: Path) -> bool:
    """Whether both are plain files of the same content."""
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
