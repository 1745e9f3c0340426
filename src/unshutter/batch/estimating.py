"""``unshutter estimate``: the motions of many photos."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.inputs import find_photos, is_folder, motion_name, plan_targets
from unshutter.batch.read_ahead import ReadAhead
from unshutter.batch.report import Tell, each_photo
from unshutter.errors import UsageError
from unshutter.photo.photo import MAX_PIXELS
from unshutter.storage.places import Place, check_place, make_folder, save_text

if TYPE_CHECKING:
    from unshutter.options import Reference


def estimate_files(
    photos: list[Path],
    output: Path | None,
    plot: Path | None,
    estimator_name: str,
    reference: Reference,
    readout: str,
    overwrite: bool,
    readout_ms: float | None = None,
    max_pixels: int | None = None,
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
) -> int:
    """Estimates the motion of each photo; returns the exit code."""
    inputs = find_photos(photos, leave_out=output)
    if inputs.many and output is None:
        raise UsageError("several photos need --output FOLDER for their motions")
    if inputs.many and plot:
        raise UsageError("--plot draws the motion of one photo only")
    ahead = ReadAhead(list(inputs.photos), max_pixels or MAX_PIXELS, whole=False)
    from unshutter.estimators.register import load
    from unshutter.motion.speed import check_readout_ms, json_with_speed
    from unshutter.rectification import estimate

    if readout_ms is not None:
        check_readout_ms(readout_ms)
    estimator = load(estimator_name)
    targets = plan_targets(inputs, output, motion_name) if output else {}

    def one(photo: Place, tell: Tell) -> None:
        target = targets.get(photo)
        if target and output and is_folder(output, inputs.many):
            make_folder(target.parent)
        for wanted in filter(None, (target, plot)):
            check_place(wanted, overwrite, photo)
        told = {"focal_px": focal_px, "roll_deg": roll_deg, "tilt_deg": tilt_deg}
        opened = ahead.photo(photo)
        motion = estimate(opened, estimator=estimator, readout=readout, reference=reference, **told)
        if motion.reason:
            tell(f"{photo}: no motion ({motion.reason})")
        if plot:
            from unshutter.export.plot import plot_motion

            plot_motion(motion, plot, title=photo.name, readout_ms=readout_ms)
        text = motion.to_json() if readout_ms is None else json_with_speed(motion, readout_ms)
        if target:
            save_text(text + "\n", target)
        else:
            print(text)

    return each_photo(inputs, one)
