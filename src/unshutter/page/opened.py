"""Open photos and clips: their files and caches, the progress of jobs, and error messages."""

from __future__ import annotations

import hashlib
import json
import math
import os
import pickle
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

from unshutter.errors import errors_in_one_line
from unshutter.options import Neighbours
from unshutter.progress import ClipObserver
from unshutter.reasons import JsonObject

T = TypeVar("T")
Kind: TypeAlias = Literal["photo", "clip"]

MOMENTS = 5  # number of moments of a clip that are shown


@dataclass(frozen=True)
class OpenFile:
    """An open photo or clip."""

    id: str  # identifier used by the page
    kind: Kind  # photo or clip; also its name in messages
    name: str  # sanitised name of the uploaded file
    path: Path  # path of the file, in a folder of its own that also holds its cache
    max_pixels: int  # largest photo allowed [px]


@dataclass
class ProgressFile(ClipObserver):
    """A file to which a worker writes its progress for the server to read."""

    file: Path
    _noted_s: float = field(default=-math.inf, init=False)
    _now: JsonObject = field(default_factory=dict, init=False)

    def read(self) -> JsonObject | None:
        """Returns the latest progress as noted, or None if the job has not started yet."""
        try:
            return json.loads(self.file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None

    def note_progress(self, what: str, done: int, total: int) -> None:
        """Notes the step that is under way; ``total`` is 0 if not known yet."""
        self._note({"what": what, "done": done, "total": total}, done >= total)

    def note_share(self, share: float, left_s: float | None) -> None:
        """Notes how much of the whole work is done, and how long the rest takes [s]."""
        self._note({"share": share, "left_s": left_s}, share == 1.0)

    def _note(self, news: JsonObject, at_once: bool) -> None:
        """Writes what is known now, at most a few times a second."""
        self._now |= news
        now_s = time.monotonic()
        if now_s - self._noted_s >= 0.2 or at_once:
            self._noted_s = now_s
            put_text(self.file, json.dumps(self._now))


def progress_of(open_file: OpenFile) -> ProgressFile:
    """Returns the file that holds the progress of the search for a clip's readout time, or of its video."""
    return ProgressFile(open_file.path.with_name("progress.json"))


def hash_options(*values: object) -> str:
    """Hashes a combination of options into a short name."""
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


def put(file: Path, write: Callable[[Path], object]) -> None:
    """Writes a file atomically, since another worker may be writing it at the same time."""
    part = file.with_name(f"{os.getpid()}-{file.name}")  # with its suffix, which may determine the format
    write(part)
    os.replace(part, file)


def put_text(file: Path, text: str) -> None:
    """Writes a text file atomically."""
    put(file, lambda part: part.write_text(text, encoding="utf-8"))


def remembered(open_file: OpenFile, what: str, key: tuple[object, ...], make: Callable[[], T]) -> T:
    """Returns the result of ``make``, of any type, from the cache if it is there: only this program writes there."""
    file = open_file.path.with_name(f"{what}-{hash_options(*key)}.pickle")
    if not file.exists():
        made = make()
        put(file, lambda part: part.write_bytes(pickle.dumps(made)))
        return made
    return pickle.loads(file.read_bytes())


@contextmanager
def errors_of(open_file: OpenFile, names: Mapping[Path, str] | None = None) -> Iterator[None]:
    """Turns errors in the block into one line that refers to files by names that the user recognises."""
    what = "the clip" if open_file.kind == "clip" else "the file"  # which may be no photo at all
    called = {open_file.path: what, **(names or {})}
    with errors_in_one_line(names={str(path): name for path, name in called.items()}):
        yield


def neighbour_names(neighbours: Neighbours) -> dict[Path, str]:
    """Maps the paths of a photo's neighbours to their name in messages."""
    return dict.fromkeys(filter(None, (neighbours.before, neighbours.after)), "its neighbour")
