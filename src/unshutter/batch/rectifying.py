"""``unshutter rectify``: many photos straightened, each into its own file."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

from unshutter.batch.inputs import Inputs, beside, find_photos, is_folder, motion_name, picture_name, plan_targets
from unshutter.batch.manifest import Manifest
from unshutter.batch.read_ahead import Look, ReadAhead
from unshutter.batch.report import Report
from unshutter.batch.run import Batch
from unshutter.batch.work import Job, RectifyOptions, do_job
from unshutter.batch.workers import Workers, cluster, processes, this_process
from unshutter.default_estimator import DEFAULT_ESTIMATOR
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import MAX_PIXELS
from unshutter.photo import Photo
from unshutter.storage.files import remove_leftovers
from unshutter.storage.places import absolute, check_place, fingerprint, make_folder, place


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is run, which changes nothing about its results; see the help of ``unshutter rectify``."""

    jobs: int | None = None
    scheduler: str | None = None
    dry_run: bool = False
    json_log: Path | None = None
    max_pixels: int | None = None


@dataclass
class _Plan:
    """The jobs of a batch by what is to be done about them."""

    to_do: list[Job] = field(default_factory=list)
    finished: list[Job] = field(default_factory=list)
    refused: list[tuple[Job, str]] = field(default_factory=list)


def rectify_files(
    photos: Sequence[str | os.PathLike[str]],
    output: str | None,
    save_motion: str | None,
    options: RectifyOptions,
    how: BatchOptions | None = None,
) -> int:
    """Rectifies each photo into its own file; returns the exit code."""
    how = how or BatchOptions()
    _check(options, how)
    goal = place(output) if output is not None else None
    inputs = find_photos(photos, leave_out=goal)
    if options.format and goal is not None and not is_folder(goal, inputs.many):
        raise UsageError(f"--format is for folders: the name '{goal.name}' says the format")
    jobs = _jobs(inputs, output, save_motion, options, how)
    motion = _motion_text(options.motion)
    # results beside their photos, and that of a single photo, are known by their names alone
    manifest = Manifest(goal, _digest(options, motion)) if goal is not None and inputs.many else None
    plan = _plan(jobs, manifest, options.overwrite)
    if how.dry_run:
        return _say_what_would_be_done(plan, inputs)
    here = how.jobs is None and how.scheduler is None
    grey = motion is None and options.estimator == DEFAULT_ESTIMATOR
    ahead = ReadAhead([job.source for job in plan.to_do], how.max_pixels or MAX_PIXELS, grey) if here else None
    if motion is None and plan.to_do:
        look = _look(options)  # after the first photo: it is decoded meanwhile
        if ahead is not None:
            ahead.look = look
    with Report(len(jobs) + len(inputs.unreadable), len(plan.to_do), how.json_log) as report:
        _report_what_is_known(plan, inputs, report)
        _prepare_folders(jobs, inputs, output, save_motion)
        with _workers(how) as workers:
            given = {"opened": ahead.photo} if ahead else {}
            work = partial(do_job, options=options, motion=motion, **given)
            Batch(work, workers, manifest, report).run(plan.to_do)
    return report.exit_code()


def _check(options: RectifyOptions, how: BatchOptions) -> None:
    if options.quality is not None and not 1 <= options.quality <= 100:
        raise UsageError(f"quality must lie between 1 and 100, got {options.quality}")
    if not 0 <= options.strength <= 1:
        raise UsageError(f"strength must lie between 0 and 1, got {options.strength:g}")
    told = {"--focal-px": options.focal_px, "--roll-deg": options.roll_deg, "--tilt-deg": options.tilt_deg}
    for flag in (flag for flag, value in told.items() if value is not None and options.motion is not None):
        raise UsageError(f"{flag} is for finding a motion: leave it out with --motion")
    if how.jobs is not None and how.jobs < 1:
        raise UsageError(f"--jobs must be at least 1, got {how.jobs}")
    if how.max_pixels is not None and how.max_pixels < 1:
        raise UsageError(f"--max-pixels must be at least 1, got {how.max_pixels}")
    if how.jobs is not None and how.scheduler is not None:
        raise UsageError("--jobs is for this machine, --scheduler for a cluster: choose one of them")


def _jobs(
    inputs: Inputs, output: str | None, save_motion: str | None, options: RectifyOptions, how: BatchOptions
) -> list[Job]:
    rectified = partial(picture_name, format=options.format)
    targets = plan_targets(inputs, output, rectified) if output is not None else beside(inputs, rectified)
    motions = plan_targets(inputs, save_motion, motion_name) if save_motion else {}
    where = absolute if how.scheduler is not None else lambda given: given  # other machines have other ways
    return [
        Job(
            source=where(photo),
            target=where(target),
            motion_target=where(motions[photo]) if motions else None,
            overwrite=options.overwrite,
            max_pixels=how.max_pixels or MAX_PIXELS,
        )
        for photo, target in targets.items()
    ]


def _look(options: RectifyOptions) -> Look:
    """Begins to estimate a photo's motion, as its job will ask for it."""
    from unshutter.estimators import ahead
    from unshutter.rectification import view_of

    estimator = ahead.of(options.estimator)
    estimator.prepare()

    def look(photo: Photo, executor: Executor) -> None:
        view = view_of(photo, options.readout, options.focal_px, options.roll_deg, options.tilt_deg)
        estimator.begin(view, executor)

    return look


def _motion_text(path: Path | None) -> str | None:
    if path is None:
        return None
    from unshutter.motion import Motion

    return Motion.load(path).to_json()


def _digest(options: RectifyOptions, motion: str | None) -> str:
    """Changes when results would."""
    import hashlib  # not above: it takes 15 ms, and a single photo does not need it

    _, _, weights = options.estimator.partition("@")
    about = {**asdict(options), "motion": motion, "overwrite": None, "weights": weights and fingerprint(Path(weights))}
    del about["format"]  # the result's name says it
    if options.subsampling is None:  # as in digests from before there was this option
        del about["subsampling"]
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:16]


def _plan(jobs: list[Job], manifest: Manifest | None, overwrite: bool) -> _Plan:
    if manifest is None:
        return _Plan(jobs)
    plan = _Plan()
    for job in jobs:
        verdict = manifest.verdict(job)
        if verdict == "another's" and not overwrite:
            reason = f"{job.target} is the result of another photo: choose another folder, or use --overwrite"
            plan.refused.append((job, f"{job.source}: {reason}"))
        elif verdict == "finished" and not overwrite:
            plan.finished.append(job)
        else:
            plan.to_do.append(replace(job, overwrite=True) if verdict == "ours" else job)
    return plan


def _say_what_would_be_done(plan: _Plan, inputs: Inputs) -> int:
    refused = [reason for _, reason in plan.refused]
    refused += [f"cannot read folder {folder}: {reason}" for folder, reason in inputs.unreadable]
    count = 0
    for job in plan.to_do:
        try:
            if not isinstance(job.target, Path) or job.target.parent.is_dir():
                check_place(job.target, job.overwrite, job.source)
        except UnshutterError as error:
            refused.append(f"{job.source}: {error}")
        else:
            count += 1
            print(f"{job.source} -> {job.target}")
    for reason in refused:
        print(f"unshutter: {reason}", file=sys.stderr)
    line = f"{count} photos to do, {len(plan.finished)} finished already, {len(refused)} refused"
    print(f"unshutter: {line}; nothing was written", file=sys.stderr)
    return 1 if refused else 0


def _report_what_is_known(plan: _Plan, inputs: Inputs, report: Report) -> None:
    for folder, reason in inputs.unreadable:
        report.failed(folder, f"cannot read folder {folder}: {reason}")
    for job in plan.finished:
        report.skipped(job.source, job.target)
    for job, reason in plan.refused:
        report.failed(job.source, reason)


def _prepare_folders(jobs: list[Job], inputs: Inputs, output: str | None, save_motion: str | None) -> None:
    """Makes the folders that results go to, and clears them of what killed runs left."""
    targets = [job.target for job in jobs]
    motions = [job.motion_target for job in jobs if job.motion_target is not None]
    for goal, places in ((output, targets), (save_motion, motions)):
        for folder in dict.fromkeys(where.parent for where in places):
            if goal is not None and is_folder(place(goal), inputs.many):
                make_folder(folder)
            if isinstance(folder, Path) and inputs.many:
                remove_leftovers(folder)


def _workers(how: BatchOptions) -> AbstractContextManager[Workers]:
    if how.scheduler is not None:
        return cluster(how.scheduler)
    return processes(how.jobs) if how.jobs is not None else this_process()
