"""``unshutter rectify``: many photos straightened, each into its own file."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import partial
from pathlib import Path

from unshutter.batch.inputs import Inputs, find_photos
from unshutter.batch.job import Job
from unshutter.batch.manifest import NAME, Manifest
from unshutter.batch.report import Report
from unshutter.batch.run import Batch, check_outputs
from unshutter.batch.targets import beside, check_named_once, is_folder, motion_names, picture_name, plan_targets
from unshutter.batch.work import do_job
from unshutter.batch.workers import Workers, cluster, processes, this_process
from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.register import check_name
from unshutter.options import Rectify, Run
from unshutter.prefetch import Prefetch
from unshutter.storage.files import remove_leftovers
from unshutter.storage.places import Place, absolute, fingerprint, make_folder, place
from unshutter.storage.protection import Protection

# of a result: those in the first digests, and those whose defaults may yet change
_ALWAYS_COUNTED = frozenset(
    {
        *("estimator", "focal_px", "quality", "readout", "reference", "roll_deg", "strength", "edges", "tilt_deg"),
        "min_confidence",
    }
)


@dataclass
class _Plan:
    """The jobs of a batch by what is to be done about them."""

    to_do: list[Job] = field(default_factory=list)
    finished: list[Job] = field(default_factory=list)
    refused: list[tuple[Job, str]] = field(default_factory=list)


def rectify_files(
    photos: Sequence[str | os.PathLike[str]], output: str | None, save_motion: str | None, wanted: Rectify, run: Run
) -> int:
    """Rectifies each photo into its own file; returns the exit code."""
    goal = place(output) if output is not None else None
    inputs = find_photos(photos, leave_out=goal)
    if wanted.save.format and goal is not None and not is_folder(goal, inputs.many):
        raise UsageError(f"--format is for folders: the name '{goal.name}' says the format")
    check_name(wanted.find.estimator)
    _check_neighbours(wanted, len(inputs.photos), save_motion, run)
    if save_motion is not None:
        wanted = replace(wanted, undo=wanted.undo.keeping_coordinates())
    motion = _motion_text(wanted.motion)
    jobs = _jobs(inputs, output, save_motion, wanted, run)
    protection = _protection(inputs, jobs, output, save_motion, wanted, run)
    # results beside their photos, and that of a single photo, are known by their names alone
    manifest = Manifest(goal, _digest(wanted, motion)) if goal is not None and inputs.many else None
    plan = _plan(jobs, manifest, run.overwrite)
    if run.dry_run:
        return _say_what_would_be_done(plan, inputs, protection)
    prefetch = None
    if run.jobs is run.scheduler is run.timeout is None and plan.to_do:  # the work is done here
        sources = [job.source for job in plan.to_do]
        prefetch = Prefetch(sources, wanted.find_alone, run.max_pixels, wanted.undo)
    with Report(len(jobs) + len(inputs.unreadable), len(plan.to_do), run.json_log, inputs, protection) as report:
        _report_what_is_known(plan, inputs, report)
        _prepare_folders(jobs, inputs, output, save_motion, protection)
        with _workers(run) as workers:
            here = {"prefetch": prefetch} if prefetch else {}  # nothing that could be sent to another process
            work = partial(do_job, wanted=wanted, motion=motion, **here)
            Batch(work, workers, manifest, report, protection).run(plan.to_do)
    return report.exit_code()


def _jobs(inputs: Inputs, output: str | None, save_motion: str | None, wanted: Rectify, run: Run) -> list[Job]:
    rectified = partial(picture_name, format=wanted.save.format)
    targets = plan_targets(inputs, output, rectified) if output is not None else beside(inputs, rectified)
    motions = plan_targets(inputs, save_motion, motion_names(inputs)) if save_motion else {}
    where = absolute if run.scheduler is not None else lambda given: given  # other machines have other ways
    return [
        Job(
            source=where(photo),
            target=where(target),
            motion_target=where(motions[photo]) if motions else None,
            overwrite=run.overwrite,
            max_pixels=run.max_pixels,
        )
        for photo, target in targets.items()
    ]


def _protection(
    inputs: Inputs, jobs: list[Job], output: str | None, save_motion: str | None, wanted: Rectify, run: Run
) -> Protection:
    """What no output may be written over.

    Raises:
        UsageError: one name stands for two files of the run.
    """
    _, at, file = wanted.find.estimator.partition("@")
    weights = Path(file) if at else None
    manifest = place(output) / f"{NAME}.jsonl" if output is not None and inputs.many else None
    named: list[tuple[str, Place | None]] = [
        *(("the picture", job.target) for job in jobs),
        *(("its motion", job.motion_target) for job in jobs),
        ("--motion", wanted.motion),
        ("--before", wanted.neighbours.before),
        ("--after", wanted.neighbours.after),
        ("the weights", weights),
        ("--json-log", run.json_log),
        ("the manifest", manifest),
    ]
    check_named_once(named)
    neighbours = (wanted.neighbours.before, wanted.neighbours.after)
    folders = [place(folder) if folder is not None else None for folder in (output, save_motion)]
    return Protection([*inputs.photos, *neighbours, wanted.motion, weights], folders)


def _check_neighbours(wanted: Rectify, photos: int, save_motion: str | None, run: Run) -> None:
    """Raises UsageError where the request does not go with a photo's neighbours."""
    if not wanted.neighbours:
        return
    if photos > 1:
        raise UsageError(f"--before and --after are the neighbours of one photo, but there are {photos}")
    if save_motion is not None:
        raise UsageError("--save-motion needs a motion of the camera alone: leave out --before and --after")
    if run.scheduler is not None:
        raise UsageError("--before and --after are for this machine: leave out --scheduler")


def _motion_text(path: Path | None) -> str | None:
    if path is None:
        return None
    from unshutter.motion import Motion

    return Motion.load(path).to_json()


def _digest(wanted: Rectify, motion: str | None) -> str:
    """Changes when results would. An option that is younger than digests counts only where it is not at its default."""
    import hashlib  # not above: it takes 15 ms, and a single photo does not need it

    _, _, weights = wanted.find.estimator.partition("@")
    given = {"motion": motion, "weights": weights and fingerprint(Path(weights)), "overwrite": None}
    for group in (wanted.find, wanted.find.camera, wanted.undo, wanted.save):
        for each in fields(group):
            value = vars(group)[each.name]
            if each.name in _ALWAYS_COUNTED or (each.default is not MISSING and value != each.default):
                given[each.name] = value
    given.pop("format", None)  # the result's name says it
    return hashlib.sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:16]


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
            plan.to_do.append(manifest.prepared(job))
    return plan


def _say_what_would_be_done(plan: _Plan, inputs: Inputs, protection: Protection) -> int:
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
            print(f"{job.source} -> {job.target}")
    for reason in refused:
        print(f"unshutter: {reason}", file=sys.stderr)
    if inputs.passed_over:
        print(f"unshutter: {inputs.not_taken()}", file=sys.stderr)
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


def _prepare_folders(
    jobs: list[Job], inputs: Inputs, output: str | None, save_motion: str | None, protection: Protection
) -> None:
    """Makes the folders that results go to, and clears them of what killed runs left."""
    targets = [job.target for job in jobs]
    motions = [job.motion_target for job in jobs if job.motion_target is not None]
    for goal, places in ((output, targets), (save_motion, motions)):
        for folder in dict.fromkeys(where.parent for where in places):
            try:
                protection.check_folder(folder)
            except UnshutterError:  # as each of its photos will say
                continue
            if goal is not None and is_folder(place(goal), inputs.many):
                make_folder(folder)
            if isinstance(folder, Path):
                remove_leftovers(folder)


def _workers(run: Run) -> AbstractContextManager[Workers]:
    if run.scheduler is not None:
        return cluster(run.scheduler)
    if run.jobs is not None:
        return processes(run.jobs, run.timeout)
    if run.timeout is not None:  # this process could not stop a decoder that hangs in it
        return processes(1, run.timeout, all_processors=True)
    return this_process()
