"""Append-only files with one JSON record per line: journals of a folder, and JSON logs.

Several runs may write to a journal. In a folder of files it is one file, ``NAME.jsonl``. Objects cannot be appended to:
behind a URL, each run writes pieces, ``NAME/RUN-NUMBER.jsonl``, and merges them at the end. A log is a file chosen by
the user, which may contain events of earlier runs.
"""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.storage.places import Place, make_folder, objects_below, read_place, remove, write_place
from unshutter.storage.plain_files import add_bytes, add_text, is_torn, open_plain
from unshutter.storage.protection import Protection

if TYPE_CHECKING:
    from upath import UPath


class Journal(ABC):
    """A journal as seen by one run; nothing is written before the first line."""

    @abstractmethod
    def news(self) -> bytes:
        """Returns the complete lines that this run has not seen yet, including its own.

        Raises:
            UnshutterError: the journal cannot be read.
        """

    @abstractmethod
    def add(self, line: str) -> None:
        """Appends a line.

        Raises:
            UnshutterError: the journal cannot be written.
        """

    @abstractmethod
    def flush(self) -> None:
        """Writes pending lines.

        Raises:
            UnshutterError: the journal cannot be written.
        """

    @abstractmethod
    def close(self) -> None:
        """Ends this run's part of the journal; errors as for :meth:`flush`."""


def open_journal(folder: Place, name: str, run: str) -> Journal:
    """Opens the journal of a folder.

    Args:
        folder: the folder.
        name: name of the journal.
        run: unique name of this run.

    Raises:
        UnshutterError: the existing journal cannot be read.
    """
    return FileJournal(folder, name) if isinstance(folder, Path) else ObjectJournal(folder, name, run)


class FileJournal(Journal):
    """A journal in one file, to which each line is written at once. Links and files with a second name are refused."""

    def __init__(self, folder: Path, name: str):
        self._path = folder / f"{name}.jsonl"
        self._read_to = 0  # bytes

    def news(self) -> bytes:
        """See :meth:`Journal.news`."""
        try:
            with open(open_plain(self._path, os.O_RDONLY), "rb") as stream:
                stream.seek(self._read_to)
                added = stream.read()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise UnshutterError(f"cannot read {self._path}: {error.strerror}") from None
        whole = added[: added.rfind(b"\n") + 1]
        self._read_to += len(whole)
        return whole

    def add(self, line: str) -> None:
        """See :meth:`Journal.add`."""
        make_folder(self._path.parent)
        try:
            descriptor = open_plain(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
            try:
                add_bytes(descriptor, (("\n" if is_torn(descriptor) else "") + line + "\n").encode())
            finally:
                os.close(descriptor)
        except OSError as error:
            raise UnshutterError(f"cannot write {self._path}: {error.strerror}") from None

    def flush(self) -> None:
        """Does nothing, because lines are not buffered."""

    def close(self) -> None:
        """Does nothing, because lines are not buffered."""


class ObjectJournal(Journal):
    """A journal in objects, one for the lines between two calls of :meth:`flush`.

    Lines that other runs add later are not seen.
    """

    def __init__(self, folder: UPath, name: str, run: str):
        self._folder, self._name, self._run = folder, name, run
        self._lines: list[str] = []  # of this run
        self._pieces: list[int] = [0]  # number of lines written up to each piece
        names = [below for below in objects_below(folder) if below.parts[0] == name and below.suffix == ".jsonl"]
        self._unseen = b"\n".join(read_place(folder / below) for below in names)

    def news(self) -> bytes:
        """See :meth:`Journal.news`."""
        news, self._unseen = self._unseen, b""
        return news

    def add(self, line: str) -> None:
        """See :meth:`Journal.add`."""
        self._lines.append(line + "\n")
        self._unseen += self._lines[-1].encode()

    def flush(self) -> None:
        """See :meth:`Journal.flush`."""
        if len(self._lines) > self._pieces[-1]:
            write_place("".join(self._lines[self._pieces[-1] :]).encode(), self._piece(len(self._pieces)))
            self._pieces.append(len(self._lines))

    def close(self) -> None:
        """Merges the pieces into one."""
        self.flush()
        if len(self._pieces) > 2:
            write_place("".join(self._lines).encode(), self._piece(0))
            for number in range(1, len(self._pieces)):
                remove(self._piece(number))

    def _piece(self, number: int) -> UPath:
        return self._folder / self._name / f"{self._run}-{number:06}.jsonl"


_FIRST_WORDS = b'{"event":'  # at the start of every log


class JsonLog:
    """A log to append to; any other file of that name, such as a photo, is left unchanged.

    Args:
        path: the log; created if missing, in an existing folder.
        protection: protects the files that the run reads.

    Raises:
        UnshutterError: the file cannot be written, is an input of the run, or is not such a log.
    """

    def __init__(self, path: Path, protection: Protection):
        self._path = path
        protection.check(path)
        descriptor = open_plain(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        try:
            if os.read(descriptor, len(_FIRST_WORDS)) not in (b"", _FIRST_WORDS):
                raise UnshutterError(f"{path} is not a log of unshutter: choose another name for --json-log")
            if is_torn(descriptor):
                add_bytes(descriptor, b"\n")
        except OSError as error:
            raise UnshutterError(f"cannot write {path}: {error.strerror}") from None
        finally:
            os.close(descriptor)

    def add(self, event: str, **about: Any) -> None:
        """Appends an event.

        Raises:
            UnshutterError: the log cannot be written.
        """
        add_text(self._path, json.dumps({"event": event, **about}) + "\n")
