"""Open files, and what jobs keep next to them for later jobs: motions, progress."""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from unshutter.errors import errors_in_one_line
from unshutter.estimators.register import load, method
from unshutter.options import Find, Neighbours
from unshutter.photo import Photo

if TYPE_CHECKING:
    from unshutter.motion import Motion
    from unshutter.motion.candidate import Candidate

Kind: TypeAlias = Literal["photo", "clip"]

_NOTE_S = 0.2  # between two notes of progress


@dataclass(frozen=True)
class OpenFile:
    """An open photo or clip.

    Attributes:
        id: by which the page and programs name it.
        kind: what it is, and is called in messages.
        name: of the file that was sent, as far as it is safe for a file.
        path: where it lies, alone in a folder with what jobs keep about it.
        max_pixels: photos with more are refused.
    """

    id: str
    kind: Kind
    name: str
    path: Path
    max_pixels: int


@dataclass(frozen=True)
class Progress:
    """The progress of a long job.

    Attributes:
        what: what is counted.
        done, total: how many are done, of how many; 0: not known yet.
    """

    what: str
    done: int = 0
    total: int = 0


@dataclass
class ProgressFile:
    """The file in which a worker notes its progress, for the server to read.

    Attributes:
        file: its path.
    """

    file: Path
    _noted_s: float = field(default=-math.inf, init=False)

    def read(self) -> Progress | None:
        """The last progress that was noted; None: nothing was begun yet."""
        try:
            return Progress(**json.loads(self.file.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None

    def note(self, what: str, done: int, total: int) -> None:
        """Notes the progress, a few times a second at most."""
        now = time.monotonic()
        if now - self._noted_s < _NOTE_S and done < total:
            return
        self._noted_s = now
        text = json.dumps(asdict(Progress(what, done, total)))
        put(self.file, lambda part: part.write_text(text, encoding="utf-8"))


def opened(open_file: OpenFile) -> Photo:
    """The photo, nothing of its pixels decoded yet."""
    return Photo.open(open_file.path, open_file.max_pixels)


def motion_of(open_file: OpenFile, photo: Photo, find: Find) -> Motion:
    """The photo's motion, that of the candidate a person has chosen or the first; first row as the reference.

    Raises:
        UnshutterError: there are fewer candidates.
    """
    from unshutter.estimators.find import chosen

    return chosen(candidates_of(open_file, photo, find), find.camera.candidate)


def candidates_of(open_file: OpenFile, photo: Photo, find: Find) -> tuple[Candidate, ...]:
    """The motions that fit a photo, estimated unless a job has done so before; first row as the reference."""
    from unshutter.rectification import photo_candidates

    kept = kept_candidates(open_file, find)
    if kept is not None:
        return kept
    photo.start_decoding(grey_px=method(find.estimator).grey_px, whole=False)
    candidates = photo_candidates(photo, load(find.estimator), find.camera)
    text = json.dumps([{**vars(each), "motion": each.motion.to_json()} for each in candidates])
    put(_candidates_file(open_file, find), lambda part: part.write_text(text, encoding="utf-8"))
    return candidates


def kept_candidates(open_file: OpenFile, find: Find) -> tuple[Candidate, ...] | None:
    """The candidates that a job has found with these options; None: none has."""
    from unshutter.motion import Motion
    from unshutter.motion.candidate import Candidate

    file = _candidates_file(open_file, find)
    if not file.exists():
        return None
    listed = json.loads(file.read_text(encoding="utf-8"))
    return tuple(Candidate(**{**each, "motion": Motion.from_json(each["motion"])}) for each in listed)


def _candidates_file(open_file: OpenFile, find: Find) -> Path:
    """Where candidates are kept: all of them, whichever is chosen."""
    find = replace(find, camera=replace(find.camera, candidate=None))
    return open_file.path.with_name(f"candidates-{digest(find)}.json")


def digest(*values: object) -> str:
    """A short name for a combination of options."""
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


def put(file: Path, write: Callable[[Path], Any]) -> None:
    """Makes a file that another lane may be making, too: whole or not at all."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    write(part)
    os.replace(part, file)


@contextmanager
def errors_of(open_file: OpenFile, names: Mapping[Path, str] | None = None) -> Iterator[None]:
    """Errors in the block are one line, in which files go by names that mean something to whoever sent them.

    Args:
        open_file: the photo or clip that is worked on, called just that.
        names: path -> name of further files.

    Raises:
        UnshutterError: whatever went wrong.
    """
    called = {open_file.path: f"the {open_file.kind}", **(names or {})}
    with errors_in_one_line(names={str(path): name for path, name in called.items()}):
        yield


def neighbour_names(neighbours: Neighbours) -> dict[Path, str]:
    """What a photo's neighbours are called in messages, by their paths."""
    return dict.fromkeys(filter(None, (neighbours.before, neighbours.after)), "its neighbour")
