"""``unshutter synthesize``: pairs of rolling-shutter and global-shutter pictures with known motion, from photos.

As in the predecessor: the central square of the photo is resized to a canvas, the canvas is distorted about its centre,
and the centre of both, distorted and not, is the pair. Where the motion reaches beyond the canvas, the distorted
picture is black. With an exposure, the distorted picture is blurred by its own motion.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.motion.finding import Finding
from unshutter.photo import Photo
from unshutter.photo.photo import check_size
from unshutter.progress import Progress
from unshutter.run.inputs import find_photos
from unshutter.run.report import exit_code
from unshutter.storage.files import written_whole
from unshutter.version import __version__
from unshutter_lab.synthesis.options import Synthesize
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import DrawnMotion, distorted, draw_from_trajectory, draw_quadratic


def synthesize(photo: np.ndarray, drawn: DrawnMotion, exposure: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Returns one pair (rs, gs) [rows, rows(, bands)] at the size of the drawn crop; its true motion is ``drawn.crop``.

    Args:
        photo: undistorted, [H, W] or [H, W, bands], uint8 or uint16; its central square is resized (by area, or
            bilinearly if it is smaller) to the motion's canvas.
        drawn: the motion.
        exposure: exposure time of each row, in readout times of the picture; 0 for no blur.
    """
    side = drawn.canvas.height
    square = np.ascontiguousarray(_middle_square(photo, min(photo.shape[:2])))
    method = cv2.INTER_AREA if len(square) >= side else cv2.INTER_LINEAR
    canvas = cv2.resize(square, (side, side), interpolation=method).reshape(side, side, *photo.shape[2:])
    return _distort(canvas, drawn, exposure)


def synthesize_native(
    photo: np.ndarray, drawn: DrawnMotion, exposure: float = 0.0
) -> tuple[np.ndarray, np.ndarray, Motion]:
    """Returns one pair (rs, gs) at the photo's own size, without resizing, and its true motion; see synthesize."""
    native = drawn.resized(min(photo.shape[:2]))
    return *_distort(_middle_square(photo, native.canvas.height), native, exposure), native.crop


def _distort(canvas: np.ndarray, drawn: DrawnMotion, exposure: float) -> tuple[np.ndarray, np.ndarray]:
    rows = exposure * (drawn.crop.height - 1)  # read during one exposure
    blurred = distorted(np.atleast_3d(canvas), drawn.canvas, rows).reshape(canvas.shape)
    rs, gs = (_middle_square(a, drawn.crop.height) for a in (blurred, canvas))
    return np.ascontiguousarray(rs), np.ascontiguousarray(gs)


def _middle_square(pixels: np.ndarray, side: int) -> np.ndarray:
    top, left = (pixels.shape[0] - side) // 2, (pixels.shape[1] - side) // 2
    return pixels[top : top + side, left : left + side]


def synthesize_files(photos: list[Path], output: Path, pictures: Synthesize) -> int:
    """Synthesises rolling-shutter pictures from photos; returns the exit code."""
    inputs = find_photos(photos, leave_out=output)
    files = [photo for photo in inputs.photos if isinstance(photo, Path)]
    with Progress(len(files)) as bar:
        failed = synthesize_folder(files, output, pictures, bar.advance)
        for _, message in failed:
            bar.tell(f"unshutter: {message}")
        if inputs.passed_over:
            bar.tell(f"unshutter: {inputs.not_taken()}")
    return exit_code(len(failed), len(files))


FORMAT = "unshutter-synthesis/1"
Draw = Callable[[np.random.Generator], DrawnMotion]


def synthesize_folder(
    photos: list[Path], out: Path, settings: Synthesize | None = None, progress: Callable[[], None] | None = None
) -> list[tuple[Path, str]]:
    """Writes pairs to ``rs/*.png`` and ``gs/*.png``, their motions to ``motion/*.json``, and manifest.json.

    The motions of a photo depend only on the seed and the photo's own bytes, not on the other photos. The manifest,
    with all settings and pairs, is written last: a folder without one is incomplete.

    Args:
        photos: files. Unusable ones are reported, and the run continues.
        out: a new or empty folder.
        settings: how the pictures are made.
        progress: called after each photo.

    Returns:
        (photo, error message) for each photo that failed.
    """
    if not photos:
        raise UsageError("no photos to synthesize from")
    settings = settings or Synthesize()
    draw = _drawer(settings)
    draw(np.random.default_rng(0))  # reports wrong settings before anything is written
    _make_folders(out)
    pairs: dict[str, dict[str, object]] = {}  # name, in one case -> pair
    failed: list[tuple[Path, str]] = []
    for photo in photos:
        try:
            digest, made = _pairs_of(photo, draw, settings)
        except UnshutterError as error:
            error.subject = str(photo)
            failed.append((photo, str(error)))
            made = []
        for k, (drawn, rs, gs) in enumerate(made):
            name, others = f"{photo.stem}_{k:02d}", 1
            while (unique := name if others == 1 else f"{name}-{others}").casefold() in pairs:
                others += 1  # photos with the same name from several folders
            Photo.from_array(rs, settings.exposure_s).save(out / "rs" / f"{unique}.png")
            Photo.from_array(gs).save(out / "gs" / f"{unique}.png")
            truth = Finding(drawn.crop, estimator="drawn", confidence=1.0)
            truth.save(out / "motion" / f"{unique}.json")
            about = {"photo": str(photo), "photo_sha256": digest, "drawn": drawn.parameters}
            pairs[unique.casefold()] = {"name": unique, **about}
        if progress:
            progress()
    log = settings.trajectory
    made_by = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(settings).items()}
    made_by["trajectory_sha256"] = None if log is None else _digest(log)
    reasons = [{"photo": str(photo), "reason": reason} for photo, reason in failed]
    about = {"format": FORMAT, "unshutter": __version__, **made_by}
    with written_whole(out / "manifest.json") as part:
        manifest = {**about, "pairs": list(pairs.values()), "failed": reasons}
        part.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return failed


def _make_folders(out: Path) -> None:
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            kind = "is not empty" if out.is_dir() else "is a file"
            raise UnshutterError(f"{out} {kind}: choose a new folder for the pictures")
        for name in ("rs", "gs", "motion"):
            (out / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnshutterError(f"cannot write to folder {out}: {error.strerror}") from None


def _drawer(settings: Synthesize) -> Draw:
    size, canvas, readout_ms, focal_px = settings.size, settings.canvas, settings.readout_ms, settings.focal_px
    if settings.trajectory is None or readout_ms is None or focal_px is None:  # quadratic: all three are None
        return lambda rng: draw_quadratic(rng, size, canvas)
    log = RotationLog.load(settings.trajectory)
    return lambda rng: draw_from_trajectory(rng, log, readout_ms / 1000, focal_px, size, canvas)


def _pairs_of(
    photo: Path, draw: Draw, settings: Synthesize
) -> tuple[str, list[tuple[DrawnMotion, np.ndarray, np.ndarray]]]:
    """Returns the SHA-256 of a photo, and its pairs as (motion, rs, gs)."""
    pixels, digest = Photo.open(photo).to_array(), _digest(photo)
    check_size(pixels.shape[0], pixels.shape[1], str(photo))
    sequences = np.random.SeedSequence([settings.seed, int(digest, 16)]).spawn(settings.per_photo)
    motions = [draw(np.random.default_rng(sequence)) for sequence in sequences]
    return digest, [(drawn, *synthesize(pixels, drawn, settings.exposure)) for drawn in motions]


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise UnshutterError(f"cannot read {path}: {error.strerror}") from None
