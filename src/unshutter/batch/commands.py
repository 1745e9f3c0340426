"""The commands that process many photos: ``unshutter rectify`` and ``unshutter estimate``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.inputs import Inputs, find_photos
from unshutter.batch.lookahead import Lookahead, PhotoAhead
from unshutter.batch.loop import Batch, check_outputs
from unshutter.batch.manifest import Manifest
from unshutter.batch.plan import (
    Outputs,
    Plan,
    check_have_times,
    check_neighbours,
    digest_of,
    jobs_for,
    manifest_folder,
    plan_for,
    prepare_folders,
    protection_of,
    with_coordinates,
)
from unshutter.batch.preview import Preview
from unshutter.batch.report import Report, Tell, about, each_photo
from unshutter.batch.sequences import check_sequence, with_motions
from unshutter.batch.targets import (
    check_named_once,
    is_folder,
    motion_names,
    plan_targets,
)
from unshutter.batch.work import do_job
from unshutter.batch.workers import Workers, cluster, this_process
from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.estimators.register import check_name, load, weights_file
from unshutter.options import Find, Rectify, Reference, Run, Undo
from unshutter.storage.files import remove_leftovers
from unshutter.storage.places import Place, check_place, make_folder, place, write_place
from unshutter.storage.protection import Protection

if TYPE_CHECKING:
    from unshutter.motion import Motion
    from unshutter.photo import Photo


def rectify_files(photos: Sequence[str | os.PathLike[str]], into: Outputs, request: Rectify, run: Run) -> int:
    """Rectifies each photo into its own file; returns the exit code."""
    goal = place(into.pictures) if into.pictures is not None else None
    inputs = find_photos(photos, leave_out=goal)
    if request.save.format and goal is not None and not is_folder(goal, inputs.many):
        raise UsageError(f"--format is for folders: the name '{goal.name}' says the format")
    check_name(request.find.estimator)
    check_neighbours(request, len(inputs.photos), run)
    check_sequence(request, len(inputs.photos))
    request = with_coordinates(request, into)
    if request.save.keep_names and (goal is None or not is_folder(goal, inputs.many)):
        raise UsageError("--keep-names needs --output FOLDER for the results")
    motion = _motion_text(request.motion)
    jobs = jobs_for(inputs, into, request, run)
    if request.save.keep_times:
        check_have_times(jobs)
    protection = protection_of(inputs, jobs, into, request, run)
    # results next to their photos, and the result of a single photo, are identified by their names and need no manifest
    home = manifest_folder(inputs, into, run)
    options = digest_of(request, motion) if home is not None else ""
    manifest = Manifest(home, options, whole_paths=run.manifest is not None) if home is not None else None
    plan = plan_for(jobs, manifest, run.overwrite)
    if run.dry_run:
        return _report_dry_run(plan, inputs, protection)
    ratio = None
    if request.neighbours.sequence and plan.to_do:
        plan.to_do, ratio = with_motions(plan.to_do, list(inputs.photos), request, run.max_pixels)
    lookahead = None
    if run.jobs is run.scheduler is run.timeout is None and plan.to_do:  # the work is done in this process
        sources = [job.source for job in plan.to_do]
        lookahead = Lookahead(sources, request.find_alone, run.max_pixels, request.undo)
    with Report(len(jobs) + len(inputs.unreadable), len(plan.to_do), run.json_log, inputs, protection) as report:
        report.preview = Preview(run.preview, run.overwrite) if run.preview is not None else None
        if ratio is not None:
            report.tell(f"unshutter: readout ratio {ratio}")
        _report_before_work(plan, inputs, report)
        prepare_folders(jobs, inputs, into, protection)
        with _workers_for(run) as workers:
            here = {"lookahead": lookahead} if lookahead else {}  # only for this process
            work = partial(do_job, request=request, motion=motion, **here)
            Batch(work, workers, manifest, report, protection).run(plan.to_do)
        report.save_preview()
    return report.exit_code()


def _workers_for(run: Run) -> AbstractContextManager[Workers]:
    """Returns the workers that the options of a run call for: a cluster, processes, or this process."""
    if run.scheduler is not None:
        return cluster(run.scheduler)
    if run.jobs is run.timeout is None:
        return this_process()
    from unshutter.batch.processes import processes  # imported here: for one photo, multiprocessing would take 7 ms

    if run.jobs is not None:
        return processes(run.jobs, run.timeout)
    return processes(1, run.timeout, all_processors=True)  # this process could not stop a decoder that hangs in it


def _motion_text(path: Path | None) -> str | None:
    if path is None:
        return None
    from unshutter.motion import Motion

    return Motion.load(path).to_json()


def _report_dry_run(plan: Plan, inputs: Inputs, protection: Protection) -> int:
    refused = [reason for _, reason in plan.refused]
    refused += [f"cannot read folder {folder}: {reason}" for folder, reason in inputs.unreadable]
    count = 0
    for job in plan.to_do:
        try:
            if not isinstance(job.target, Path) or job.target.parent.is_dir():
                check_outputs(job, protection)
        except UnshutterError as error:
            refused.append(f"{job.source}: {error}")
        else:
            count += 1
            print(visible(f"{job.source} -> {job.target}"))
    for reason in refused:
        print(visible(f"unshutter: {reason}"), file=sys.stderr)
    if inputs.passed_over:
        print(f"unshutter: {inputs.not_taken()}", file=sys.stderr)
    photos = "1 photo" if count == 1 else f"{count} photos"
    line = f"{photos} to do, {len(plan.finished)} finished already, {len(refused)} refused"
    print(f"unshutter: {line}; nothing was written", file=sys.stderr)
    return 1 if refused else 0


def _report_before_work(plan: Plan, inputs: Inputs, report: Report) -> None:
    for folder, reason in inputs.unreadable:
        report.failed(folder, f"cannot read folder {folder}: {reason}")
    for job in plan.finished:
        report.skipped(job)
    for job, reason in plan.refused:
        report.failed(job.source, reason)


@dataclass(frozen=True)
class Estimates:
    """The options of ``unshutter estimate``.

    Attributes:
        find: how motions are found; if it specifies the readout time, the output includes the speed.
        reference: row that counts as not moving.
        plot: file to draw the motion into; None: no plot.
        candidates: whether to list all motions that fit.
        lines: file of lines that a person drew along things in the photo; None: none.

    Raises:
        UsageError: some options exclude each other.
    """

    find: Find
    reference: Reference = "first"
    plot: Path | None = None
    candidates: bool = False
    lines: Path | None = None

    def __post_init__(self) -> None:
        if self.candidates and (self.plot or self.find.camera.candidate is not None):
            raise UsageError("--candidates lists all of them: leave out --plot and --candidate")
        if self.candidates and self.lines:
            raise UsageError("lines show one motion: leave out --candidates or --lines")


def estimate_files(
    photos: list[Path], output: Path | None, request: Estimates, overwrite: bool, max_pixels: int
) -> int:
    """Estimates the motion of each photo; returns the exit code."""
    inputs = find_photos(photos, leave_out=output)
    if inputs.many and output is None:
        raise UsageError("several photos need --output FOLDER for their motions")
    if inputs.many and request.plot:
        raise UsageError("--plot draws the motion of one photo only")
    if inputs.many and request.lines:
        raise UsageError("--lines are those of one photo only")
    check_name(request.find.estimator)
    targets = plan_targets(inputs, output, motion_names(inputs)) if output else {}
    check_named_once([*(("the motion", target) for target in targets.values()), ("--plot", request.plot)])
    protection = Protection([*inputs.photos, weights_file(request.find.estimator), request.lines], [output])
    _remove_leftovers([*targets.values(), *([request.plot] if request.plot else [])])
    lookahead = Lookahead(list(inputs.photos), None if request.candidates else request.find, max_pixels)
    in_folder = output is not None and is_folder(output, inputs.many)

    def check(file: Place, photo: Place) -> None:
        protection.check(file)
        if in_folder and file != request.plot:
            make_folder(file.parent)
        check_place(file, overwrite, photo)

    def one(photo: Place, tell: Tell) -> None:
        target = targets.get(photo)
        for file in filter(None, (target, request.plot)):
            check(file, photo)
        ahead = lookahead.take(photo)
        if request.candidates:
            text = _candidates_as_text(ahead.photo, photo, request, tell)
        else:
            motion = ahead.photo and _estimated(ahead, request).rereferenced(request.reference)
            _report_if_left_alone(motion, photo, tell)
            text = _estimate_as_text(motion, photo, request)
        if target:
            write_place(f"{text}\n".encode(), target, overwrite, mode_of=photo)
        else:
            print(text)

    return each_photo(inputs, one)


def _estimated(ahead: PhotoAhead, request: Estimates) -> Motion:
    """Returns the photo's motion, from the drawn lines if there are any."""
    if request.lines is None:
        return ahead.motion()
    from unshutter.estimators.right_angles.drawn_lines import read_lines
    from unshutter.rectification import motion_of_lines

    return motion_of_lines(ahead.photo, read_lines(request.lines), request.find.camera)


def _report_if_left_alone(motion: Motion, photo: Place, tell: Tell) -> None:
    from unshutter.motion.verdict import Verdict

    verdict = Verdict.of(motion, Undo())
    if motion.reason:
        tell(f"{photo}: no motion ({motion.reason})")
    elif not verdict.changes:
        tell(f"{photo}: rectify leaves it unchanged ({about(verdict)})")


def _candidates_as_text(photo: Photo, source: Place, request: Estimates, tell: Tell) -> str:
    """Returns the candidates of a photo as JSON, and reports each in a line."""
    from unshutter.motion.candidate import candidates_to_json
    from unshutter.rectification import photo_candidates

    listed = photo_candidates(photo, load(request.find.estimator), request.find.camera, request.reference)
    for number, each in enumerate(listed, 1):
        tell(f"{source}: {number}  {each.described()}")
    return candidates_to_json(listed)


def _remove_leftovers(targets: list[Place]) -> None:
    for folder in {target.parent for target in targets}:
        if isinstance(folder, Path):
            remove_leftovers(folder)


def _estimate_as_text(motion: Motion, photo: Place, request: Estimates) -> str:
    """Returns the motion as JSON; also plots it if ``--plot`` was given."""
    from unshutter.motion.speed import json_with_speed

    readout_ms = request.find.camera.readout_ms
    if request.plot:
        from unshutter.export.plot import plot_motion

        plot_motion(motion, request.plot, title=photo.name, readout_ms=readout_ms)
    return motion.to_json() if readout_ms is None else json_with_speed(motion, readout_ms)
