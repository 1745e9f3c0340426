"""``unshutter rectify --sequence``: the motions of all frames are found before each becomes a job of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING

from unshutter.batch.job import Job
from unshutter.batch.lookahead import open_photo
from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.storage.places import Place, absolute

if TYPE_CHECKING:
    from datetime import datetime

    from unshutter.frames.self_calibration import ReadoutRatio
    from unshutter.frames.sequence import CameraMotion, GreyFrame

_LONGEST_INTERVAL = timedelta(seconds=10)  # of neighbours that say anything
_MANY = 2.5  # usual intervals that are a gap
_RESOLUTION = timedelta(seconds=2)  # cameras that say whole seconds seem to jitter by so much


def check_sequence(request: Rectify, photos: int) -> None:
    """Raises UsageError where the photos cannot be a sequence."""
    if request.neighbours.sequence and photos < 2:
        raise UsageError("--sequence needs several photos: name them in order, or their folder")


def with_motions(
    jobs: list[Job], photos: list[Place], request: Rectify, max_pixels: int
) -> tuple[list[Job], ReadoutRatio | None]:
    """The jobs, each with the motion of its photo.

    Every folder is a sequence of its own, and so are the photos between two that cannot be read; the jobs of those
    report why they cannot.

    Args:
        jobs: those that remain to be done.
        photos: all photos in order: finished ones are neighbours, too.
        request: what is done to all photos.
        max_pixels: of a photo.

    Returns:
        The jobs, and the readout ratio that the frames show; None: the user has stated it, or nothing moves.

    Raises:
        UnknownRatioError: the user has not stated the readout ratio, and the frames do not show it.
    """
    from unshutter.frames.sequence import CameraMotion, known_ratio

    clock, camera = request.clock, request.find.camera
    stated_ratio = known_ratio(clock.ratio) if clock.is_known else None
    finder = CameraMotion(stated_ratio, camera.focal_px, camera.direction)
    readable: list[Place] = []
    pairs: list[tuple[Place, Place]] = []  # photos that follow one another
    frame_motions = list(finder.motions(_grey_frames(finder, photos, readable, pairs, max_pixels)))
    motions = dict(zip(map(absolute, readable), frame_motions, strict=True))
    unknown = next((motion.reason for motion in frame_motions if motion.ratio_unknown), None)
    if unknown is not None and finder.ratio is None and not request.neighbours.fallback:
        raise UnknownRatioError(str(unknown), unknown)
    after = {absolute(first): absolute(second) for first, second in pairs}
    before = {second: first for first, second in after.items()}
    places = [(job, absolute(job.source)) for job in jobs]
    complete = [replace(job, motion=motions.get(at), before=before.get(at), after=after.get(at)) for job, at in places]
    return complete, None if stated_ratio is not None else finder.ratio


def _grey_frames(
    finder: CameraMotion, photos: list[Place], readable: list[Place], pairs: list[tuple[Place, Place]], max_pixels: int
) -> Iterator[GreyFrame | None]:
    """Grey copies of the photos; None where the sequence is interrupted.

    It is interrupted between folders, at photos that cannot be read, and where photos were not taken at even intervals.
    Photos are added to ``readable``, and photos that follow one another to ``pairs``.
    """
    last: tuple[Place, datetime | None] | None = None
    interval: timedelta | None = None
    for place in photos:
        try:
            photo = open_photo(place, max_pixels)
            frame = finder.look(photo)
        except UnshutterError:
            last = None
            yield None
            continue
        time = photo.taken()
        if last is not None:
            since = time - last[1] if time is not None and last[1] is not None else None
            if last[0].parent != place.parent or _is_gap(since, interval):
                interval = None
                yield None
            else:
                interval = max(interval or since, since) if since is not None else interval
                pairs.append((last[0], place))
        last = place, time
        readable.append(place)
        yield frame


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
