"""JSON logs: one event a line, added to a file of the user's choice, which may hold those of earlier runs."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from unshutter.errors import UnshutterError
from unshutter.storage.plain_files import add_bytes, add_text, is_torn, open_plain
from unshutter.storage.protection import Protection

_FIRST_WORDS = b'{"event":'  # of every log


class JsonLog:
    """A log to add to. Another file of that name, such as a photo, is left alone.

    Args:
        path: of the log; made when it is missing, in a folder that exists.
        protection: of the files that the run reads.

    Raises:
        UnshutterError: it cannot be written, is an input of the run, or no such log.
    """

    def __init__(self, path: Path, protection: Protection):
        self._path = path
        protection.check(path)
        descriptor = open_plain(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        try:
            if os.read(descriptor, len(_FIRST_WORDS)) not in (b"", _FIRST_WORDS):
                raise UnshutterError(f"{path} is no log of unshutter's: choose another name for --json-log")
            if is_torn(descriptor):
                add_bytes(descriptor, b"\n")
        except OSError as error:
            raise UnshutterError(f"cannot write {path}: {error.strerror}") from None
        finally:
            os.close(descriptor)

    def add(self, event: str, **about: Any) -> None:
        """Adds an event.

        Raises:
            UnshutterError: the log cannot be written.
        """
        add_text(self._path, json.dumps({"event": event, **about}) + "\n")
