"""Photos with neighbours: the motions of a sequence of frames, and the work on a photo between two others."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError
from unshutter.frames.sequence import CameraMotion, GreyFrame
from unshutter.frames.usual_ratio import FEW, usual_ratio
from unshutter.options import Rectify
from unshutter.photo import Photo
from unshutter.progress import tell
from unshutter.readout_time import ReadoutRatio
from unshutter.rectification.sequences import RectifiedFrame, SequenceOptions, rectify_between, rectify_by_camera
from unshutter.run.ahead import PreviewError, open_input
from unshutter.run.job import Job, Work
from unshutter.storage.locations import absolute

_RESOLUTION = timedelta(seconds=2)  # apparent jitter of cameras that record whole seconds


def add_motions(
    jobs: list[Job], photos: list[Path], request: Rectify, max_pixels: int
) -> tuple[list[Job], ReadoutRatio | None]:
    """Returns the jobs that remain, each with the motion of its photo, and the readout ratio found from the frames.

    All photos in order, including finished ones, are neighbours. Each folder is a separate sequence, split by
    unreadable photos; the jobs of those photos report why they cannot be read. There is no ratio if the user has stated
    it, or nothing moves; two or three frames cannot show it, so a usual one is taken.
    """
    stated = request.stated_ratio
    camera = request.find.camera
    ratio = stated
    while True:
        finder = CameraMotion(ratio, camera.focal_px, camera.scan_direction)
        readable: list[Path] = []
        pairs: list[tuple[Path, Path]] = []  # consecutive photos
        missing: list[Path] = []  # photos before whose number others are missing
        frame_motions = list(finder.motions(_grey_frames(finder, photos, readable, pairs, missing, max_pixels)))
        unknown = next((motion.reason for motion in frame_motions if motion.ratio_unknown), None)
        if unknown is None or finder.ratio is not None or request.neighbours.fallback:
            break
        if len(readable) > FEW:
            raise UnknownRatioError(str(unknown), unknown)
        ratio = usual_ratio([open_input(place, max_pixels) for place in readable])
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        tell(f"unshutter: the sequence is interrupted before {missing[0]}{more}: numbers are missing in the names")
    motions = dict(zip(map(absolute, readable), frame_motions, strict=True))
    after = {absolute(first): absolute(second) for first, second in pairs}
    before = {second: first for first, second in after.items()}
    places = [(job, absolute(job.source)) for job in jobs]
    complete = [replace(job, motion=motions.get(at), before=before.get(at), after=after.get(at)) for job, at in places]
    return complete, None if stated is not None else finder.ratio


def _grey_frames(
    finder: CameraMotion,
    photos: list[Path],
    readable: list[Path],
    pairs: list[tuple[Path, Path]],
    missing: list[Path],
    max_pixels: int,
) -> Iterator[GreyFrame | None]:
    """Yields grey copies of the photos; None where the sequence is interrupted.

    It is interrupted between folders, at unreadable photos, at gaps in time, and where numbers are missing in names
    that usually count on. Readable photos are appended to ``readable``, pairs of consecutive photos to ``pairs``, and
    photos after missing numbers to ``missing``.
    """
    last: tuple[Path, datetime | None] | None = None
    interval: timedelta | None = None
    usual = _usual_step(photos)
    for where in photos:
        try:
            photo = open_input(where, max_pixels)
            frame = finder.add_frame(photo)
        except PreviewError:  # not a frame: its neighbours are each other's
            continue
        except UnshutterError:
            last = None
            yield None
            continue
        time = photo.taken()
        if last is not None:
            since = time - last[1] if time is not None and last[1] is not None else None
            step = _step(last[0], where)
            is_missing = usual is not None and step is not None and step > usual
            if last[0].parent != where.parent or is_missing or _is_gap(since, interval):
                interval = None
                missing += [where] if is_missing else []
                yield None
            else:
                interval = max(interval or since, since) if since is not None else interval
                pairs.append((last[0], where))
        last = where, time
        readable.append(where)
        yield frame


def _step(first: Path, second: Path) -> int | None:
    """Returns by how much the last number in a name exceeds that in another one; None if they differ otherwise, too."""
    names = [re.fullmatch(r"(.*?)(\d+)(\D*)", place.name) for place in (first, second)]
    if first.parent != second.parent or None in names:
        return None
    (head, number, tail), (other, following, end) = (name.groups() for name in names if name)
    return int(following) - int(number) if (head, tail) == (other, end) else None


def _usual_step(photos: list[Path]) -> int | None:
    """Returns by how much numbers in names usually grow from photo to photo; None if they do not tell."""
    steps = Counter(_step(*pair) for pair in pairwise(photos))
    step, many = steps.most_common(1)[0] if steps else (None, 0)
    return step if step is not None and step > 0 and many >= 3 and 2 * many >= steps.total() else None


def _is_gap(since: timedelta | None, interval: timedelta | None) -> bool:
    """Whether the time since the last photo (None: unknown) is too long for a sequence with this longest interval."""
    if since is None:
        return False
    longest = timedelta(seconds=10) if interval is None else max(2.5 * interval, _RESOLUTION)
    return not -_RESOLUTION <= since <= longest


def rectify_with_neighbours(photo: Photo, job: Job, work: Work) -> RectifiedFrame:
    """Rectifies a photo with the help of its neighbours."""
    neighbours = work.request.neighbours
    options = sequence_options(work.request)
    is_frame = neighbours.sequence
    if is_frame and job.motion is None:
        raise UnshutterError(
            "{photo} could not be read when the motion of the sequence was found: run the command again",
            photo=job.source,
        )
    paths = (job.before, job.after) if is_frame else (neighbours.before, neighbours.after)
    before, after = (path and open_input(path, work.max_pixels) for path in paths)
    try:
        return rectify_between(photo, before, after, options, job.motion)
    except UsageError:
        raise
    except UnshutterError:
        if job.motion is None:
            raise
        # no optical flow: use what is known of the camera's motion, or keep the photo
        return rectify_by_camera(photo, job.motion, options)


def sequence_options(request: Rectify) -> SequenceOptions:
    """Returns the options for rectifying a photo with the help of its neighbours."""
    camera = request.find.camera
    return SequenceOptions(
        time=request.stated_ratio,
        undo=request.undo,
        scan_direction=camera.scan_direction,
        at=request.neighbours.at,
        model=request.neighbours.model,
        focal_px=camera.focal_px,
        alone=request.find if request.neighbours.fallback else None,
    )
