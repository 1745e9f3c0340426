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
from unshutter.batch.preview import SHEET_PX, Preview
from unshutter.batch.report import Report
from unshutter.batch.run import Batch, check_outputs
from unshutter.batch.sequences import check_sequence, with_motions
from unshutter.batch.targets import (
    beside,
    check_named_once,
    is_folder,
    mask_targets,
    motion_names,
    picture_name,
    plan_targets,
)
from unshutter.batch.work import do_job
from unshutter.batch.workers import Workers, cluster, processes, this_process
from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.estimators.register import check_name, weights_file
from unshutter.options import Rectify, Run, model_for
from unshutter.photo.formats import of_target
from unshutter.prefetch import Prefetch
from unshutter.storage.files import check_target, remove_leftovers
from unshutter.storage.places import Place, absolute, fingerprint, make_folder, place
from unshutter.storage.protection import Protection

# of a result: those in the first digests, and those whose defaults may yet change
_ALWAYS_COUNTED = frozenset(
    {
        *("estimator", "focal_px", "quality", "readout", "reference", "roll_deg", "strength", "edges", "tilt_deg"),
        "min_confidence",
    }
)


@dataclass(frozen=True)
class Outputs:
    """Where the results of a run go.

    Attributes:
        pictures: file (one photo) or folder; None: beside the photos.
        motions: the same for motion files; None: none are wanted.
        masks: folder for masks; None: none are wanted.
    """

    pictures: str | None = None
    motions: str | None = None
    masks: str | None = None


@dataclass
class _Plan:
    """The jobs of a batch by what is to be done about them."""

    to_do: list[Job] = field(default_factory=list)
    finished: list[Job] = field(default_factory=list)
    refused: list[tuple[Job, str]] = field(default_factory=list)


def rectify_files(photos: Sequence[str | os.PathLike[str]], into: Outputs, wanted: Rectify, run: Run) -> int:
    """Rectifies each photo into its own file; returns the exit code."""
    goal = place(into.pictures) if into.pictures is not None else None
    inputs = find_photos(photos, leave_out=goal)
    if wanted.save.format and goal is not None and not is_folder(goal, inputs.many):
        raise UsageError(f"--format is for folders: the name '{goal.name}' says the format")
    check_name(wanted.find.estimator)
    _check_neighbours(wanted, len(inputs.photos), run)
    check_sequence(wanted, len(inputs.photos))
    wanted = _with_coordinates(wanted, into)
    if wanted.save.keep_names and (goal is None or not is_folder(goal, inputs.many)):
        raise UsageError("--keep-names needs --output FOLDER for the results")
    motion = _motion_text(wanted.motion)
    jobs = _jobs(inputs, into, wanted, run)
    if wanted.save.keep_times:
        _check_have_times(jobs)
    protection = _protection(inputs, jobs, into, wanted, run)
    # results beside their photos, and that of a single photo, are known by their names alone
    manifest = Manifest(goal, _digest(wanted, motion)) if goal is not None and inputs.many else None
    plan = _plan(jobs, manifest, run.overwrite)
    if run.dry_run:
        return _say_what_would_be_done(plan, inputs, protection)
    if wanted.neighbours.sequence and plan.to_do:
        plan.to_do = with_motions(plan.to_do, list(inputs.photos), wanted, run.max_pixels)
    prefetch = None
    if run.jobs is run.scheduler is run.timeout is None and plan.to_do:  # the work is done here
        sources = [job.source for job in plan.to_do]
        prefetch = Prefetch(sources, wanted.find_alone, run.max_pixels, wanted.undo)
    with Report(len(jobs) + len(inputs.unreadable), len(plan.to_do), run.json_log, inputs, protection) as report:
        report.preview = Preview(run.preview, run.overwrite) if run.preview is not None else None
        _report_what_is_known(plan, inputs, report)
        _prepare_folders(jobs, inputs, into, protection)
        with _workers(run) as workers:
            here = {"prefetch": prefetch} if prefetch else {}  # nothing that could be sent to another process
            work = partial(do_job, wanted=wanted, motion=motion, **here)
            Batch(work, workers, manifest, report, protection).run(plan.to_do)
        report.save_preview()
    return report.exit_code()


def _with_coordinates(wanted: Rectify, into: Outputs) -> Rectify:
    """The same, whole pictures where motions or masks tell of their pixels.

    Raises:
        UsageError: masks of pictures that are cropped.
    """
    if into.masks is not None and wanted.undo.edges == "crop":
        raise UsageError("--masks are for whole pictures: leave out --edges crop")
    if into.motions is not None and (wanted.neighbours or wanted.neighbours.sequence):
        wanted = _with_camera_motion(wanted)
    if into.motions is None and into.masks is None:
        return wanted
    return replace(wanted, undo=wanted.undo.keeping_coordinates())


def _with_camera_motion(wanted: Rectify) -> Rectify:
    """The same, described by a motion that a motion file can hold.

    Raises:
        UsageError: what is asked for needs another one.
    """
    given = wanted.neighbours
    if model_for(given.model, given.at, wanted.undo) == "dense":
        raise UsageError(
            "--save-motion needs a motion of the camera alone: leave out --model dense, --at and --edges borrow"
        )
    return replace(wanted, neighbours=replace(given, model="camera"))


def _jobs(inputs: Inputs, into: Outputs, wanted: Rectify, run: Run) -> list[Job]:
    rectified = partial(picture_name, format=wanted.save.format, keep=wanted.save.keep_names)
    pictures = into.pictures
    targets = plan_targets(inputs, pictures, rectified) if pictures is not None else beside(inputs, rectified)
    motions = plan_targets(inputs, into.motions, motion_names(inputs)) if into.motions else {}
    masks = mask_targets(inputs, into.masks, targets) if into.masks else {}
    where = absolute if run.scheduler is not None else lambda given: given  # other machines have other ways
    preview_px = 0 if len(targets) == 1 else SHEET_PX
    return [
        Job(
            source=where(photo),
            target=where(target),
            motion_target=where(motions[photo]) if motions else None,
            mask_target=where(masks[photo]) if masks else None,
            overwrite=run.overwrite,
            max_pixels=run.max_pixels,
            preview_px=preview_px if run.preview is not None else None,
        )
        for photo, target in targets.items()
    ]


def _check_have_times(jobs: list[Job]) -> None:
    """Raises UsageError where a photo or its result is no file: objects have times that only their store sets."""
    for where in (given for job in jobs for given in (job.source, job.target)):
        if not isinstance(where, Path):
            raise UsageError(f"--keep-times is for files, and {where} is behind a URL: leave it out")


def _protection(inputs: Inputs, jobs: list[Job], into: Outputs, wanted: Rectify, run: Run) -> Protection:
    """What no output may be written over.

    Raises:
        UsageError: one name stands for two files of the run.
    """
    weights = weights_file(wanted.find.estimator)
    manifest = place(into.pictures) / f"{NAME}.jsonl" if into.pictures is not None and inputs.many else None
    named: list[tuple[str, Place | None]] = [
        *(("the picture", job.target) for job in jobs),
        *(("its motion", job.motion_target) for job in jobs),
        *(("its mask", job.mask_target) for job in jobs),
        ("--motion", wanted.motion),
        ("--before", wanted.neighbours.before),
        ("--after", wanted.neighbours.after),
        ("the weights", weights),
        ("--json-log", run.json_log),
        ("--preview", run.preview),
        ("the manifest", manifest),
    ]
    check_named_once(named)
    named_folders = (into.pictures, into.motions, into.masks)
    folders = [place(folder) if folder is not None else None for folder in named_folders]
    neighbours = (wanted.neighbours.before, wanted.neighbours.after)
    protection = Protection([*inputs.photos, *neighbours, wanted.motion, weights], folders)
    if run.preview is not None:
        of_target(run.preview)
        protection.check(run.preview)
        check_target(run.preview, run.overwrite)
        remove_leftovers(run.preview.parent)
    return protection


def _check_neighbours(wanted: Rectify, photos: int, run: Run) -> None:
    """Raises UsageError where the request does not go with a photo's neighbours."""
    if not wanted.neighbours:
        return
    if photos > 1:
        raise UsageError(f"--before and --after are the neighbours of one photo, but there are {photos}")
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

    weights = weights_file(wanted.find.estimator)
    given = {"motion": motion, "weights": "" if weights is None else fingerprint(weights), "overwrite": None}
    neighbours = wanted.neighbours
    for group in (wanted.find, wanted.find.camera, wanted.undo, wanted.save, neighbours, neighbours.clock):
        for each in fields(group):
            value = vars(group)[each.name]
            if each.name in _ALWAYS_COUNTED or (each.default is not MISSING and value != each.default):
                given[each.name] = value
    for name in ("format", "keep_names"):  # the result's name says them
        given.pop(name, None)
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
            print(visible(f"{job.source} -> {job.target}"))
    for reason in refused:
        print(visible(f"unshutter: {reason}"), file=sys.stderr)
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


def _prepare_folders(jobs: list[Job], inputs: Inputs, into: Outputs, protection: Protection) -> None:
    """Makes the folders that results go to, and clears them of what killed runs left."""
    goals = (into.pictures, into.motions, into.masks)
    for goal, places in zip(goals, zip(*(job.targets for job in jobs), strict=True), strict=False):
        for folder in dict.fromkeys(where.parent for where in places if where is not None):
            try:
                protection.check_folder(folder)
            except UnshutterError:  # as each of its photos will say
                continue
            if goal is not None and (goal is into.masks or is_folder(place(goal), inputs.many)):
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
