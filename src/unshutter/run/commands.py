"""The commands that process many photos: ``unshutter rectify`` and ``unshutter estimate``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.options import Estimate, Find, Rectify, Run, Undo
from unshutter.progress import tell
from unshutter.run.ahead import Begun, Wanted, look_ahead, open_input
from unshutter.run.bursts import bursts_among
from unshutter.run.folder import Folder
from unshutter.run.inputs import find_photos
from unshutter.run.job import Job, Work
from unshutter.run.manifest import Manifest
from unshutter.run.plan import Goal, Outputs, Plan, make_plan, motion_targets
from unshutter.run.report import Report, Tell, each_photo
from unshutter.single import register
from unshutter.storage.files import check_motion_name, check_target, write_file
from unshutter.storage.locations import RunFiles, absolute

if TYPE_CHECKING:
    from unshutter.run.workers import Workers


def rectify_files(
    photos: Sequence[str | os.PathLike[str]],
    into: Outputs,
    request: Rectify,
    run: Run,
    levelling: Sequence[str] = (),
) -> int:
    """Rectifies each photo into its own file; returns the exit code.

    Args:
        levelling: words after ``unshutter rectify`` that do this and level the photos, too; empty: there are none.
    """
    inputs = find_photos(photos, leave_out=into.pictures.path if into.pictures is not None else None)
    plan = make_plan(inputs, into, request, run)
    if plan.can_level:
        plan.levelling = tuple(levelling)
    manifest = None
    if plan.home is not None:
        motion = None if plan.given is None else plan.given.to_json()
        manifest = Manifest(plan.home, plan.request, motion, run.manifest is not None, read_only=run.dry_run)
    with closing(manifest) if manifest is not None else nullcontext():
        if manifest is not None:
            plan.sort(manifest)
        return _carry_out(plan, manifest) if not run.dry_run else _dry_run(plan, manifest)


def _carry_out(plan: Plan, manifest: Manifest | None) -> int:
    """Does the jobs of a plan and reports them; returns the exit code."""
    request = plan.request
    run = plan.run
    ratio = None
    folder = Folder() if plan.judged_together else None
    if folder is not None and manifest is not None:
        for job in plan.finished:
            folder.add(job, manifest.judged(job))
    if request.neighbours.sequence and plan.to_do:
        from unshutter.run.sequences import add_motions

        plan.to_do, ratio = add_motions(plan.to_do, list(plan.inputs.photos), request, run.max_pixels)
    elif plan.judged_together and request.find.estimator == Find().estimator:
        to_do = {job: absolute(job.source) for job in plan.to_do}
        bursts = bursts_among(plan.inputs.photos, {*to_do.values()}, request.find.camera, run.max_pixels)
        plan.to_do = [replace(job, burst=bursts.get(path)) for job, path in to_do.items()]
    recorded = manifest is not None or folder is not None
    work = Work(request, plan.given, run.max_pixels, run.overwrite, recorded, plan.preview_px)
    here = run.scheduler is run.jobs is run.timeout is None
    begun = work.begin(plan.to_do) if here else iter(())
    from unshutter.run.loop import Record, rectify_all  # imported here: the first photo is being opened meanwhile

    with Report(plan) as report:
        report.begin("" if ratio is None else f"unshutter: readout ratio {ratio}")
        # what a killed run left beside a finished result goes, too
        plan.files.prepare(target for job in (*plan.to_do, *plan.finished) for target in job.outputs)
        record = Record(report, plan.files, run.overwrite, manifest, folder)
        with nullcontext() if here else _workers_for(run, len(plan.to_do)) as workers:
            rectify_all(plan.to_do, work, record, begun, workers)
        report.save_preview()
        if folder is not None:
            report.tell_of_folder(folder)
    return report.exit_code()


def _workers_for(run: Run, photos: int) -> AbstractContextManager[Workers]:
    """Returns the workers that the options of a run call for: a cluster, or at most a process a photo."""
    from unshutter.run.workers import cluster, processes  # imported here: for one photo, this would take 7 ms

    if run.scheduler is not None:
        return cluster(run.scheduler)
    if run.jobs is not None:
        return processes(min(run.jobs, max(photos, 1)), run.timeout)
    return processes(1, run.timeout, all_processors=True)  # this process could not stop a decoder that hangs in it


def _dry_run(plan: Plan, manifest: Manifest | None) -> int:
    inputs = plan.inputs
    refused = [reason for _, reason in plan.refused]
    refused += [f"cannot read folder {folder}: {reason}" for folder, reason in inputs.unreadable]
    count = 0
    at_once = 0
    for job in plan.to_do:
        try:
            job.check_outputs(plan.files, plan.run.overwrite, new_folders=True)
        except UnshutterError as error:
            if manifest is None or not manifest.has_begun(job):  # by another run, since this one looked
                refused.append(f"{job.source}: {error}")
                continue
        count += 1
        fixed = _exposes_at_once(job, plan.request, plan.run.max_pixels)
        at_once += fixed
        print(visible(f"{job.source} -> {job.picture}{' (no motion: its camera exposes all rows at once)' * fixed}"))
    for reason in refused:
        tell(f"unshutter: {reason}")
    if inputs.passed_over:
        tell(f"unshutter: {inputs.not_taken()}")
    photos = "1 photo" if count == 1 else f"{count} photos"
    line = f"{photos} to do, {len(plan.finished)} finished already, {len(refused)} refused"
    tell(f"unshutter: {line}; nothing was written")
    if at_once:
        tell(f"unshutter: {at_once} of them by cameras that expose all rows at once: these have no motion to undo")
    if count > at_once and plan.given is None:
        tell("unshutter: others are left unchanged if their pixels do not show clearly that the camera moved")
    return 1 if refused else 0


def _exposes_at_once(job: Job, request: Rectify, max_pixels: int) -> bool:
    """Whether a photo's metadata tell that its camera exposes all rows at once, so that no motion of it is found."""
    from unshutter.single.estimator import View  # imported here: it needs NumPy

    if request.motion is not None or request.neighbours or request.neighbours.sequence:
        return False
    with suppress(UnshutterError):
        return View(open_input(job.source, max_pixels), request.find.camera).readout_s().longest_s == 0
    return False


def estimate_files(request: Estimate) -> int:
    """Estimates the motion of each photo; returns the exit code."""
    output = request.output
    overwrite = request.overwrite
    inputs = find_photos(request.photos, leave_out=output)
    if inputs.many and output is None and request.json:
        raise UsageError("several photos need {--output} FOLDER for their motions: leave out {--json}")
    if inputs.many and request.plot:
        raise UsageError("{--plot} draws the motion of one photo only")
    if inputs.many and request.lines:
        raise UsageError("{--lines} is for one photo only")
    register.check_name(request.find.estimator)
    goal = Goal(output) if output else None
    targets = motion_targets(inputs, goal) if goal else {}
    for target in targets.values():
        check_motion_name(target.name)
    files = RunFiles(request, reads=[*inputs.files, register.weights_file(request.find.estimator)], folders=[output])
    files.writes("the motion", *targets.values())
    files.prepare([*targets.values(), *filter(None, [request.plot])])
    find = None if request.lines else request.find
    undo = Undo(request.reference)
    ahead = look_ahead([Wanted(photo, find, undo, request.max_pixels, pixels=False) for photo in inputs.photos])

    from unshutter.run.estimates import (  # imported here: the first photo is being opened
        describe_motion,
        list_candidates,
    )

    def one(begun: Begun, tell: Tell) -> None:
        photo = begun.wanted.path
        target = targets.get(photo)
        for file in filter(None, (target, request.plot)):
            files.check(file)
            check_target(file, overwrite)
        answer = list_candidates(begun, request) if request.candidates else describe_motion(begun, request, tell)
        if target is not None:
            write_file(f"{answer.json}\n".encode(), target, overwrite, mode_of=photo)
        answer.report(target, request.json, tell)

    return each_photo(inputs, ahead, one)
