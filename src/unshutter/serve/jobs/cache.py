"""What a job found out about an open photo or clip, kept in the file's folder for the next job."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from unshutter.errors import errors_in_one_line
from unshutter.options import Find, Neighbours

if TYPE_CHECKING:
    import numpy as np

    from unshutter.motion import Motion
    from unshutter.photo import Photo

Kind: TypeAlias = Literal["photo", "clip"]


@dataclass(frozen=True)
class OpenFile:
    """An open photo or clip.

    Attributes:
        id: by which the page and programs name it.
        kind: what it is, and is called in messages.
        name: of the file that was sent, as far as it is safe for a file.
        path: where it lies, alone in a folder with what jobs found out about it.
        max_pixels: photos with more are refused.
    """

    id: str
    kind: Kind
    name: str
    path: Path
    max_pixels: int


def opened(open_file: OpenFile) -> Photo:
    """The photo, nothing of its pixels decoded yet."""
    from unshutter.photo import Photo

    return Photo.open(open_file.path, open_file.max_pixels)


def found_motion(open_file: OpenFile, photo: Photo, find: Find) -> Motion:
    """The photo's motion, first row as the reference."""
    from unshutter.estimators.register import load, method
    from unshutter.motion import Motion
    from unshutter.rectification import estimate_photo

    file = motion_file(open_file, find)
    if file.exists():
        return Motion.from_json(file.read_text(encoding="utf-8"))
    photo.start_decoding(grey_px=method(find.estimator).grey_px, whole=False)
    motion = estimate_photo(photo, load(find.estimator), find.camera)
    put(file, lambda part: part.write_text(motion.to_json(), encoding="utf-8"))
    return motion


def motion_file(open_file: OpenFile, find: Find) -> Path:
    """Where its motion lies, once it was found in this way."""
    digest = hashlib.sha256(repr(find).encode()).hexdigest()[:16]
    return open_file.path.with_name(f"motion-{digest}.json")


def small_copy(open_file: OpenFile, photo: Photo, longest: int | None) -> np.ndarray:
    """A copy of the stored pixels for the screen; of the full size none is kept."""
    import numpy as np

    if longest is None:
        return photo.screen_copy()
    file = open_file.path.with_name(f"copy-{longest}.npy")
    if file.exists():
        return np.load(file, mmap_mode="r")
    pixels = photo.screen_copy(longest)

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.save(stream, pixels)

    put(file, write)
    return pixels


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
