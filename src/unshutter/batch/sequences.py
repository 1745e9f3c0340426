"""``unshutter rectify --sequence``: the motions of all frames, found before each becomes a job of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from unshutter.batch.job import Job
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.prefetch import open_photo
from unshutter.storage.places import Place

if TYPE_CHECKING:
    from unshutter.frames.sequence import CameraMotion, Seen


def check_sequence(wanted: Rectify, photos: int) -> None:
    """Raises UsageError where the photos cannot be a sequence."""
    if wanted.neighbours.sequence and photos < 2:
        raise UsageError("--sequence needs several photos: name them in order, or their folder")


def with_motions(jobs: list[Job], photos: list[Place], wanted: Rectify, max_pixels: int) -> list[Job]:
    """The jobs, each with the motion of its photo.

    Every folder is a sequence of its own, and so is what lies between photos that cannot be read: why they cannot,
    their jobs say.

    Args:
        jobs: those that are left to do.
        photos: all photos in order: finished ones are neighbours, too.
        wanted: of all jobs.
        max_pixels: of a photo.

    Raises:
        UnshutterError: the readout ratio was not given, and the frames do not say it.
    """
    from unshutter.frames.sequence import CameraMotion, known_ratio

    clock, camera = wanted.clock, wanted.find.camera
    ratio = known_ratio(clock.ratio) if clock.is_known else None
    finder = CameraMotion(ratio, camera.focal_px, camera.direction)
    read: list[Place] = []
    found = list(finder.motions(_seen(finder, photos, read, max_pixels)))
    motions = dict(zip(read, found, strict=True))
    untold = next((motion.reason for motion in found if "say --readout-ratio" in motion.reason), "")
    if untold and finder.ratio is None:
        raise UnshutterError(untold)
    if ratio is None and finder.ratio is not None:
        print(f"unshutter: readout ratio {finder.ratio}", file=sys.stderr)
    return [replace(job, motion=motions.get(job.source)) for job in jobs]


def _seen(finder: CameraMotion, photos: list[Place], read: list[Place], max_pixels: int) -> Iterator[Seen | None]:
    """The photos that can be read, which are noted in ``read``; None where the sequence is parted."""
    folder = None
    for place in photos:
        if folder not in (None, place.parent):
            yield None
        folder = place.parent
        try:
            seen = finder.look(open_photo(place, max_pixels))
        except UnshutterError:
            yield None
        else:
            read.append(place)
            yield seen
