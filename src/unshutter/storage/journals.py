"""Journals, to which one run at a time adds lines: a file or, behind a URL, several objects.

Objects can be neither appended to nor locked: each run writes pieces, ``NAME/RUN-NUMBER.jsonl``, and merges them at the
end.
"""

from __future__ import annotations

import os
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage import objects
from unshutter.storage.files import is_torn, lock, make_folder, open_plain, write_all
from unshutter.storage.objects import is_object


def journal_in(folder: Path, name: str, run: str, read_only: bool = False) -> FileJournal | ObjectJournal:
    """Returns the journal of a folder for one run; nothing is written before the first line."""
    return ObjectJournal(folder, name, run) if is_object(folder) else FileJournal(folder, name, read_only)


class FileJournal:
    """A journal in one file, to which each line is written at once. Links and files with a second name are refused.

    The file is opened once: if its folder is then replaced by a link, the lines still reach the file that was
    checked. The run that writes to it locks it: the system ends the lock with the process, however that ends.
    """

    def __init__(self, folder: Path, name: str, read_only: bool = False):
        self._path = folder / f"{name}.jsonl"
        self._read_only = read_only
        self._locked: int | None = None  # descriptor that holds the lock
        self._file: int | None = None  # descriptor to which lines are written

    def read(self) -> bytes:
        """Returns the complete lines of earlier runs; raises UnshutterError if another run writes to the journal."""
        if not self._read_only and os.path.lexists(self._path):
            self._locked = self._lock(open_plain(self._path, os.O_RDONLY))
        try:
            with open(open_plain(self._path, os.O_RDONLY), "rb") as stream:
                text = stream.read()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise UnshutterError(f"cannot read {self._path}: {error.strerror}") from None
        return text[: text.rfind(b"\n") + 1]

    def add(self, line: str) -> None:
        """Appends a line."""
        if self._file is None:
            self._file = self._open_to_add()
        try:
            write_all(self._file, (("\n" if is_torn(self._file) else "") + line + "\n").encode())
        except OSError as error:
            raise UnshutterError(f"cannot write {{file}}: {error.strerror}", file=self._path) from None

    def flush(self) -> None:
        """Does nothing: lines are not buffered."""

    def close(self) -> None:
        """Lets other runs use the journal."""
        for descriptor in {self._locked, self._file}:
            if descriptor is not None:
                os.close(descriptor)
        self._locked = self._file = None

    def _open_to_add(self) -> int:
        """Opens the file, creating it if necessary; raises UnshutterError if it is not the one that was read."""
        make_folder(self._path.parent)
        descriptor = open_plain(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        if self._locked is None:
            self._locked = self._lock(descriptor)
        elif not os.path.sameopenfile(descriptor, self._locked):
            os.close(descriptor)
            raise UnshutterError(
                "{file} was replaced while this run used it: run the same command again", file=self._path
            )
        return descriptor

    def _lock(self, descriptor: int) -> int:
        """Locks an open file and returns its descriptor."""
        if lock(descriptor) is not False:
            return descriptor
        os.close(descriptor)
        raise UnshutterError(
            "another run is writing to {folder}: wait until it has ended, or choose another folder",
            folder=self._path.parent,
        )


class ObjectJournal:
    """A journal in objects, one for the lines between two calls of :meth:`flush`."""

    def __init__(self, folder: Path, name: str, run: str):
        self._folder = folder
        self._name = name
        self._run = run
        self._lines: list[str] = []  # of this run
        self._pieces: list[int] = [0]  # number of lines written up to each piece

    def read(self) -> bytes:
        """Returns the lines of earlier runs."""
        below = objects.objects_below(self._folder)
        pieces = [each for each in below if each.parts[0] == self._name and each.suffix == ".jsonl"]
        return b"\n".join(objects.read_object(self._folder / piece) for piece in pieces)

    def add(self, line: str) -> None:
        """Appends a line, which the next flush writes."""
        self._lines.append(line + "\n")

    def flush(self) -> None:
        """Writes pending lines."""
        if len(self._lines) > self._pieces[-1]:
            objects.send("".join(self._lines[self._pieces[-1] :]).encode(), self._piece(len(self._pieces)))
            self._pieces.append(len(self._lines))

    def close(self) -> None:
        """Writes pending lines and merges the pieces into one."""
        self.flush()
        if len(self._pieces) > 2:
            objects.send("".join(self._lines).encode(), self._piece(0))
            for number in range(1, len(self._pieces)):
                objects.remove_object(self._piece(number))

    def _piece(self, number: int) -> Path:
        return self._folder / self._name / f"{self._run}-{number:06}.jsonl"
