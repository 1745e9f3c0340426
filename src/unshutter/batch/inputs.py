"""Which files are meant, and where the result of each goes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from unshutter.errors import UnshutterError, UsageError

PHOTO_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".avif"}
RECTIFIED = ".rectified"


def find_photos(given: Iterable[Path]) -> tuple[list[Path], bool]:
    """The photos that were meant, folders expanded (one level, sorted); and whether several were meant.

    Pictures that unshutter wrote beside their originals (``*.rectified.*``) are passed over in folders.

    Raises:
        UnshutterError: a folder without photos.
        UsageError: nothing given.
    """
    files: list[Path] = []
    many = False
    for path in given:
        if path.is_dir():
            many = True
            inside = [p for p in sorted(path.iterdir()) if p.suffix.lower() in PHOTO_SUFFIXES and p.is_file()]
            inside = [p for p in inside if not p.stem.endswith(RECTIFIED)]
            if not inside:
                raise UnshutterError(f"no photos in folder {path} (looked for {', '.join(sorted(PHOTO_SUFFIXES))})")
            files += inside
        else:
            files.append(path)
    if not files:
        raise UsageError("no photo given")
    unique = list(dict.fromkeys(files))
    return unique, many or len(unique) > 1


def plan_targets(files: list[Path], output: Path | None, many: bool, name: Callable[[Path], str]) -> dict[Path, Path]:
    """Where each photo's result goes."""
    if output is None:
        targets = {photo: photo.with_name(name(photo)) for photo in files}
    elif many or output.is_dir() or not output.suffix:  # a name without an ending is meant as a folder
        if output.exists() and not output.is_dir():
            raise UsageError(f"several photos need a folder to go to, but {output} is a file")
        try:
            output.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnshutterError(f"cannot make folder {output}: {error.strerror}") from None
        targets = {photo: output / name(photo) for photo in files}
    else:
        targets = {files[0]: output}
    taken: dict[Path, Path] = {}
    for photo, target in targets.items():
        if target in taken:
            raise UsageError(f"{photo} and {taken[target]} would both be written to {target}")
        taken[target] = photo
    return targets
