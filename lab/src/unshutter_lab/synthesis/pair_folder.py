"""Folders of pairs: rolling-shutter and global-shutter pictures, their motions, and a manifest of their synthesis."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo
from unshutter.photo.argument import check_size
from unshutter.storage.files import written_whole
from unshutter.version import __version__
from unshutter_lab.synthesis.options import Synthesize
from unshutter_lab.synthesis.pairs import synthesize
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import DrawnMotion, draw_from_trajectory, draw_quadratic

FORMAT = "unshutter-synthesis/1"
# random number generator -> motion
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

    Raises:
        UsageError: there are no photos, or sizes contradict each other.
        UnshutterError: the folder is not empty or not writable, or the trajectory cannot be used.
    """
    if not photos:
        raise UsageError("no photos to synthesize from")
    settings = settings or Synthesize()
    draw = _drawer(settings)
    draw(np.random.default_rng(0))  # reports wrong settings before anything is written
    folder = _PairFolder.make(out)
    for photo in photos:
        try:
            digest, pairs = _pairs_of(photo, draw, settings)
        except UnshutterError as error:
            folder.failed.append((photo, str(error)))
        else:
            for k, (drawn, rs, gs) in enumerate(pairs):
                made = Photo.from_array(rs, settings.exposure_s)
                folder.add(f"{photo.stem}_{k:02d}", photo, digest, drawn, made, gs)
        if progress:
            progress()
    folder.finish(settings)
    return folder.failed


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


@dataclass
class _PairFolder:
    """The folder that pairs are written to, and the contents of its manifest."""

    out: Path
    pairs: list[dict] = field(default_factory=list)
    failed: list[tuple[Path, str]] = field(default_factory=list)
    names: set[str] = field(default_factory=set)

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

    def add(self, name: str, photo: Path, digest: str, drawn: DrawnMotion, rs: Photo, gs: np.ndarray) -> None:
        unique, others = name, 1
        while unique.casefold() in self.names:  # photos with the same name from several folders
            others += 1
            unique = f"{name}-{others}"
        self.names.add(unique.casefold())
        rs.save(self.out / "rs" / f"{unique}.png")
        Photo.from_array(gs).save(self.out / "gs" / f"{unique}.png")
        drawn.crop.save(self.out / "motion" / f"{unique}.json")
        pair = {"name": unique, "photo": str(photo), "photo_sha256": digest, "drawn": drawn.parameters}
        self.pairs.append(pair)

    def finish(self, settings: Synthesize) -> None:
        """Writes the manifest."""
        log = settings.trajectory
        made = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(settings).items()}
        made["trajectory_sha256"] = None if log is None else _digest(log)
        failed = [{"photo": str(photo), "reason": reason} for photo, reason in self.failed]
        manifest = {"format": FORMAT, "unshutter": __version__, **made, "pairs": self.pairs, "failed": failed}
        with written_whole(self.out / "manifest.json") as part:
            part.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
