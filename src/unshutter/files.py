"""Files are written whole or not at all, and never over an original."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from unshutter.errors import UnshutterError


def check_target(target: Path, overwrite: bool, original: Path | None = None) -> None:
    """Says no before the work rather than after it.

    Args:
        target: file to be written.
        overwrite: whether it may replace an existing file.
        original: a file that it never replaces, not even through a link.

    Raises:
        UnshutterError: it may not or cannot be written.
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

    A symbolic link stays one: what it points to is replaced.

    Raises:
        UnshutterError: the system refuses.
    """
    whole = Path(os.path.realpath(target))
    part = whole.with_name(f".unshutter-{secrets.token_hex(8)}.part{whole.suffix}")
    try:
        part.open("xb").close()
        yield part
        os.replace(part, whole)
    except OSError as error:
        raise UnshutterError(f"cannot write {target}: {error.strerror}") from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
