"""The commands that process many photos: ``unshutter rectify`` and ``unshutter estimate``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.options import Estimate, Find, Rectify, Run, Undo
from unshutter.progress import tell
from unshutter.run.ahead import Ahead, Wanted, look_ahead, open_input
from unshutter.run.folder import Folder
from unshutter.run.inputs import find_photos
from unshutter.run.loop import Batch, InThisProcess, Workers, check_outputs
from unshutter.run.manifest import Manifest
from unshutter.run.plan import Goal, Outputs, Plan, add_bursts, add_motions, make_plan, motion_targets
from unshutter.run.report import Report, Tell, about, each_photo
from unshutter.run.work import Job, do_job
from unshutter.single import register
from unshutter.storage.files import check_motion_name, check_target, write_file
from unshutter.storage.locations import RunFiles

if TYPE_CHECKING:
    from pathlib import Path

    from unshutter.motion.verdict import Verdict


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
        return _carried_out(plan, manifest) if not run.dry_run else _dry_run(plan, manifest)


def _carried_out(plan: Plan, manifest: Manifest | None) -> int:
    """Does the jobs of a plan and reports them; returns the exit code."""
    request = plan.request
    run = plan.run
    ratio = None
    folder = Folder() if plan.judged_together else None
    if folder is not None and manifest is not None:
        for job in plan.finished:
            folder.add(job, manifest.judged(job))
    if request.neighbours.sequence and plan.to_do:
        plan.to_do, ratio = add_motions(plan.to_do, list(plan.inputs.photos), request, run.max_pixels)
    elif plan.judged_together and request.find.estimator == Find().estimator:
        plan.to_do = add_bursts(plan)
    ahead: Iterable[Ahead] = ()
    if run.jobs is run.scheduler is run.timeout is None:
        sources = [job.source for job in plan.to_do if job.burst is None]
        ahead = look_ahead(sources, Wanted(request.find_alone, request.undo, run.max_pixels))
    with Report(plan) as report:
        report.begin("" if ratio is None else f"unshutter: readout ratio {ratio}")
        # what a killed run left beside a finished result goes, too
        plan.files.prepare(target for job in (*plan.to_do, *plan.finished) for target in job.outputs)
        with _workers_for(run, len(plan.to_do)) as workers:
            work = partial(do_job, request=request, given=plan.given, ahead=ahead)
            batch = Batch(work, workers, manifest, report, plan.files, folder)
            batch.run(plan.to_do)
        batch.remove_leftovers()
        report.save_preview()
        if folder is not None:
            report.tell_of_folder(folder)
    return report.exit_code()


def _workers_for(run: Run, photos: int) -> AbstractContextManager[Workers]:
    """Returns the workers that the options of a run call for: a cluster, at most a process a photo, or this process."""
    if run.scheduler is run.jobs is run.timeout is None:
        return nullcontext(Workers(InThisProcess(), 1, InThisProcess))
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
            check_outputs(job, plan.files, new_folders=True)
        except UnshutterError as error:
            if manifest is None or not manifest.has_begun(job):  # by another run, since this one looked
                refused.append(f"{job.source}: {error}")
                continue
        count += 1
        fixed = _exposes_at_once(job, plan.request)
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


def _exposes_at_once(job: Job, request: Rectify) -> bool:
    """Whether a photo's metadata tell that its camera exposes all rows at once, so that no motion of it is found."""
    from unshutter.single.estimator import View  # imported here: it needs NumPy

    if request.motion is not None or request.neighbours or request.neighbours.sequence:
        return False
    with suppress(UnshutterError):
        return View(open_input(job.source, job.max_pixels), request.find.camera).readout_s().longest_s == 0
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
    ahead = look_ahead(list(inputs.photos), Wanted(find, undo, request.max_pixels, pixels=False))

    def one(photo: Path, tell: Tell) -> None:
        target = targets.get(photo)
        for file in filter(None, (target, request.plot)):
            files.check(file)
            check_target(file, overwrite)
        begun = next(each for each in ahead if each.path == photo)
        answer = _list_candidates(begun, request) if request.candidates else _describe_motion(begun, request, tell)
        if target is not None:
            write_file(f"{answer.json}\n".encode(), target, overwrite, mode_of=photo)
        answer.report(target, request.json, tell)

    return each_photo(inputs, one)


@dataclass(frozen=True)
class _Answer:
    """What is found about a photo: lines for people, and JSON for programs."""

    photo: Path
    lines: list[str]
    json: str

    def report(self, target: Path | None, as_json: bool, tell: Tell) -> None:
        """Prints the answer: JSON, or else lines, which go to standard error if there is JSON, also in a file."""
        for number, line in enumerate(self.lines):
            if target is None and not as_json:
                print(visible(f"{self.photo}: {line}"))
            else:
                tell(f"{self.photo}: {line}" if target is None or number else f"{self.photo} -> {target}: {line}")
        if target is None and as_json:
            print(self.json)


def _describe_motion(begun: Ahead, request: Estimate, tell: Tell) -> _Answer:
    """Returns a photo's motion as a line for people and as JSON, and draws the plot asked for."""
    from unshutter.motion.verdict import Speed, json_with_speed

    source = begun.path
    readout_ms = request.find.camera.readout_ms
    verdict = begun.verdict if request.lines is None else _judge_lines(begun, request.lines, request, tell)
    found = verdict.finding
    if found.reason:
        line = f"no motion ({found.reason})"
    elif not verdict.changes:
        line = f"rectify leaves it unchanged ({about(verdict)})"
    else:
        chosen = found.candidates[(request.find.candidate or 1) - 1 :][:1]
        line = ", ".join([*(each.name for each in chosen), about(verdict)])
    if request.plot:
        from unshutter.export import plot_motion

        plot_motion(found, request.plot, title=source.name, readout_ms=readout_ms)
    if readout_ms is None:
        return _Answer(source, [line], found.to_json())
    line = f"{line}; {Speed.of(found.motion, readout_ms).described()}"
    return _Answer(source, [line], json_with_speed(found, readout_ms))


def _judge_lines(begun: Ahead, file: Path, request: Estimate, tell: Tell) -> Verdict:
    """Returns the verdict on the motion that straightens lines drawn in a photo, and reports lines that stay askew."""
    from unshutter.api import motion_of_lines
    from unshutter.motion.verdict import judge
    from unshutter.single.drawn_lines import read_lines

    lines = read_lines(file)
    straightened = motion_of_lines(begun.photo, lines, request.find.camera)
    for number, (line, trouble) in enumerate(zip(lines, straightened.troubles, strict=True), 1):
        if trouble:
            tell(f"{begun.path}: line {number} ({line.kind}) stays askew: {trouble.sentence}")
    return judge(straightened.finding, Undo(request.reference))


def _list_candidates(begun: Ahead, request: Estimate) -> _Answer:
    """Returns the candidates of a photo, each in a line, and all as JSON."""
    from unshutter.motion.finding import candidates_to_json

    listed = [candidate.rereferenced(request.reference) for candidate in begun.verdict.finding.candidates]
    lines = [f"{number}  {each.described()}: --candidate {number}" for number, each in enumerate(listed, 1)]
    return _Answer(begun.path, lines, candidates_to_json(listed))
