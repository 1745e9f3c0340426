"""Finds the inputs of a run in its folders: photos, pairs, frames, recorded motions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from unshutter.batch.inputs import PHOTO_SUFFIXES, RECTIFIED
from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo

_RS = re.compile(r"rs_(\d+)")


@dataclass(frozen=True)
class Frame:
    """A rolling-shutter frame and the global-shutter pictures taken during its readout.

    Attributes:
        sequence: name of its sequence in the folder.
        number: number in the sequence; -1 if frames are not consecutive.
        rs: its file.
        gs: reference row (first, middle) -> file.
    """

    sequence: str
    number: int
    rs: Path
    gs: dict[str, Path]


def photos_in(folder: Path, most: int | None, seed: int) -> list[Path]:
    """Returns the photos of a folder and its subfolders, sorted; at most ``most`` of them, chosen by the seed.

    Raises:
        UnshutterError: there is no such folder, or no photos in it.
    """
    _check(folder)
    photos = [p for p in pictures_in(folder) if not p.stem.endswith(RECTIFIED)]
    if not photos:
        raise UnshutterError(f"no photos in folder {folder} (looked for {', '.join(sorted(PHOTO_SUFFIXES))})")
    if most is None or most >= len(photos):
        return photos
    chosen = np.random.default_rng([seed, len(photos)]).permutation(len(photos))[:most]
    return [photos[k] for k in sorted(chosen)]


def pictures_in(folder: Path) -> list[Path]:
    """Returns all pictures of a folder and its subfolders, sorted, of any kind."""
    return [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in PHOTO_SUFFIXES and p.is_file()]


def pairs_in(folder: Path) -> list[Frame]:
    """Returns the pairs of a folder: rs_N with gs_N_first or gs_N_middle in any subfolder, or ``synthesize`` output.

    Raises:
        UnshutterError: there are no pairs, or a frame's global-shutter picture is missing or differs in size.
    """
    _check(folder)
    frames = _synthesized(folder) if (folder / "rs").is_dir() else _numbered(folder)
    if not frames:
        raise UnshutterError(
            f"no pairs in folder {folder} (looked for rs_0.png with gs_0_first.png or gs_0_middle.png)"
        )
    for frame in frames:
        if not frame.gs:
            raise UnshutterError(f"{frame.rs} has no global-shutter picture next to it (gs_{frame.number}_middle.png)")
        size = _size(frame.rs)
        for other in frame.gs.values():
            if _size(other) != size:
                sizes = [f"{width}x{height} px" for height, width in (size, _size(other))]
                raise UnshutterError(f"{frame.rs} has {sizes[0]} but {other} has {sizes[1]}: they are not a pair")
    return frames


def videos_in(folder: Path) -> list[tuple[Frame, Frame]]:
    """Returns consecutive frames: rs_N and rs_N+1 of any subfolder, or else the folder's photos in order of name.

    Raises:
        UnshutterError: there are no consecutive frames, or their sizes differ.
    """
    _check(folder)
    frames = _numbered(folder)
    if not frames:
        frames = [Frame(p.parent.name, k, p, {}) for k, p in enumerate(photos_in(folder, None, 0))]
    pairs = [(a, b) for a, b in pairwise(frames) if a.rs.parent == b.rs.parent]
    pairs = [(a, b) for a, b in pairs if b.number == a.number + 1]
    if not pairs:
        raise UnshutterError(f"no consecutive frames in folder {folder} (looked for rs_0.png and rs_1.png)")
    for a, b in pairs:
        if _size(a.rs) != _size(b.rs):
            raise UnshutterError(f"{a.rs} and {b.rs} have different sizes: they are not frames of one video")
    return pairs


def logs_in(place: Path | None) -> tuple[Path, ...]:
    """Returns the NPZ files of recorded motions: one file, or those of a folder.

    Raises:
        UsageError: no path was given.
        UnshutterError: there are none.
    """
    if place is None:
        raise UsageError("this protocol needs --trajectory: an NPZ file, or a folder of them")
    files = sorted(place.glob("*.npz")) if place.is_dir() else [place]
    if not files or not files[0].is_file():
        raise UnshutterError(f"no recorded motion in {place} (looked for .npz)")
    return tuple(files)


def _check(folder: Path) -> None:
    if not folder.is_dir():
        raise UnshutterError(f"there is no folder {folder}" if not folder.exists() else f"{folder} is not a folder")


def _numbered(folder: Path) -> list[Frame]:
    frames = []
    for rs in sorted(p for p in folder.rglob("rs_*") if p.suffix.lower() in PHOTO_SUFFIXES):
        number = _RS.fullmatch(rs.stem)
        if number:
            gs = {r: p for r in ("first", "middle") if (p := rs.with_name(f"gs_{number[1]}_{r}{rs.suffix}")).is_file()}
            sequence = str(rs.parent.relative_to(folder))
            frames.append(Frame(sequence, int(number[1]), rs, gs))
    return sorted(frames, key=lambda frame: (frame.sequence, frame.number))


def _synthesized(folder: Path) -> list[Frame]:
    frames = []
    for rs in sorted(p for p in (folder / "rs").iterdir() if p.suffix.lower() in PHOTO_SUFFIXES):
        gs = folder / "gs" / rs.name
        if not gs.is_file():
            raise UnshutterError(f"{rs} has no global-shutter picture {gs}")
        frames.append(Frame(rs.stem, -1, rs, {"first": gs}))
    return frames


def _size(path: Path) -> tuple[int, int]:
    photo = Photo.open(path)
    return photo.height, photo.width
