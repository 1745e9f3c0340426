"""Plans a run of ``unshutter rectify``: its jobs, finished results, and the files that must not be overwritten.

For ``--sequence``, the motions of all frames are found here, before each frame becomes a separate job.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UsageError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options import Rectify, Run, model_for
from unshutter.options.picture_formats import OTHER_PICTURES, SUFFIXES, of_suffix
from unshutter.photo.formats import of_target
from unshutter.run.inputs import Inputs, motion_name, picture_name, unchanged_name, usual_format
from unshutter.run.job import Job
from unshutter.run.manifest import NAME, Manifest
from unshutter.single.register import check_name, weights_file
from unshutter.storage.files import check_motion_name, check_target, remove_leftovers
from unshutter.storage.locations import RunFiles, absolute
from unshutter.storage.objects import is_object, path_of
from unshutter.storage.targets import Target, TargetKind

if TYPE_CHECKING:
    from unshutter.motion.finding import Finding


# Names with these extensions are meant as files, even if a folder is needed.
_FILE_SUFFIXES = {*SUFFIXES, *OTHER_PICTURES, *VIDEO_FORMATS, ".json", ".zip"}


@dataclass(frozen=True)
class Goal:
    """A place for results as the user named it: a folder, or the file of a single result."""

    text: str | os.PathLike[str]

    @cached_property
    def path(self) -> Path:
        """Its path."""
        return path_of(self.text)

    def is_folder(self, many: bool) -> bool:
        """Whether it is a folder for results rather than a single result; a name without extension means a folder."""
        return many or not self.path.suffix or self.path.is_dir()

    def must_be_folder(self, what: str) -> None:
        """Checks that it is a folder, which ``what`` (``masks need``) requires."""
        goal = self.path
        there = goal.is_dir()
        if goal.exists() and not there:
            raise UsageError(f"{what} a folder, but {goal} is none")
        if goal.suffix.lower() in _FILE_SUFFIXES and not there and not os.fspath(self.text).endswith(("/", os.sep)):
            raise UsageError(f"{what} a folder, but {goal.name} is the name of a file: leave out {goal.suffix}")


@dataclass(frozen=True)
class Outputs:
    """Destinations of a run's results."""

    pictures: Goal | None = None  # file (one photo) or folder; None: next to the photos
    motions: Goal | None = None  # file (one photo) or folder for motion files; None: no motion files
    masks: Goal | None = None  # folder for masks; None: no masks

    @classmethod
    def named(cls, *texts: str | None) -> Outputs:
        """Returns the destinations of pictures, motions and masks that the user named."""
        return cls(*(None if text is None else Goal(text) for text in texts))


@dataclass
class Plan:
    """The jobs of a batch, to do, finished or refused, and what all of them share."""

    to_do: list[Job]
    finished: list[Job] = field(default_factory=list)
    refused: list[tuple[Job, str]] = field(default_factory=list)
    inputs: Inputs = field(default_factory=Inputs)  # the photos
    request: Rectify = field(default_factory=Rectify)  # what is done to them
    given: Finding | None = None  # the motion in the file named in ``request``, which other machines may not have
    run: Run = field(default_factory=Run)  # how
    files: RunFiles = field(default_factory=RunFiles)  # the files that are read and written
    home: Path | None = None  # folder of the manifest; None if no later run will look for the results
    levelling: tuple[str, ...] = ()  # words after ``unshutter rectify`` that level the photos, too; empty: unknown

    @property
    def makes_a_set(self) -> bool:
        """Whether the results look meant for photogrammetry: all photos, with masks or under their own names."""
        save = self.request.save
        return not save.only_changed and (save.keep_names or any(job.target(TargetKind.MASK) for job in self.to_do))

    @property
    def can_level(self) -> bool:
        """Whether photos may also be levelled: nothing else refers to their coordinates or neighbours."""
        request = self.request
        neighbours = request.neighbours
        kinds = TargetKind.MOTION, TargetKind.MASK
        kept = any(job.target(kind) for job in self.to_do for kind in kinds)
        return not (kept or neighbours or neighbours.sequence or self.given is not None or request.undo.upright)

    @property
    def judged_together(self) -> bool:
        """Whether the photos of a folder are judged together (folder.py)."""
        request = self.request
        camera = request.find.camera
        neighbours = request.neighbours
        alone = neighbours.each_alone or neighbours or neighbours.sequence or self.given is not None
        decided = camera.moving or request.find.candidate is not None or request.undo.min_confidence is not None
        return self.inputs.many and not alone and not decided

    @property
    def preview_px(self) -> int | None:
        """Long side [px] of the before and after pictures, 0 for full size; None: no preview is asked for."""
        if self.run.preview is None:
            return None
        return 0 if len(self.inputs.photos) == 1 else 320  # px

    def sort(self, manifest: Manifest) -> None:
        """Sorts the jobs to do by the state of their results in the manifest."""
        jobs = self.to_do
        self.to_do = []
        overwrite = self.run.overwrite
        for job in jobs:
            state, known = manifest.compared(job)
            if state == "another's" and not overwrite:
                reason = f"{job.picture} is the result of another photo: choose another folder, or use --overwrite"
                self.refused.append((job, f"{job.source}: {reason}"))
            elif state == "finished" and not overwrite:
                self.finished.append(known)
            else:
                self.to_do.append(known)


def make_plan(inputs: Inputs, into: Outputs, request: Rectify, run: Run) -> Plan:
    """Plans a run: creates a job for each photo, and checks the files that are not a photo's own."""
    request = _check_request(request, inputs, into, run)
    jobs = _jobs_for(inputs, into, request, run)
    home = _manifest_folder(inputs, into, run)
    check_name(request.find.estimator)
    given = None
    if request.motion is not None:
        from unshutter.motion.finding import Finding  # imported here: NumPy comes after decoding has begun

        given = Finding.load(request.motion)
    weights = weights_file(request.find.estimator)
    if run.preview is not None:
        of_target(run.preview)
    folders = [goal.path for goal in (into.pictures, into.motions, into.masks) if goal is not None]
    files = RunFiles(request, run, reads=[*inputs.files, weights], folders=folders)
    if home is not None:
        files.writes("the manifest", home / f"{NAME}.jsonl")
        files.check(home / f"{NAME}.jsonl")
    for kind in TargetKind:
        targets = [target.path for job in jobs if (target := job.target(kind)) is not None]
        files.writes(kind.sentence, *targets)
        if kind is TargetKind.MOTION and len(targets) == 1:  # those of several photos are named here
            check_motion_name(targets[0].name)
    if run.preview is not None:
        check_target(run.preview, run.overwrite)
        remove_leftovers(run.preview.parent)
    return Plan(jobs, inputs=inputs, request=request, given=given, run=run, files=files, home=home)


def _check_request(request: Rectify, inputs: Inputs, into: Outputs, run: Run) -> Rectify:
    """Checks the request against the photos and outputs; returns it adapted to motion files and masks."""
    neighbours = request.neighbours
    save = request.save
    undo = request.undo
    goal = into.pictures
    in_folder = goal is not None and goal.is_folder(inputs.many)
    if save.format and goal is not None and not in_folder:
        raise UsageError(f"{{--format}} is for folders: the name '{goal.path.name}' already sets the format")
    if neighbours and len(inputs.photos) > 1:
        raise UsageError(
            f"{{--before}} and {{--after}} are the neighbours of one photo, but there are {len(inputs.photos)}"
        )
    if neighbours and run.scheduler is not None:
        raise UsageError("{--before} and {--after} are for this machine: leave out {--scheduler}")
    if neighbours.sequence and len(inputs.photos) < 2:
        raise UsageError("{--sequence} needs several photos: name them in order, or their folder")
    if into.masks is not None and undo.edges == "crop":
        raise UsageError("{--masks} are for whole pictures: leave out {--edges} crop")
    if into.motions is not None and (neighbours or neighbours.sequence):
        if model_for(neighbours.model, neighbours.at, undo) == "dense":
            raise UsageError(
                "{--save-motion} needs a motion of the camera alone: leave out {--model} dense, {--at} and {--edges} "
                "borrow"
            )
        request = replace(request, neighbours=replace(neighbours, model="camera"))
    if save.keep_names and not in_folder:
        raise UsageError("{--keep-names} needs {--output} FOLDER for the results")
    # motion files and masks refer to whole pictures, and pictures under their own names replace others in a set
    if into.motions is not None or into.masks is not None or (save.keep_names and not undo.upright):
        return replace(request, undo=undo.keeping_coordinates())
    return request


def _jobs_for(inputs: Inputs, into: Outputs, request: Rectify, run: Run) -> list[Job]:
    """Creates a job for each photo."""

    def rectified(photo: Path) -> str:
        return picture_name(photo, request.save.format or usual_format(photo), request.save.keep_names)

    unchanged: dict[Path, Path] = {}
    if into.pictures is not None:
        pictures = _plan_targets(inputs, into.pictures, rectified)
        own_name = partial(unchanged_name, format=request.save.format, keep=request.save.keep_names)
        unchanged = _plan_targets(inputs, into.pictures, own_name)
        unchanged = {photo: copy for photo, copy in unchanged.items() if not _is_same(photo, copy)}
    else:  # next to the photos, only what changes is written
        pictures = _all_different({photo: photo.with_name(rectified(photo)) for photo in inputs.photos})
    motions = motion_targets(inputs, into.motions) if into.motions else {}
    if into.masks:
        into.masks.must_be_folder("masks need")
    where = absolute if run.scheduler is not None else lambda path: path  # other machines: other working folders

    def name_mask(photo: Path, picture: Path) -> Path | None:
        """Returns the picture's whole name plus ``.png``, as COLMAP expects."""
        return into.masks.path / inputs.photos[photo] / f"{picture.name}.png" if into.masks else None

    def list_targets(photo: Path, picture: Path) -> tuple[Target, ...]:
        copy = unchanged.get(photo)
        places = {
            TargetKind.PICTURE: picture,
            TargetKind.MOTION: motions.get(photo),
            TargetKind.MASK: name_mask(photo, picture),
            TargetKind.UNCHANGED: copy,
            TargetKind.UNCHANGED_MASK: name_mask(photo, copy or picture),
        }
        return tuple(Target(where(place), kind) for kind, place in places.items() if place is not None)

    for file in (file for pair in pictures.items() for file in pair if request.save.keep_times):
        if is_object(file):  # only the store sets times of objects
            raise UsageError(f"{{--keep-times}} is for files, and {file} is behind a URL: leave it out")
    jobs = [Job(where(photo), list_targets(photo, picture)) for photo, picture in pictures.items()]
    _check_apart((job.source, target) for job in jobs for target in job.outputs)  # results and unchanged copies
    return jobs


def _plan_targets(inputs: Inputs, goal: Goal, name: Callable[[Path], str]) -> dict[Path, Path]:
    """Assigns each photo's result a place: a file, or one in a folder that mirrors the folders of photos."""
    if not goal.is_folder(inputs.many):
        return {next(iter(inputs.photos)): goal.path}
    goal.must_be_folder("several photos need" if inputs.many else "a name without an extension means")
    return _all_different({photo: goal.path / (inside / name(photo)) for photo, inside in inputs.photos.items()})


def _is_same(photo: Path, copy: Path) -> bool:
    """Whether the place of a copy is the photo itself, because results go to the folder of the photos."""
    with suppress(OSError):
        return copy.samefile(photo)
    return copy == photo


def _all_different(targets: dict[Path, Path]) -> dict[Path, Path]:
    _check_apart((photo, target) for photo, target in targets.items())
    return targets


def _check_apart(outputs: Iterable[tuple[Path, Path]]) -> None:
    """Checks that no two photos, each named with a place where it may be written, have a place in common."""
    taken: dict[Path, Path] = {}
    for photo, target in outputs:
        other = taken.setdefault(target, photo)
        if other != photo:
            raise UsageError(
                f"{other} and {photo} could both be written to {target}: leave out one of them, or give it a run and "
                "a folder of its own"
            )


def motion_targets(inputs: Inputs, goal: Goal) -> dict[Path, Path]:
    """Assigns each photo's motion file a place: ``a.jpg`` -> ``a.json``; ``a.heic`` -> ``a.heic.json``.

    If ``a.jpg`` and ``a.png`` go to the same folder, both keep their whole names, as in ``a.jpg.json``, regardless of
    their order. Names are compared case-insensitively, as some file systems do.
    """
    asked = Counter(
        (inside, name.casefold())
        for photo, inside in inputs.photos.items()
        for name in {_short_name(photo), motion_name(photo.name)}
    )

    def name(photo: Path) -> str:
        short = _short_name(photo)
        return short if asked[inputs.photos[photo], short.casefold()] == 1 else motion_name(photo.name)

    return _plan_targets(inputs, goal, name)


def _short_name(photo: Path) -> str:
    own = of_suffix(photo.suffix)
    return motion_name(photo.stem if own is None or own.is_written else photo.name)


def _manifest_folder(inputs: Inputs, into: Outputs, run: Run) -> Path | None:
    """Returns the manifest's folder; None if no later run will look for the results.

    Results next to their photos, and the result of a single photo, are identified by their names and need no manifest.
    """
    if run.manifest is None:
        return into.pictures.path if into.pictures is not None and inputs.many else None
    if not inputs.many:
        raise UsageError("{--manifest} is for several photos: leave it out")
    home = Goal(run.manifest)
    home.must_be_folder("the manifest needs")
    return home.path
