"""Plans a run of ``unshutter rectify``: its jobs, finished results, and the files that must not be overwritten."""

from __future__ import annotations

import json
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import partial
from pathlib import Path

from unshutter.batch.inputs import Inputs
from unshutter.batch.job import Job
from unshutter.batch.manifest import NAME, Manifest
from unshutter.batch.preview import SHEET_PX
from unshutter.batch.targets import (
    check_is_folder,
    check_named_once,
    is_folder,
    mask_targets,
    motion_names,
    next_to_photos,
    picture_name,
    plan_targets,
)
from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.register import weights_file
from unshutter.options import Rectify, Run, model_for
from unshutter.photo.formats import of_target
from unshutter.storage.files import check_target, remove_leftovers
from unshutter.storage.places import Place, absolute, fingerprint, make_folder, place
from unshutter.storage.protection import Protection

# options of a result that the first digests contained, or whose defaults may still change
_ALWAYS_COUNTED = frozenset(
    {
        *("estimator", "focal_px", "quality", "readout", "reference", "roll_deg", "strength", "edges", "tilt_deg"),
        "min_confidence",
    }
)


@dataclass(frozen=True)
class Outputs:
    """Destinations of a run's results.

    Attributes:
        pictures: file (one photo) or folder; None: next to the photos.
        motions: file (one photo) or folder for motion files; None: no motion files.
        masks: folder for masks; None: no masks.
    """

    pictures: str | None = None
    motions: str | None = None
    masks: str | None = None


@dataclass
class Plan:
    """The jobs of a batch: to do, finished or refused."""

    to_do: list[Job] = field(default_factory=list)
    finished: list[Job] = field(default_factory=list)
    refused: list[tuple[Job, str]] = field(default_factory=list)


def with_coordinates(request: Rectify, into: Outputs) -> Rectify:
    """Adapts the request to keep whole pictures if motion files or masks refer to their pixels.

    Raises:
        UsageError: masks are requested for cropped pictures.
    """
    if into.masks is not None and request.undo.edges == "crop":
        raise UsageError("--masks are for whole pictures: leave out --edges crop")
    if into.motions is not None and (request.neighbours or request.neighbours.sequence):
        request = _with_camera_motion(request)
    if into.motions is None and into.masks is None:
        return request
    return replace(request, undo=request.undo.keeping_coordinates())


def _with_camera_motion(request: Rectify) -> Rectify:
    """Adapts the request to a motion model that a motion file can hold.

    Raises:
        UsageError: other options need a different model.
    """
    neighbours = request.neighbours
    if model_for(neighbours.model, neighbours.at, request.undo) == "dense":
        raise UsageError(
            "--save-motion needs a motion of the camera alone: leave out --model dense, --at and --edges borrow"
        )
    return replace(request, neighbours=replace(neighbours, model="camera"))


def jobs_for(inputs: Inputs, into: Outputs, request: Rectify, run: Run) -> list[Job]:
    """Creates a job for each photo."""
    rectified = partial(picture_name, format=request.save.format, keep=request.save.keep_names)
    pictures = into.pictures
    targets = plan_targets(inputs, pictures, rectified) if pictures is not None else next_to_photos(inputs, rectified)
    motions = plan_targets(inputs, into.motions, motion_names(inputs)) if into.motions else {}
    masks = mask_targets(inputs, into.masks, targets) if into.masks else {}
    where = absolute if run.scheduler is not None else lambda path: path  # other machines: other working folders
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


def check_have_times(jobs: list[Job]) -> None:
    """Checks that photos and results are files with ``--keep-times``: only the store sets times of objects.

    Raises:
        UsageError: one of them is behind a URL.
    """
    for where in (file for job in jobs for file in (job.source, job.target)):
        if not isinstance(where, Path):
            raise UsageError(f"--keep-times is for files, and {where} is behind a URL: leave it out")


def protection_of(inputs: Inputs, jobs: list[Job], into: Outputs, request: Rectify, run: Run) -> Protection:
    """Collects the files that no output may overwrite.

    Raises:
        UsageError: one name is used for two files of the run.
    """
    weights = weights_file(request.find.estimator)
    home = manifest_folder(inputs, into, run)
    manifest = home / f"{NAME}.jsonl" if home is not None else None
    named: list[tuple[str, Place | None]] = [
        *(("the picture", job.target) for job in jobs),
        *(("its motion", job.motion_target) for job in jobs),
        *(("its mask", job.mask_target) for job in jobs),
        ("--motion", request.motion),
        ("--before", request.neighbours.before),
        ("--after", request.neighbours.after),
        ("the weights", weights),
        ("--json-log", run.json_log),
        ("--preview", run.preview),
        ("the manifest", manifest),
    ]
    check_named_once(named)
    named_folders = (into.pictures, into.motions, into.masks)
    folders = [place(folder) if folder is not None else None for folder in named_folders]
    neighbours = (request.neighbours.before, request.neighbours.after)
    protection = Protection([*inputs.photos, *neighbours, request.motion, weights], folders)
    if run.preview is not None:
        of_target(run.preview)
        protection.check(run.preview)
        check_target(run.preview, run.overwrite)
        remove_leftovers(run.preview.parent)
    return protection


def check_neighbours(request: Rectify, photos: int, run: Run) -> None:
    """Checks the request for a photo with neighbours.

    Raises:
        UsageError: it names several photos, or a scheduler.
    """
    if not request.neighbours:
        return
    if photos > 1:
        raise UsageError(f"--before and --after are the neighbours of one photo, but there are {photos}")
    if run.scheduler is not None:
        raise UsageError("--before and --after are for this machine: leave out --scheduler")


def digest_of(request: Rectify, motion: str | None) -> str:
    """Returns a digest of all options that affect results. Newer options are included only if not at their defaults."""
    weights = weights_file(request.find.estimator)
    facts = {"motion": motion, "weights": "" if weights is None else fingerprint(weights), "overwrite": None}
    neighbours = request.neighbours
    for group in (request.find, request.find.camera, request.undo, request.save, neighbours, neighbours.clock):
        for each in fields(group):
            value = vars(group)[each.name]
            if each.name in _ALWAYS_COUNTED or (each.default is not MISSING and value != each.default):
                facts[each.name] = value
    for name in ("format", "keep_names"):  # already part of the result's name
        facts.pop(name, None)
    from hashlib import sha256  # imported here: see plain_files.digest

    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


def manifest_folder(inputs: Inputs, into: Outputs, run: Run) -> Place | None:
    """Returns the folder of the manifest; None if no later run will look for the results.

    Raises:
        UsageError: a folder is named for a single photo, or the name is that of a file.
    """
    if run.manifest is None:
        return place(into.pictures) if into.pictures is not None and inputs.many else None
    if not inputs.many:
        raise UsageError("--manifest is for several photos: leave it out")
    home = place(run.manifest)
    check_is_folder(home, run.manifest, "the manifest needs")
    return home


def plan_for(jobs: list[Job], manifest: Manifest | None, overwrite: bool) -> Plan:
    """Sorts the jobs by the state of their results in the manifest."""
    if manifest is None:
        return Plan(jobs)
    plan = Plan()
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


def prepare_folders(jobs: list[Job], inputs: Inputs, into: Outputs, protection: Protection) -> None:
    """Creates the output folders and removes files left there by killed runs."""
    goals = (into.pictures, into.motions, into.masks)
    for goal, places in zip(goals, zip(*(job.targets for job in jobs), strict=True), strict=False):
        for folder in dict.fromkeys(where.parent for where in places if where is not None):
            try:
                protection.check_folder(folder)
            except UnshutterError:  # each of its photos will report it
                continue
            if goal is not None and (goal is into.masks or is_folder(place(goal), inputs.many)):
                make_folder(folder)
            if isinstance(folder, Path):
                remove_leftovers(folder)
