"""Finds the inputs of a run in its folders (photos, pairs, frames, recorded motions); cases of pairs.

A pair is a rolling-shutter frame and a global-shutter picture taken at the time of its first or middle row. Of
consecutive frames, results of using a frame's neighbours, and published results of other methods, are judged, too.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.finding import Finding
from unshutter.options import Clock, FrameModel, Reference, Undo
from unshutter.options.picture_formats import SUFFIXES
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.rectification.sequences import SequenceOptions, rectify_between
from unshutter.run.inputs import RECTIFIED
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import (
    Answer,
    Case,
    Example,
    Loaded,
    Record,
    ask,
    compared,
    in_8_bits,
    picture_scores,
    rectified,
)
from unshutter_lab.evaluation.ceiling import fit_to_pair
from unshutter_lab.evaluation.metrics import psnr

_RS = re.compile(r"rs_(\d+)")


@dataclass(frozen=True)
class Frame:
    """A rolling-shutter frame and the global-shutter pictures taken during its readout."""

    sequence: str  # name of its sequence in the folder
    number: int  # number in the sequence; -1 if frames are not consecutive
    rs: Path  # its file
    gs: dict[str, Path]  # reference row (first, middle) -> file


def photos_in(folder: Path, most: int | None, seed: int) -> list[Path]:
    """Returns the photos of a folder and its subfolders, sorted; at most ``most`` of them, chosen by the seed."""
    _check(folder)
    photos = [p for p in pictures_in(folder) if not p.stem.endswith(RECTIFIED)]
    if not photos:
        raise UnshutterError(f"no photos in folder {folder} (looked for {', '.join(sorted(SUFFIXES))})")
    if most is None or most >= len(photos):
        return photos
    chosen = np.random.default_rng([seed, len(photos)]).permutation(len(photos))[:most]
    return [photos[k] for k in sorted(chosen)]


def pictures_in(folder: Path) -> list[Path]:
    """Returns all pictures of a folder and its subfolders, sorted, of any kind."""
    return [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in SUFFIXES and p.is_file()]


def pairs_in(folder: Path) -> list[Frame]:
    """Returns the pairs of a folder: rs_N with gs_N_first or gs_N_middle in any subfolder, or ``synthesize`` output."""
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
    """Returns consecutive frames: rs_N and rs_N+1 of any subfolder, or else the folder's photos in order of name."""
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
    """Returns the NPZ files of recorded motions: one file, or those of a folder."""
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
    for rs in sorted(p for p in folder.rglob("rs_*") if p.suffix.lower() in SUFFIXES):
        number = _RS.fullmatch(rs.stem)
        if number:
            gs = {r: p for r in ("first", "middle") if (p := rs.with_name(f"gs_{number[1]}_{r}{rs.suffix}")).is_file()}
            sequence = str(rs.parent.relative_to(folder))
            frames.append(Frame(sequence, int(number[1]), rs, gs))
    return sorted(frames, key=lambda frame: (frame.sequence, frame.number))


def _synthesized(folder: Path) -> list[Frame]:
    frames = []
    for rs in sorted(p for p in (folder / "rs").iterdir() if p.suffix.lower() in SUFFIXES):
        gs = folder / "gs" / rs.name
        if not gs.is_file():
            raise UnshutterError(f"{rs} has no global-shutter picture {gs}")
        frames.append(Frame(rs.stem, -1, rs, {"first": gs}))
    return frames


def _size(path: Path) -> tuple[int, int]:
    photo = Photo.open(path)
    return photo.height, photo.width


CEILING = "ceiling"
# rows of the tables: with a fixed model, and with the chosen one
FRAMES: dict[str, FrameModel | None] = {"frames-camera": "camera", "frames-dense": "dense", "frames": None}
PUBLISHED = "psnr_published_"  # followed by the name of the method


@dataclass(frozen=True)
class PairCase(Case):
    """One rolling-shutter frame, judged at every reference row with a global-shutter picture."""

    group: str  # name of the data set in the tables
    frame: Frame  # its files
    # readout time / frame interval of the camera; None if unknown, which excludes neighbouring frames
    readout_ratio: float | None = None

    @property
    def key(self) -> str:
        """Group, sequence and file of the frame."""
        return f"{self.group}|{self.frame.sequence}|{self.frame.rs.name}"

    @property
    def place(self) -> Record:
        """Group, sequence and number of the frame; the reference row is added later."""
        return {"suite": "", "group": self.group, "photo": self.frame.sequence, "draw": self.frame.number}

    @property
    def oracles(self) -> tuple[str, ...]:
        """The motion fitted to both pictures, and the results of using the frame's neighbours."""
        has_neighbours = self.readout_ratio is not None and any(neighbours_of(self.frame))
        return (*FRAMES, CEILING) if has_neighbours else (CEILING,)

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name and reference row."""
        photo = Photo.open(self.frame.rs)
        rs, truths = in_8_bits(photo), {reference: self._truth(reference, photo) for reference in self.frame.gs}
        records = []
        for name in names:
            answer = None if name in (CEILING, *FRAMES) else ask(loaded(name), View(photo))
            for reference, gs in truths.items():
                row = cast(Reference, reference)
                if name in FRAMES:
                    picture, mask, figures = self._by_neighbours(name, row, gs)
                else:
                    motion = answer.motion.rereferenced(row) if answer else fit_to_pair(rs, gs, row)
                    picture, mask = rectified(photo, motion)
                    figures = (answer or Answer(Finding(motion.rereferenced("first")))).figures()
                scores = picture_scores({"": picture, "input": rs}, gs, mask)
                place = {**self.place, "suite": f"{reference} row", "estimator": name}
                records.append(place | figures | scores)
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures at the last reference row."""
        photo = Photo.open(self.frame.rs)
        reference = cast(Reference, list(self.frame.gs)[-1])
        truth = self._truth(reference, photo)
        motions = {name: ask(loaded(name), View(photo)).motion.rereferenced(reference) for name in names}
        motions[CEILING] = fit_to_pair(in_8_bits(photo), truth, reference)
        pictures = compared(photo, motions, reference)
        by_frames = [name for name in self.oracles if name in FRAMES]
        pictures += [(name, self._by_neighbours(name, reference)[0]) for name in by_frames]
        title = f"{self.group} {self.frame.sequence} {self.frame.number}, {reference} row"
        return Example(title, [*pictures, ("truth", truth)], motions)

    def _truth(self, reference: str, photo: Photo) -> np.ndarray:
        gs, rs = in_8_bits(Photo.open(self.frame.gs[reference])), in_8_bits(photo)
        if gs.shape != rs.shape:
            raise UnshutterError(
                f"{self.frame.gs[reference]} and {photo.path} differ in size or channels: they are not a pair"
            )
        return gs

    def _by_neighbours(
        self, name: str, reference: Reference, gs: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, Record]:
        """Returns the result of ``unshutter rectify --before --after`` for the frame.

        Returns:
            uint8 [H, W, 1 or 3]; a bool mask [H, W] of the pixels the frame shows; and the figures common to all
            records, and with ``gs`` those of published results. A frame whose neighbours cannot be used is left
            unchanged.
        """
        photo = Photo.open(self.frame.rs)
        before, after = (path and Photo.open(path) for path in neighbours_of(self.frame))
        readout = Clock(self.readout_ratio or 1).stated_ratio
        options = SequenceOptions(
            readout, Undo(reference, edges="keep"), ScanDirection.TOP_TO_BOTTOM, model=FRAMES[name]
        )
        figures: Record = {"declined": "", "failed": "", "confidence": None}
        try:
            result = rectify_between(photo, before or None, after or None, options)
            picture, mask = in_8_bits(result.photo), result.valid
            figures |= {"declined": result.reason, "model": result.model}
        except UnshutterError as error:
            picture, mask = in_8_bits(photo), np.ones((photo.height, photo.width), bool)
            figures["declined"] = str(error)
        if gs is not None:
            others = published_of(self.frame, reference)
            figures |= {f"{PUBLISHED}{other}": psnr(theirs, gs, mask) for other, theirs in others.items()}
        return picture, mask, figures


def neighbours_of(frame: Frame) -> tuple[Path | None, Path | None]:
    """Returns the files of the previous and next frames, or None where missing."""
    if frame.number < 0:
        return None, None
    before, after = (frame.rs.with_name(f"rs_{frame.number + way}{frame.rs.suffix}") for way in (-1, 1))
    return before if before.is_file() else None, after if after.is_file() else None


def published_of(frame: Frame, reference: str) -> dict[str, np.ndarray]:
    """Returns other methods' published pictures of a frame next to it: name of the method -> uint8 [H, W, 1 or 3].

    The files are called published_METHOD_NUMBER_REFERENCE; those of another size or other channels are ignored.
    """
    shape = in_8_bits(Photo.open(frame.rs)).shape
    files = sorted(frame.rs.parent.glob(f"published_*_{frame.number}_{reference}{frame.rs.suffix}"))
    others = {path.stem.split("_")[1]: in_8_bits(Photo.open(path)) for path in files}
    return {name: picture for name, picture in others.items() if picture.shape == shape}
