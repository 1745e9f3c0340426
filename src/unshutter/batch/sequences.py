"""``unshutter rectify --sequence``: the motions of all frames, found before each becomes a job of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING

from unshutter.batch.job import Job
from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.prefetch import open_photo
from unshutter.storage.places import Place, absolute

if TYPE_CHECKING:
    from datetime import datetime

    from unshutter.frames.sequence import CameraMotion, GreyFrame

_LONGEST_INTERVAL = timedelta(seconds=10)  # of neighbours that say anything
_MANY = 2.5  # usual intervals that are a gap
_RESOLUTION = timedelta(seconds=2)  # cameras that say whole seconds seem to jitter by so much


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
        UnknownRatioError: the readout ratio was not given, and the frames do not show it.
    """
    from unshutter.frames.sequence import CameraMotion, known_ratio

    clock, camera = wanted.clock, wanted.find.camera
    ratio = known_ratio(clock.ratio) if clock.is_known else None
    finder = CameraMotion(ratio, camera.focal_px, camera.direction)
    read: list[Place] = []
    joined: list[tuple[Place, Place]] = []  # photos that follow one another
    found = list(finder.motions(_seen(finder, photos, read, joined, max_pixels)))
    motions = dict(zip(map(absolute, read), found, strict=True))
    unknown = next((motion.reason for motion in found if motion.ratio_unknown), None)
    if unknown is not None and finder.ratio is None and not wanted.neighbours.fallback:
        raise UnknownRatioError(str(unknown), unknown)
    if ratio is None and finder.ratio is not None:
        print(f"unshutter: readout ratio {finder.ratio}", file=sys.stderr)
    after = {absolute(first): absolute(second) for first, second in joined}
    before = {second: first for first, second in after.items()}
    named = [(job, absolute(job.source)) for job in jobs]
    return [replace(job, motion=motions.get(at), before=before.get(at), after=after.get(at)) for job, at in named]


def _seen(
    finder: CameraMotion, photos: list[Place], read: list[Place], joined: list[tuple[Place, Place]], max_pixels: int
) -> Iterator[GreyFrame | None]:
    """The photos that can be read, which are noted in ``read``; None where the sequence is parted.

    It is parted between folders, where a photo cannot be read, and where photos were not taken at even intervals.
    """
    last: tuple[Place, datetime | None] | None = None
    interval: timedelta | None = None
    for place in photos:
        try:
            photo = open_photo(place, max_pixels)
            seen = finder.look(photo)
        except UnshutterError:
            last = None
            yield None
            continue
        taken = photo.taken()
        if last is not None:
            since = taken - last[1] if taken is not None and last[1] is not None else None
            if last[0].parent != place.parent or _is_gap(since, interval):
                interval = None
                yield None
            else:
                interval = max(interval or since, since) if since is not None else interval
                joined.append((last[0], place))
        last = place, taken
        read.append(place)
        yield seen


def _is_gap(since: timedelta | None, interval: timedelta | None) -> bool:
    """Whether photos lie apart in time.

    Args:
        since: from one photo to the next; None: unknown.
        interval: the longest so far between those of the sequence; None: there is none yet.
    """
    if since is None:
        return False
    longest = _LONGEST_INTERVAL if interval is None else max(_MANY * interval, _RESOLUTION)
    return not -_RESOLUTION <= since <= longest
