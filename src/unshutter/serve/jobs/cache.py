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
class Held:
    """A photo or clip as a lane is handed it.

    Attributes:
        path: its file, alone in a folder with what is found about it.
        max_pixels: of photos, more are refused.
        kind: what it is called in messages.
    """

    path: Path
    max_pixels: int
    kind: Kind = "photo"


def opened(held: Held) -> Photo:
    """The photo, nothing of its pixels decoded yet."""
    from unshutter.photo import Photo

    return Photo.open(held.path, held.max_pixels)


def found_motion(held: Held, photo: Photo, find: Find) -> Motion:
    """The photo's motion, first row as the reference."""
    from unshutter.estimators.register import load, method
    from unshutter.motion import Motion
    from unshutter.rectification import estimate_photo

    file = motion_file(held, find)
    if file.exists():
        return Motion.from_json(file.read_text(encoding="utf-8"))
    photo.start_decoding(grey_px=method(find.estimator).grey_px, whole=False)
    motion = estimate_photo(photo, load(find.estimator), find.camera)
    put(file, lambda part: part.write_text(motion.to_json(), encoding="utf-8"))
    return motion


def motion_file(held: Held, find: Find) -> Path:
    """Where its motion lies, once it was found in this way."""
    digest = hashlib.sha256(repr(find).encode()).hexdigest()[:16]
    return held.path.with_name(f"motion-{digest}.json")


def small_copy(held: Held, photo: Photo, longest: int | None) -> np.ndarray:
    """A copy of the stored pixels for the screen; of the full size none is kept."""
    import numpy as np

    if longest is None:
        return photo.screen_copy()
    file = held.path.with_name(f"copy-{longest}.npy")
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
def errors_of(held: Held, names: Mapping[Path, str] | None = None) -> Iterator[None]:
    """Errors in the block are one line, in which files go by names that mean something to whoever sent them.

    Args:
        held: the file that is worked on: "the photo" or "the clip".
        names: path -> name of further files.

    Raises:
        UnshutterError: whatever went wrong.
    """
    called = {held.path: f"the {held.kind}", **(names or {})}
    with errors_in_one_line(names={str(path): name for path, name in called.items()}):
        yield


def neighbour_names(neighbours: Neighbours) -> dict[Path, str]:
    """What a photo's neighbours are called in messages, by their paths."""
    return dict.fromkeys(filter(None, (neighbours.before, neighbours.after)), "its neighbour")
