"""``unshutter estimate``: the motions of many photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.inputs import find_photos
from unshutter.batch.report import Tell, each_photo
from unshutter.batch.targets import check_named_once, is_folder, motion_names, plan_targets
from unshutter.batch.words import about
from unshutter.errors import UsageError
from unshutter.estimators.register import check_name, weights_file
from unshutter.options import Find, Reference, Undo
from unshutter.prefetch import Prefetch
from unshutter.storage.files import remove_leftovers
from unshutter.storage.places import Place, check_place, make_folder, write_place
from unshutter.storage.protection import Protection

if TYPE_CHECKING:
    from unshutter.motion import Motion


@dataclass(frozen=True)
class Estimates:
    """What is wanted of each photo.

    Attributes:
        find: how its motion is found; where it gives the time of the readout, the speed is added.
        reference: row that counts as not moving.
        plot: file to draw the motion into; None: none.
    """

    find: Find
    reference: Reference = "first"
    plot: Path | None = None


def estimate_files(photos: list[Path], output: Path | None, wanted: Estimates, overwrite: bool, max_pixels: int) -> int:
    """Estimates the motion of each photo; returns the exit code."""
    inputs = find_photos(photos, leave_out=output)
    if inputs.many and output is None:
        raise UsageError("several photos need --output FOLDER for their motions")
    if inputs.many and wanted.plot:
        raise UsageError("--plot draws the motion of one photo only")
    check_name(wanted.find.estimator)
    targets = plan_targets(inputs, output, motion_names(inputs)) if output else {}
    check_named_once([*(("the motion", target) for target in targets.values()), ("--plot", wanted.plot)])
    protection = Protection([*inputs.photos, weights_file(wanted.find.estimator)], [output])
    _remove_leftovers([*targets.values(), *([wanted.plot] if wanted.plot else [])])
    prefetch = Prefetch(list(inputs.photos), wanted.find, max_pixels)
    in_folder = output is not None and is_folder(output, inputs.many)

    def check(file: Place, photo: Place) -> None:
        protection.check(file)
        if in_folder and file != wanted.plot:
            make_folder(file.parent)
        check_place(file, overwrite, photo)

    def one(photo: Place, tell: Tell) -> None:
        target = targets.get(photo)
        for file in filter(None, (target, wanted.plot)):
            check(file, photo)
        coming = prefetch.take(photo)
        motion = coming.photo and coming.motion().rereferenced(wanted.reference)
        _tell_if_it_would_not_be_undone(motion, photo, tell)
        text = _told(motion, photo, wanted)
        if target:
            write_place(f"{text}\n".encode(), target, overwrite, mode_of=photo)
        else:
            print(text)

    return each_photo(inputs, one)


def _tell_if_it_would_not_be_undone(motion: Motion, photo: Place, tell: Tell) -> None:
    from unshutter.motion.verdict import Verdict

    verdict = Verdict.of(motion, Undo())
    if motion.reason:
        tell(f"{photo}: no motion ({motion.reason})")
    elif not verdict.changes:
        tell(f"{photo}: rectify leaves it as it is ({about(verdict)})")


def _remove_leftovers(targets: list[Place]) -> None:
    for folder in {target.parent for target in targets}:
        if isinstance(folder, Path):
            remove_leftovers(folder)


def _told(motion: Motion, photo: Place, wanted: Estimates) -> str:
    """The motion as text; drawn, too, if that is wanted."""
    from unshutter.motion.speed import json_with_speed

    readout_ms = wanted.find.camera.readout_ms
    if wanted.plot:
        from unshutter.export.plot import plot_motion

        plot_motion(motion, wanted.plot, title=photo.name, readout_ms=readout_ms)
    return motion.to_json() if readout_ms is None else json_with_speed(motion, readout_ms)
