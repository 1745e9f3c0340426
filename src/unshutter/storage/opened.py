"""Opened: a file as it was when it was opened; later its name may lead to another file, or to none."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unshutter.storage.files import Times


@dataclass(frozen=True)
class Opened:
    """A file that was opened: its path and identity at that time.

    Attributes:
        path: its absolute path, which leads to it from any working folder.
        identity: device, inode, size [bytes] and time of modification [ns]; None if there was no such file.
        times_ns: times of the last access and modification [ns].
    """

    path: Path
    identity: tuple[int, int, int, int] | None = None
    times_ns: Times | None = field(default=None, compare=False)

    @classmethod
    def at(cls, path: str | os.PathLike[str], descriptor: int | None = None) -> Opened:
        """Returns the file of a name, or that of an open descriptor."""
        with suppress(OSError, ValueError):
            status = os.stat(path if descriptor is None else descriptor)
            identity = status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
            return cls(_absolute(path), identity, (status.st_atime_ns, status.st_mtime_ns))
        return cls(_absolute(path))

    @classmethod
    def behind(cls, source: Any) -> Opened | None:
        """Returns the file behind a path, a stream, a Pillow image or a mapped array; None if there is none."""
        if isinstance(source, (str, os.PathLike)):
            return cls.at(source)
        name = getattr(source, "name", None) or getattr(source, "filename", None)
        descriptor = None
        with suppress(OSError, ValueError, AttributeError, TypeError):
            descriptor = source.fileno()
        if isinstance(name, (str, bytes, os.PathLike)):
            return cls.at(os.fsdecode(name), descriptor)
        return cls.at(os.devnull, descriptor) if descriptor is not None else None

    def is_at(self, path: Path) -> bool:
        """Whether the file of a name is this one, renamed or not."""
        return self.identity is not None and Opened.at(path).identity == self.identity

    def was_replaced(self) -> bool:
        """Whether its name has come to stand for other contents; False if the file is gone."""
        now = Opened.at(self.path).identity
        return None not in (self.identity, now) and now != self.identity


def _absolute(path: str | os.PathLike[str]) -> Path:
    try:
        return Path(os.path.abspath(path))
    except FileNotFoundError:  # the working folder was removed
        return Path(path)
