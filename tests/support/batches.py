"""Folders of small photos, and the command run over them as users run it."""

import hashlib
import subprocess
import sys
from functools import cache
from pathlib import Path

from support.drawn_photos import drawn
from unshutter import RowMotion
from unshutter.cli import main
from unshutter.photo import Photo

HEIGHT, WIDTH = 72, 96
_FORMATS = {".jpg": "jpeg", ".png": "png", ".webp": "webp", ".tif": "tiff"}


def make_photos(folder: Path, names: list[str]) -> None:
    """Small pictures, each a little different, of the formats that the names ask for."""
    for k, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_encoded(k, path.suffix))


@cache
def _encoded(number: int, ending: str) -> bytes:
    pixels = drawn(HEIGHT, WIDTH)
    pixels[: number % 50 + 3, : number // 50 + 5] = number % 251
    return Photo.from_array(pixels).to_bytes(_FORMATS[ending])


def make_motion(path: Path) -> Path:
    """A motion that changes every small photo, for batches that are not about estimating."""
    RowMotion.from_polynomials([0, 6, -9], [0, 0.05], HEIGHT, WIDTH).save(path)
    return path


def rectify(*arguments: object) -> int:
    """``unshutter rectify`` in this process; its exit code."""
    return main(["rectify", *map(str, arguments)])


def rectified(photo: Path, *flags: object) -> bytes:
    """The file that ``unshutter rectify`` writes of a photo."""
    result = photo.with_name(f"expected{photo.suffix}")
    assert rectify(photo, "-o", result, "--overwrite", *flags) == 0
    return result.read_bytes()


def start_rectify(*arguments: object, **options) -> subprocess.Popen:
    """``unshutter rectify`` in a process of its own."""
    command = [sys.executable, "-m", "unshutter", "rectify", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def results(folder: Path) -> dict[str, str]:
    """Relative path -> digest of every picture below a folder, temporary files among them."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix not in (".jsonl", ".json")
    }


def leave_some_undone(folder: Path, names: set[str], more: int = 20) -> int:
    """Deletes photos of a batch that was stopped, but for those that are done and a few others: going on is quick.

    Args:
        folder: of the photos.
        names: of the results.
        more: photos to be left besides.

    Returns:
        Number of photos in the folder.
    """
    undone = [path for path in sorted(folder.iterdir()) if not any(name.startswith(path.stem) for name in names)]
    for path in undone[more:]:
        path.unlink()
    return len(list(folder.iterdir()))


def leftovers(folder: Path) -> list[str]:
    """Temporary files below a folder."""
    return [path.name for path in folder.rglob(".unshutter-*")]
