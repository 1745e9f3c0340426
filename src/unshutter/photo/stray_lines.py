"""Lines that C libraries print on standard error, suppressed: users get one clear line instead."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

_STANDARD_ERROR = 2
_turn = Lock()  # there is but one standard error


@contextmanager
def kept_back(pattern: bytes) -> Iterator[None]:
    """Keeps whole lines that match a pattern from standard error; what others write meanwhile comes afterwards.

    For libraries whose printing nothing turns off. Threads wait for each other here.
    """
    import tempfile  # not above: most photos do without

    with _turn, tempfile.TemporaryFile() as held:
        try:
            shown = os.dup(_STANDARD_ERROR)
        except OSError:  # closed: nobody would see it
            yield
            return
        _flush()
        os.dup2(held.fileno(), _STANDARD_ERROR)
        try:
            yield
        finally:
            _flush()
            os.dup2(shown, _STANDARD_ERROR)
            held.seek(0)
            lines = b"".join(line for line in held if not re.fullmatch(pattern, line.rstrip()))
            with suppress(OSError):
                os.write(shown, lines)
            os.close(shown)


def _flush() -> None:
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
