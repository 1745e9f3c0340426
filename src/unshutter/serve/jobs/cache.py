"""Open files, and the cache of motions and progress that jobs keep next to them."""

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

_NOTE_S = 0.2  # between progress updates


@dataclass(frozen=True)
class OpenFile:
    """An open photo or clip.

    Attributes:
        id: identifier used by the page and by programs.
        kind: photo or clip; also its name in messages.
        name: sanitised name of the uploaded file.
        path: path of the file, in a folder of its own that also holds its cache.
        max_pixels: largest photo allowed [px].
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
        what: plural noun for the items counted.
        done, total: number of items done and in all; 0 if not known yet.
    """

    what: str
    done: int = 0
    total: int = 0


@dataclass
class ProgressFile:
    """A file to which a worker writes its progress for the server to read.

    Attributes:
        file: path of the file.
    """

    file: Path
    _noted_s: float = field(default=-math.inf, init=False)

    def read(self) -> Progress | None:
        """Returns the latest progress, or None if the job has not started yet."""
        try:
            return Progress(**json.loads(self.file.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None

    def note(self, what: str, done: int, total: int) -> None:
        """Writes the progress, at most a few times a second."""
        now = time.monotonic()
        if now - self._noted_s < _NOTE_S and done < total:
            return
        self._noted_s = now
        text = json.dumps(asdict(Progress(what, done, total)))
        put(self.file, lambda part: part.write_text(text, encoding="utf-8"))


def opened(open_file: OpenFile) -> Photo:
    """Opens the photo without decoding its pixels."""
    return Photo.open(open_file.path, open_file.max_pixels)


def motion_of(open_file: OpenFile, photo: Photo, find: Find) -> Motion:
    """Returns the motion of the chosen candidate, or of the first one; the first row is the reference.

    Raises:
        UnshutterError: the chosen candidate does not exist.
    """
    from unshutter.estimators.find import chosen

    return chosen(candidates_of(open_file, photo, find), find.camera.candidate)


def candidates_of(open_file: OpenFile, photo: Photo, find: Find) -> tuple[Candidate, ...]:
    """Returns the motions that fit a photo, estimating them unless cached; the first row is the reference."""
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
    """Returns the candidates cached for these options, or None if they have not been estimated yet."""
    from unshutter.motion import Motion
    from unshutter.motion.candidate import Candidate

    file = _candidates_file(open_file, find)
    if not file.exists():
        return None
    listed = json.loads(file.read_text(encoding="utf-8"))
    return tuple(Candidate(**{**each, "motion": Motion.from_json(each["motion"])}) for each in listed)


def _candidates_file(open_file: OpenFile, find: Find) -> Path:
    """Returns the path of the cache file of all candidates, which does not depend on the one chosen."""
    find = replace(find, camera=replace(find.camera, candidate=None))
    return open_file.path.with_name(f"candidates-{digest(find)}.json")


def digest(*values: object) -> str:
    """Hashes a combination of options into a short name."""
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


def put(file: Path, write: Callable[[Path], Any]) -> None:
    """Writes a file atomically, since another worker may be writing it at the same time."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    write(part)
    os.replace(part, file)


@contextmanager
def errors_of(open_file: OpenFile, names: Mapping[Path, str] | None = None) -> Iterator[None]:
    """Turns errors in the block into one line that refers to files by names that the user recognises.

    Args:
        open_file: the file being processed, called "the photo" or "the clip".
        names: path -> name of other files.

    Raises:
        UnshutterError: any error in the block.
    """
    called = {open_file.path: f"the {open_file.kind}", **(names or {})}
    with errors_in_one_line(names={str(path): name for path, name in called.items()}):
        yield


def neighbour_names(neighbours: Neighbours) -> dict[Path, str]:
    """Maps the paths of a photo's neighbours to their name in messages."""
    return dict.fromkeys(filter(None, (neighbours.before, neighbours.after)), "its neighbour")
