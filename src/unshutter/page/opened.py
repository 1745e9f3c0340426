"""Open files as jobs see them: small upright copies for the screen, positions in them, progress and errors.

Positions for the page are shares of the upright picture's width and height, with (0, 0) at the top left corner.
"""

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
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from unshutter.errors import errors_in_one_line
from unshutter.options import Neighbours
from unshutter.orientation import Orientation, ScanDirection
from unshutter.photo import Photo
from unshutter.photo.libvips import as_image, refusing
from unshutter.photo.photo import open_photo
from unshutter.progress import ClipObserver
from unshutter.reasons import JsonObject

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

T = TypeVar("T")
Kind: TypeAlias = Literal["photo", "clip"]

_NOTE_S = 0.2  # between progress updates
_QUALITY = 88  # of JPEGs for the screen

# readout directions in the stored picture as (right, down), by quarter turns; names of those in the upright picture
_READ = ((0, 1), (-1, 0), (0, -1), (1, 0))
_ARROWS = {(0, 1): "down", (0, -1): "up", (1, 0): "right", (-1, 0): "left"}


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
        if now_s - self._noted_s >= _NOTE_S or at_once:
            self._noted_s = now_s
            put_text(self.file, json.dumps(self._now))


def opened(open_file: OpenFile) -> Photo:
    """Opens the photo without decoding its pixels."""
    return open_photo(open_file.path, open_file.max_pixels)


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


def kept(open_file: OpenFile, what: str, key: tuple[object, ...], make: Callable[[], T]) -> T:
    """Returns what ``make`` returned as JSON for these options, made now unless a worker has done so before."""
    file = open_file.path.with_name(f"{what}-{hash_options(*key)}.json")
    if not file.exists():
        put_text(file, json.dumps(make()))
    return json.loads(file.read_text(encoding="utf-8"))


def remembered(open_file: OpenFile, what: str, key: tuple[object, ...], make: Callable[[], T]) -> T:
    """Returns what ``make`` returned, of whatever kind; nobody but this program writes into the folder."""
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


# ---- copies for the screen, and positions in them --------------------------------------------------------------


def small_copy(open_file: OpenFile, photo: Photo, longest: int | None) -> np.ndarray:
    """Returns a copy of the stored pixels whose longer side is at most ``longest`` px, and caches it unless None."""
    import numpy as np

    if longest is None:
        return photo.screen_copy()
    file = open_file.path.with_name(f"copy-{longest}.npy")
    if file.exists():
        return np.load(file, mmap_mode="r")
    pixels = photo.screen_copy(longest)
    put(file, lambda part: np.save(part, pixels))
    return pixels


def as_jpeg(pixels: np.ndarray, orientation: int = 1) -> bytes:
    """Encodes stored pixels as an upright JPEG for the screen."""
    with refusing("cannot encode the copy for the screen"):
        return as_image(Orientation(orientation).upright(pixels)).jpegsave_buffer(Q=_QUALITY, keep=0)


def shares(col: ArrayLike, row: ArrayLike, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts stored positions ([N] each, pixel centres at whole numbers) to [N, 2] shares of the upright picture.

    ``size`` is width and height of the stored picture [px].
    """
    import numpy as np

    across = (np.asarray(col) + 0.5) / size[0]
    down = (np.asarray(row) + 0.5) / size[1]
    return np.stack(Orientation(orientation).upright_point(across, down), axis=-1)


def pixels_of(across: ArrayLike, down: ArrayLike, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Converts shares ([N] each) of the upright picture to [N, 2] stored positions; inverts :func:`shares`."""
    import numpy as np

    across, down = Orientation(orientation).stored_point(np.asarray(across), np.asarray(down))
    return np.stack([across * size[0] - 0.5, down * size[1] - 0.5], axis=-1)


def corners_of(window: tuple[float, float, float, float], orientation: int) -> list[float]:
    """Converts a window (left, top, right, bottom) from shares of the stored picture to shares of the upright one."""
    import numpy as np

    left, top, right, bottom = window
    across, down = Orientation(orientation).upright_point(np.array([left, right]), np.array([top, bottom]))
    return [float(across.min()), float(down.min()), float(across.max()), float(down.max())]


def arrows(orientation: int) -> dict[str, str]:
    """Maps each readout direction to its direction in the upright picture: up, down, left or right."""
    upright = Orientation(orientation).upright_direction
    return {
        str(scan_direction): _ARROWS[upright(*_READ[scan_direction.quarter_turns])] for scan_direction in ScanDirection
    }
