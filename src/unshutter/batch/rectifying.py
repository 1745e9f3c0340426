"""``unshutter rectify``: many photos straightened, each into its own file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.inputs import RECTIFIED, find_photos, plan_targets
from unshutter.batch.read_ahead import ReadAhead
from unshutter.batch.report import Tell, each_photo
from unshutter.errors import UsageError
from unshutter.files import check_target

if TYPE_CHECKING:
    from unshutter.motion import Reference
    from unshutter.warp import Edges


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
    ahead = ReadAhead(files)  # decodes while the heavy libraries are imported
    from unshutter.estimators import load
    from unshutter.motion import Motion
    from unshutter.rectification import rectify

    given = Motion.load(options.motion) if options.motion else None
    estimator = options.estimator if given else load(options.estimator)
    targets = plan_targets(files, output, many, lambda photo: f"{photo.stem}{RECTIFIED}{photo.suffix}")
    motion_targets = plan_targets(files, save_motion, many, lambda photo: f"{photo.stem}.json") if save_motion else {}

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

    return each_photo(files, one)
