"""Rectifies one photo, in this process or another: opens it, finds its motion, judges, renders and writes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from unshutter.errors import UnshutterError, errors_in_one_line
from unshutter.motion.verdict import Verdict, judge
from unshutter.options import Save
from unshutter.photo import Photo
from unshutter.rectification.rectified import Result, render, write
from unshutter.run.ahead import Begun
from unshutter.run.job import Job, Outcome, Work
from unshutter.storage.files import check_target, digest, fingerprint, remove
from unshutter.storage.locations import full_name
from unshutter.storage.targets import Target, TargetKind, Written


def do_job(job: Job, work: Work, begun: Begun | None = None) -> Outcome:
    """Rectifies a photo; errors are returned in the outcome."""
    start = time.perf_counter()
    try:
        with errors_in_one_line(job.source):
            outcome = rectify_photo(job, work, begun)
    except UnshutterError as error:
        outcome = Outcome(error)
    return replace(outcome, seconds=time.perf_counter() - start)


def rectify_photo(job: Job, work: Work, begun: Begun | None = None) -> Outcome:
    """Rectifies a photo and writes what comes of it.

    Args:
        begun: the photo, if work on it has begun.
    """
    source_is = fingerprint(job.source)  # taken before reading: a photo that is modified later counts as changed
    request = work.request
    begun = begun or next(work.begin([job]))
    photo = begun.photo
    model = ""
    ratio = None
    result: Result
    if request.neighbours or request.neighbours.sequence:
        from unshutter.run.sequences import rectify_with_neighbours  # few photos have neighbours

        result = between = rectify_with_neighbours(photo, job, work)
        model = between.model
        ratio = between.ratio
    else:
        result = render(photo, _judge(begun, job, work), request.undo.edges)
    written = _write_all(result, job, work)
    preview = None
    if work.preview_px is not None:
        before = result.original.upright(work.preview_px)
        preview = before, result.photo.upright(work.preview_px) if result.changed else before
    return Outcome(
        verdict=result.verdict,
        group=_name_group(job.source, photo),
        edges=result.edges if result.changed else None,
        area_left=result.area_left,
        model=model,
        ratio=ratio,
        source_is=source_is,
        written=written,
        preview=preview,
    )


def _judge(begun: Begun, job: Job, work: Work) -> Verdict:
    """Returns the verdict on the motion that is given for all photos, or shown by a burst, or found in the photo."""
    if work.given is None and job.burst is None:
        return begun.verdict
    photo = begun.photo
    undo = work.request.undo
    if work.given is not None:
        return judge(work.given.fit(photo.height, photo.width, work.request.find.camera.readout), undo)
    assert job.burst is not None
    return judge(job.burst.motion.finding(undo.reference or "first").fit(photo.height, photo.width), undo)


def _write_all(result: Result, job: Job, work: Work) -> tuple[Written, ...]:
    """Writes the files that come of a photo, and removes others that a run with other options left."""
    save = work.request.save
    targets = [target for kind in _kinds_of(result, save) if (target := job.target(kind)) is not None]
    may_replace = [_may_replace(job, target, work.overwrite) for target in targets]
    written: list[Written] = []
    for target, overwrite in zip(targets, may_replace, strict=True):
        file = write(result, target, save, overwrite, job.source)
        made = digest(target.path) if work.is_recorded else None
        written.append(replace(file, fingerprint=fingerprint(target.path), digest=made))
    paths = {file.path for file in written}
    for target in job.targets:
        if target.path not in paths and target.left is not None and digest(target.path) == target.left:
            remove(target.path)
    return tuple(written)


def _kinds_of(result: Result, save: Save) -> Iterator[TargetKind]:
    """Yields the kinds of files that come of a photo, in the order in which they are written."""
    if result.changed:
        yield TargetKind.PICTURE
    elif not save.only_changed:
        yield TargetKind.UNCHANGED
    if result.motion is not None:
        yield TargetKind.MOTION
    yield TargetKind.MASK if result.changed else TargetKind.UNCHANGED_MASK


def _may_replace(job: Job, target: Target, overwrite: bool) -> bool:
    """Whether an output may replace an existing file, because the user allows it or an earlier run wrote it."""
    if overwrite or target.left is None:
        return overwrite
    if digest(target.path) == target.left:
        return True
    if not job.may_repeat:  # the check before the job left this to the digest
        check_target(target.path, overwrite=False)
    return False


def _name_group(path: Path, photo: Photo) -> str:
    """Names the photos that are judged together: one folder, one camera, one hour."""
    taken = photo.taken()
    return "|".join((full_name(path.parent), photo.camera(), "" if taken is None else f"{taken:%Y-%m-%d %H}"))
