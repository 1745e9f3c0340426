"""What a worker does with one photo, in this process, in another, or on another machine."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from unshutter.batch.photos import save_picture
from unshutter.batch.report import naming_the_photo
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.prefetch import Prefetch
from unshutter.storage.places import Place, check_place, fingerprint, write_place

if TYPE_CHECKING:
    from unshutter.motion import Motion


@dataclass(frozen=True)
class Job:
    """One photo and where its result goes.

    Attributes:
        source: the photo.
        target: its rectified picture.
        motion_target: its motion file, if one is wanted.
        overwrite: whether the target may replace what is there.
        max_pixels: of a photo that is read.
        may_repeat: whether the job may come to a worker a second time, because the first one died before anybody
            heard how it went.
        before: fingerprint of what was at the target when the job was first given away.
    """

    source: Place
    target: Place
    motion_target: Place | None
    overwrite: bool
    max_pixels: int
    may_repeat: bool = False
    before: str | None = None


@dataclass(frozen=True)
class Outcome:
    """How a job went.

    Attributes:
        error: one line; empty where all went well.
        usage: the error is about the request rather than the photo.
        note: something that the user should know.
        seconds: that it took.
        source_is: fingerprint of the photo that was read.
        target_is, motion_is: fingerprints of what was written.
    """

    error: str = ""
    usage: bool = False
    note: str = ""
    seconds: float = 0.0
    source_is: str | None = None
    target_is: str | None = None
    motion_is: str | None = None


def do_job(job: Job, wanted: Rectify, motion: str | None = None, prefetch: Prefetch | None = None) -> Outcome:
    """Does the job; what goes wrong is in the outcome.

    Args:
        job: what to do.
        wanted: of all jobs of a batch.
        motion: text of the motion file that ``wanted`` names: other machines may not have it.
        prefetch: where the photo comes from; by default it is read now.
    """
    if job.may_repeat and fingerprint(job.target) not in (None, job.before):
        return _done_before(job)
    start = time.perf_counter()
    outcomes: list[Outcome] = []
    try:
        naming_the_photo(job.source, lambda _: outcomes.append(_do(job, wanted, motion, prefetch)))
    except UnshutterError as error:
        return Outcome(str(error), isinstance(error, UsageError), seconds=time.perf_counter() - start)
    return replace(outcomes[0], seconds=time.perf_counter() - start)


def _do(job: Job, wanted: Rectify, motion: str | None, prefetch: Prefetch | None) -> Outcome:
    from unshutter.rectification import undo

    check_place(job.target, job.overwrite, job.source)
    if job.motion_target is not None:
        check_place(job.motion_target, job.overwrite, job.source)
    source_is = fingerprint(job.source)  # before it is read: a photo that changes meanwhile counts as changed
    if prefetch is None:
        prefetch = Prefetch([job.source], wanted.find if motion is None else None, job.max_pixels)
    coming = prefetch.take(job.source)
    photo = coming.photo
    found = coming.motion() if motion is None else _parsed(motion)
    result = undo(photo, found, wanted.undo, wanted.find.camera.readout)
    if job.motion_target is not None:
        write_place(f"{result.motion.to_json()}\n".encode(), job.motion_target)
    save_picture(result, job.target, job.overwrite, wanted.save)
    return Outcome(
        note=f"unchanged: {result.motion.reason}" if result.motion.reason else "",
        source_is=source_is,
        target_is=fingerprint(job.target),
        motion_is=fingerprint(job.motion_target) if job.motion_target is not None else None,
    )


@lru_cache(maxsize=1)
def _parsed(text: str) -> Motion:
    """The motion that all photos of a batch are given, read once per process."""
    from unshutter.motion import Motion

    return Motion.from_json(text)


def _done_before(job: Job) -> Outcome:
    """What the job's first worker wrote, whole as everything that has its name; the picture came last."""
    motion_is = fingerprint(job.motion_target) if job.motion_target is not None else None
    return Outcome(source_is=fingerprint(job.source), target_is=fingerprint(job.target), motion_is=motion_is)
