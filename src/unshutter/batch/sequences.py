"""``unshutter rectify --sequence``: finds the motions of all frames before each frame becomes a separate job."""

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

_LONGEST_INTERVAL = timedelta(seconds=10)  # between neighbours that are worth comparing
_MANY = 2.5  # a gap is longer than this many usual intervals
_RESOLUTION = timedelta(seconds=2)  # apparent jitter of cameras that record whole seconds


def check_sequence(request: Rectify, photos: int) -> None:
    """Checks that the photos can be a sequence.

    Raises:
        UsageError: there are fewer than two photos.
    """
    if request.neighbours.sequence and photos < 2:
        raise UsageError("--sequence needs several photos: name them in order, or their folder")


def with_motions(
    jobs: list[Job], photos: list[Place], request: Rectify, max_pixels: int
) -> tuple[list[Job], ReadoutRatio | None]:
    """Returns the jobs, each with the motion of its photo.

    Each folder is a separate sequence, split by unreadable photos; the jobs of those photos report why they cannot be
    read.

    Args:
        jobs: those that remain to be done.
        photos: all photos in order, including finished ones, which are neighbours, too.
        request: the options for all photos.
        max_pixels: pixel limit of a photo.

    Returns:
        The jobs, and the readout ratio found from the frames; None: the user has stated it, or nothing moves.

    Raises:
        UnknownRatioError: the user has not stated the readout ratio, and the frames do not show it.
    """
    from unshutter.frames.sequence import CameraMotion, known_ratio

    clock, camera = request.clock, request.find.camera
    stated_ratio = known_ratio(clock.ratio) if clock.is_known else None
    finder = CameraMotion(stated_ratio, camera.focal_px, camera.direction)
    readable: list[Place] = []
    pairs: list[tuple[Place, Place]] = []  # consecutive photos
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
    """Yields grey copies of the photos; None where the sequence is interrupted.

    It is interrupted between folders, at unreadable photos, and at gaps in time. Readable photos are appended to
    ``readable``, and pairs of consecutive photos to ``pairs``.
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
    """Whether there is a gap in time between two photos.

    Args:
        since: time from one photo to the next; None: unknown.
        interval: the longest interval in the sequence so far; None: there is none yet.
    """
    if since is None:
        return False
    longest = _LONGEST_INTERVAL if interval is None else max(_MANY * interval, _RESOLUTION)
    return not -_RESOLUTION <= since <= longest
