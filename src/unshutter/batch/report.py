"""One after the other, past those that fail: messages, count, exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.progress import Progress

Tell = Callable[[str], None]  # says a line to the user


def each_photo(files: list[Path], one: Callable[[Path, Tell], None]) -> int:
    """Does ``one`` for each file, goes on past those that fail; returns the exit code."""
    failed = 0
    with Progress(len(files)) as bar:
        for photo in files:
            try:
                naming_the_photo(photo, lambda photo: one(photo, bar.tell))
            except UnshutterError as error:
                if len(files) == 1:
                    raise
                failed += 1
                bar.tell(f"unshutter: {error}")
            bar.advance()
    return exit_code(failed, len(files))


def naming_the_photo(photo: Path, one: Callable[[Path], None]) -> None:
    """Errors name their photo; what nobody foresaw becomes one line, too (UNSHUTTER_DEBUG=1 shows it whole)."""
    try:
        one(photo)
    except UnshutterError as error:
        if str(photo) in str(error):
            raise
        raise type(error)(f"{photo}: {error}") from None
    except MemoryError:
        raise UnshutterError(f"{photo}: not enough memory") from None
    except Exception as error:
        if os.environ.get("UNSHUTTER_DEBUG"):
            raise
        line = " ".join(str(error).split())
        raise UnshutterError(
            f"{photo}: unexpected {type(error).__name__}: {line} (please report it; UNSHUTTER_DEBUG=1 shows more)"
        ) from error


def exit_code(failed: int, total: int) -> int:
    """1 if something failed, and says how much."""
    if failed:
        print(f"unshutter: {failed} of {total} photos failed", file=sys.stderr)
    return 1 if failed else 0
