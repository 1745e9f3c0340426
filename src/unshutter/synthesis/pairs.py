"""Pairs of rolling-shutter and global-shutter pictures with known motion, made from undistorted photos.

The protocol is the predecessor's: the middle square of the photo is resized to a canvas, the canvas is
distorted about its centre, and the middle of both, distorted and not, is the pair. Where the motion reaches
beyond the canvas, the distorted picture is black.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter.storage.files import written_whole
from unshutter.synthesis.rotation_log import RotationLog
from unshutter.synthesis.row_motions import DrawnMotion, draw_from_trajectory, draw_quadratic
from unshutter.version import __version__
from unshutter.warp.pixels import distort_pixels

FORMAT = "unshutter-synthesis/1"
_SMALLEST_SIDE = 64  # px of a photo
# number generator -> motion
Draw = Callable[[np.random.Generator], DrawnMotion]


def synthesize(photo: np.ndarray, drawn: DrawnMotion) -> tuple[np.ndarray, np.ndarray]:
    """One pair at the size of the drawn crop.

    Args:
        photo: undistorted, [H, W] or [H, W, bands], uint8 or uint16; its middle square is resized (by area;
            bilinear where it is smaller) to the motion's canvas.
        drawn: the motion; its truth for the pair is ``drawn.crop``.

    Returns:
        (rs, gs): distorted and undistorted picture [rows, rows(, bands)], of the photo's type.
    """
    import cv2

    side = drawn.canvas.height
    square = np.ascontiguousarray(_middle_square(photo, min(photo.shape[:2])))
    method = cv2.INTER_AREA if len(square) >= side else cv2.INTER_LINEAR
    canvas = cv2.resize(square, (side, side), interpolation=method).reshape(side, side, *photo.shape[2:])
    return _distort(canvas, drawn)


def synthesize_native(photo: np.ndarray, drawn: DrawnMotion) -> tuple[np.ndarray, np.ndarray, Motion]:
    """One pair at the photo's own size: the same motion and share of the picture, nothing resized.

    Args:
        photo: as for :func:`synthesize`.
        drawn: the motion at any size.

    Returns:
        (rs, gs, motion): pictures and their true motion.
    """
    native = drawn.resized(min(photo.shape[:2]))
    return *_distort(_middle_square(photo, native.canvas.height), native), native.crop


def _distort(canvas: np.ndarray, drawn: DrawnMotion) -> tuple[np.ndarray, np.ndarray]:
    distorted = distort_pixels(np.atleast_3d(canvas), drawn.canvas).reshape(canvas.shape)
    rs, gs = (_middle_square(a, drawn.crop.height) for a in (distorted, canvas))
    return np.ascontiguousarray(rs), np.ascontiguousarray(gs)


def _middle_square(pixels: np.ndarray, side: int) -> np.ndarray:
    top, left = (pixels.shape[0] - side) // 2, (pixels.shape[1] - side) // 2
    return pixels[top : top + side, left : left + side]


# ---- folders ----------------------------------------------------------------------------------------------


def synthesize_folder(
    photos: list[Path],
    out: Path,
    per_photo: int = 1,
    seed: int = 0,
    motion: str = "quadratic",
    trajectory: Path | None = None,
    readout_ms: float | None = None,
    focal_px: float | None = None,
    size: int = 256,
    canvas: int = 356,
    progress: Callable[[], None] | None = None,
) -> list[tuple[Path, str]]:
    """Writes pairs into ``rs/*.png`` and ``gs/*.png``, their motions into ``motion/*.json``, and manifest.json.

    What is drawn for a photo depends on the seed and the photo's own bytes alone, not on the other photos.
    The manifest, with every parameter and every pair, is written last: a folder without one is incomplete.

    Args:
        photos: files. One that cannot be used is reported, and the run goes on.
        out: a new or empty folder.
        per_photo: pairs made of each photo.
        seed: 0 or more.
        motion: ``quadratic`` or ``trajectory``, see row_motions.py.
        trajectory: NPZ file, see rotation_log.py; for ``trajectory`` only, and needed there, like the next two.
        readout_ms: time in which a picture is read out [ms].
        focal_px: focal length in pixels of the finished picture.
        size: side of the pictures [px].
        canvas: side of the canvas [px].
        progress: called after each photo.

    Returns:
        (photo, what is wrong with it) for each photo that failed.

    Raises:
        UsageError: options that do not fit together.
        UnshutterError: the folder is not empty or cannot be written to; the trajectory cannot be used.
    """
    if not photos:
        raise UsageError("no photos to synthesize from")
    if per_photo < 1 or seed < 0:
        raise UsageError(f"needs at least one picture per photo and a seed of 0 or more, got {per_photo} and {seed}")
    draw = _drawer(motion, trajectory, readout_ms, focal_px, size, canvas)
    draw(np.random.default_rng(0))  # says what is wrong with the options before anything is written
    folder = _PairFolder.make(out)
    for photo in photos:
        try:
            digest, pairs = _pairs_of(photo, draw, per_photo, seed)
        except UnshutterError as error:
            folder.failed.append((photo, str(error)))
        else:
            for k, (drawn, rs, gs) in enumerate(pairs):
                folder.add(f"{photo.stem}_{k:02d}", photo, digest, drawn, rs, gs)
        if progress:
            progress()
    folder.finish(
        {
            "motion": motion,
            "per_photo": per_photo,
            "seed": seed,
            "size": size,
            "canvas": canvas,
            "trajectory": None if trajectory is None else str(trajectory),
            "trajectory_sha256": None if trajectory is None else _digest(trajectory),
            "readout_ms": readout_ms,
            "focal_px": focal_px,
        }
    )
    return folder.failed


def _drawer(
    motion: str, trajectory: Path | None, readout_ms: float | None, focal_px: float | None, size: int, canvas: int
) -> Draw:
    if motion == "quadratic":
        if not (trajectory is None and readout_ms is None and focal_px is None):
            raise UsageError("trajectory, readout and focal length are for --motion trajectory only")
        return lambda rng: draw_quadratic(rng, size, canvas)
    if motion != "trajectory":
        raise UsageError(f"unknown motion '{motion}': choose quadratic or trajectory")
    if trajectory is None or readout_ms is None or focal_px is None:
        raise UsageError("--motion trajectory needs --trajectory, --readout-ms and --focal-px")
    log = RotationLog.load(trajectory)
    return lambda rng: draw_from_trajectory(rng, log, readout_ms / 1000, focal_px, size, canvas)


def _pairs_of(
    photo: Path, draw: Draw, count: int, seed: int
) -> tuple[str, list[tuple[DrawnMotion, np.ndarray, np.ndarray]]]:
    """SHA-256 of a photo, and its pairs as (motion, rs, gs)."""
    pixels, digest = Photo.open(photo).to_array(), _digest(photo)
    if min(pixels.shape[:2]) < _SMALLEST_SIDE:
        size = f"{pixels.shape[1]}x{pixels.shape[0]} px"
        raise UnshutterError(f"{photo} has {size}: each side must have at least {_SMALLEST_SIDE} px")
    sequences = np.random.SeedSequence([seed, int(digest, 16)]).spawn(count)
    motions = [draw(np.random.default_rng(sequence)) for sequence in sequences]
    return digest, [(drawn, *synthesize(pixels, drawn)) for drawn in motions]


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise UnshutterError(f"cannot read {path}: {error.strerror}") from None


@dataclass
class _PairFolder:
    """The folder that pairs go to, and what its manifest will say."""

    out: Path
    pairs: list[dict] = field(default_factory=list)
    failed: list[tuple[Path, str]] = field(default_factory=list)
    taken: set[str] = field(default_factory=set)

    @classmethod
    def make(cls, out: Path) -> _PairFolder:
        try:
            if out.exists() and (not out.is_dir() or any(out.iterdir())):
                kind = "is not empty" if out.is_dir() else "is a file"
                raise UnshutterError(f"{out} {kind}: choose a new folder for the pictures")
            for name in ("rs", "gs", "motion"):
                (out / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnshutterError(f"cannot write to folder {out}: {error.strerror}") from None
        return cls(out)

    def add(self, name: str, photo: Path, digest: str, drawn: DrawnMotion, rs: np.ndarray, gs: np.ndarray) -> None:
        unique, others = name, 1
        while unique.casefold() in self.taken:  # photos of the same name from several folders
            others += 1
            unique = f"{name}-{others}"
        self.taken.add(unique.casefold())
        Photo.from_array(rs).save(self.out / "rs" / f"{unique}.png")
        Photo.from_array(gs).save(self.out / "gs" / f"{unique}.png")
        drawn.crop.save(self.out / "motion" / f"{unique}.json")
        about = {"name": unique, "photo": str(photo), "photo_sha256": digest, "drawn": drawn.parameters}
        self.pairs.append(about)

    def finish(self, parameters: dict) -> None:
        failed = [{"photo": str(photo), "reason": reason} for photo, reason in self.failed]
        about = {"format": FORMAT, "unshutter": __version__, **parameters, "pairs": self.pairs, "failed": failed}
        with written_whole(self.out / "manifest.json") as part:
            part.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
