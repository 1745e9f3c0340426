"""The same job for many files: which files, where the results go, what went wrong, how far it is."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, UsageError
from unshutter.files import check_target, written_whole
from unshutter.photo import Photo
from unshutter.progress import Progress

if TYPE_CHECKING:
    from unshutter.motion import Reference
    from unshutter.warp import Edges

Tell = Callable[[str], None]  # says a line to the user
PHOTO_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".avif"}
RECTIFIED = ".rectified"


@dataclass(frozen=True)
class RectifyOptions:
    """What ``unshutter rectify`` was told; see the command's help."""

    estimator: str
    motion: Path | None
    reference: Reference | None
    strength: float
    edges: Edges
    readout: str
    quality: int | None
    overwrite: bool


def rectify_files(photos: list[Path], output: Path | None, save_motion: Path | None, options: RectifyOptions) -> int:
    """Rectifies each photo into its own file; returns the exit code."""
    if options.quality is not None and not 1 <= options.quality <= 100:
        raise UsageError(f"quality must lie between 1 and 100, got {options.quality}")
    if not 0 <= options.strength <= 1:
        raise UsageError(f"strength must lie between 0 and 1, got {options.strength:g}")
    files, many = find_photos(photos)
    ahead = _ReadAhead(files)  # decodes while the heavy libraries are imported
    from unshutter.estimators import load
    from unshutter.motion import Motion
    from unshutter.rectification import rectify

    given = Motion.load(options.motion) if options.motion else None
    estimator = options.estimator if given else load(options.estimator)
    targets = _targets(files, output, many, lambda photo: f"{photo.stem}{RECTIFIED}{photo.suffix}")
    motion_targets = _targets(files, save_motion, many, lambda photo: f"{photo.stem}.json") if save_motion else {}

    def one(photo: Path, tell: Tell) -> None:
        target, motion_target = targets[photo], motion_targets.get(photo)
        check_target(target, options.overwrite, photo)
        if motion_target:
            check_target(motion_target, options.overwrite, photo)
        result = rectify(
            ahead.photo(photo),
            estimator=estimator,
            motion=given,
            readout=options.readout,
            reference=options.reference,
            strength=options.strength,
            edges=options.edges,
        )
        result.save(target, overwrite=options.overwrite, quality=options.quality)
        if motion_target:
            result.motion.save(motion_target)
        note = f" (unchanged: {result.motion.reason})" if result.motion.reason else ""
        tell(f"{photo} -> {target}{note}")

    return _each(files, one)


def estimate_files(
    photos: list[Path],
    output: Path | None,
    plot: Path | None,
    estimator_name: str,
    reference: Reference,
    readout: str,
    overwrite: bool,
    readout_ms: float | None = None,
) -> int:
    """Estimates the motion of each photo; returns the exit code."""
    files, many = find_photos(photos)
    if many and output is None:
        raise UsageError("several photos need --output FOLDER for their motions")
    if many and plot:
        raise UsageError("--plot draws the motion of one photo only")
    ahead = _ReadAhead(files)
    from unshutter.estimators import load
    from unshutter.rectification import estimate
    from unshutter.speed import check_readout_ms, json_with_speed

    if readout_ms is not None:
        check_readout_ms(readout_ms)
    estimator = load(estimator_name)
    targets = _targets(files, output, many, lambda photo: f"{photo.stem}.json") if output else {}

    def one(photo: Path, tell: Tell) -> None:
        target = targets.get(photo)
        if target:
            check_target(target, overwrite, photo)
        if plot:
            check_target(plot, overwrite, photo)
        motion = estimate(ahead.photo(photo), estimator=estimator, readout=readout, reference=reference)
        if motion.reason:
            tell(f"{photo}: no motion ({motion.reason})")
        if plot:
            from unshutter.plot import plot_motion

            plot_motion(motion, plot, title=photo.name, readout_ms=readout_ms)
        text = motion.to_json() if readout_ms is None else json_with_speed(motion, readout_ms)
        if target:
            with written_whole(target) as part:
                part.write_text(text + "\n", encoding="utf-8")
        else:
            print(text)

    return _each(files, one)


def synthesize_files(
    photos: list[Path],
    output: Path,
    per_photo: int,
    seed: int,
    motion: str,
    trajectory: Path | None,
    readout_ms: float | None,
    focal_px: float | None,
    size: int,
    canvas: int,
) -> int:
    """Makes rolling-shutter pictures from photos; returns the exit code."""
    from unshutter.synthesis.pairs import synthesize_folder

    files, _ = find_photos(photos)
    with Progress(len(files)) as bar:
        failed = synthesize_folder(
            files,
            output,
            per_photo=per_photo,
            seed=seed,
            motion=motion,
            trajectory=trajectory,
            readout_ms=readout_ms,
            focal_px=focal_px,
            size=size,
            canvas=canvas,
            progress=bar.advance,
        )
        for photo, message in failed:
            bar.tell(f"unshutter: {photo}: {message}")
    return _count(len(failed), len(files))


class _ReadAhead:
    """Reads and decodes the next photo while the one before is worked on; two are held at a time."""

    def __init__(self, files: list[Path]):
        self._files = iter(files)
        self._reader = ThreadPoolExecutor(1)
        self._coming: dict[Path, Future[Photo]] = {}
        self._start_next()

    def photo(self, path: Path) -> Photo:
        """The photo, decoded. Paths must come in the order of the list; they may leave some out."""
        while path not in self._coming:
            self._start_next()
        coming = self._coming[path]
        self._coming.clear()
        self._start_next()
        return coming.result()

    def _start_next(self) -> None:
        path = next(self._files, None)
        if path is not None:
            self._coming[path] = self._reader.submit(_decoded, path)


def _decoded(path: Path) -> Photo:
    photo = Photo.open(path)
    _ = photo.image  # decoded here, kept there
    return photo


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


def _targets(files: list[Path], output: Path | None, many: bool, name: Callable[[Path], str]) -> dict[Path, Path]:
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


def _each(files: list[Path], one: Callable[[Path, Tell], None]) -> int:
    """Does ``one`` for each file, goes on past those that fail; returns the exit code."""
    failed = 0
    with Progress(len(files)) as bar:
        for photo in files:
            try:
                _with_name(photo, lambda photo: one(photo, bar.tell))
            except UnshutterError as error:
                if len(files) == 1:
                    raise
                failed += 1
                bar.tell(f"unshutter: {error}")
            bar.advance()
    return _count(failed, len(files))


def _with_name(photo: Path, one: Callable[[Path], None]) -> None:
    """Errors name their photo; what nobody foresaw becomes one line, too (UNSHUTTER_DEBUG=1 shows it whole)."""
    try:
        one(photo)
    except UnshutterError as error:
        if str(photo) in str(error):
            raise
        raise type(error)(f"{photo}: {error}") from None
    except MemoryError:
        raise UnshutterError(f"{photo}: not enough memory") from None
    except Exception as error:
        if os.environ.get("UNSHUTTER_DEBUG"):
            raise
        line = " ".join(str(error).split())
        raise UnshutterError(
            f"{photo}: unexpected {type(error).__name__}: {line} (please report it; UNSHUTTER_DEBUG=1 shows more)"
        ) from error


def _count(failed: int, total: int) -> int:
    if failed:
        print(f"unshutter: {failed} of {total} photos failed", file=sys.stderr)
    return 1 if failed else 0
