"""Processes one photo in a worker: in this process, in another, or on another machine."""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.job import Job, Outcome
from unshutter.batch.lookahead import Lookahead, PhotoAhead, open_photo
from unshutter.batch.preview import before_and_after
from unshutter.errors import UnknownRatioError, UnshutterError, UsageError, errors_in_one_line
from unshutter.options import Rectify, Save
from unshutter.photo import Photo
from unshutter.photo.encoding import not_written
from unshutter.photo.formats import of_target
from unshutter.storage.places import Place, check_place, digest, fingerprint, remove, write_place

if TYPE_CHECKING:
    from unshutter.frames.frame import RectifiedFrame
    from unshutter.motion import Motion
    from unshutter.result import Rectified


def do_job(job: Job, request: Rectify, motion: str | None = None, lookahead: Lookahead | None = None) -> Outcome:
    """Runs the job; errors are returned in the outcome.

    Args:
        job: the job.
        request: options of all jobs of a batch.
        motion: text of the motion file named in ``request``, which other machines may not have.
        lookahead: source of opened photos; by default the photo is read now.
    """
    start = time.perf_counter()
    try:
        with errors_in_one_line(job.source):
            outcome = finish_job(job, request, motion, lookahead)
    except UnshutterError as error:
        usage, unknown_ratio = isinstance(error, UsageError), isinstance(error, UnknownRatioError)
        return Outcome(str(error), usage, unknown_ratio, seconds=time.perf_counter() - start)
    return replace(outcome, seconds=time.perf_counter() - start)


def finish_job(job: Job, request: Rectify, motion: str | None = None, lookahead: Lookahead | None = None) -> Outcome:
    """Runs the job.

    Args:
        job: see :func:`do_job` for all arguments.
        request: options of all jobs of a batch.
        motion: text of a motion file.
        lookahead: source of opened photos.

    Raises:
        UnshutterError, UsageError: the photo or the options make it impossible.
    """
    over_picture, over_motion, over_mask = (
        _may_replace(job, *output) for output in zip(job.targets, job.left, strict=True)
    )
    source_is = fingerprint(job.source)  # taken before reading: a photo that is modified later counts as changed
    if lookahead is None:
        lookahead = Lookahead([job.source], request.find_alone, job.max_pixels, request.undo)
    ahead = lookahead.take(job.source)
    result: Rectified | RectifiedFrame
    model = ""
    if request.neighbours or request.neighbours.sequence:
        result = _between(ahead.photo, job, request)
        model = result.model
    else:
        result = _alone(ahead, request, motion)
    if job.motion_target is not None and result.motion is not None:
        write_place(f"{result.motion.to_json()}\n".encode(), job.motion_target, over_motion, mode_of=job.source)
    if job.mask_target is not None:
        write_place(mask_file(result), job.mask_target, over_mask, mode_of=job.source)
    written = result.changed or not request.save.only_changed
    if written:
        about = "; ".join(filter(None, (_about_edges(result), save_picture(result, job, over_picture, request.save))))
    else:
        about = ""
        if job.left[0] is not None and digest(job.target) == job.left[0]:
            remove(job.target)  # left by a run with other options
    outputs = [target if written or target is not job.target else None for target in job.outputs]
    return Outcome(
        verdict=result.verdict,
        note=about,
        model=model,
        source_is=source_is,
        outputs_are=tuple(fingerprint(target) if target else None for target in outputs),
        digests=tuple(digest(target) if job.recorded and target else None for target in outputs),
        preview=None if job.preview_px is None else before_and_after(result, job.preview_px),
    )


def _alone(ahead: PhotoAhead, request: Rectify, motion: str | None) -> Rectified:
    """Rectifies a photo by itself, or with the motion shared by all photos."""
    from unshutter.result import undo

    estimate = ahead.motion() if motion is None else _parsed(motion)
    return undo(ahead.photo, estimate, request.undo, request.find.camera.readout)


def _between(photo: Photo, job: Job, request: Rectify) -> RectifiedFrame:
    """Rectifies a photo with the help of its neighbours."""
    from unshutter.frames.frame import RectifiedFrame, SequenceOptions
    from unshutter.frames.sequence_rectification import rectify_between
    from unshutter.result import undo

    neighbours, camera = request.neighbours, request.find.camera
    alone = request.find if neighbours.fallback else None
    options = SequenceOptions(
        request.clock, request.undo, camera.direction, neighbours.at, neighbours.model, camera.focal_px, alone
    )
    if not neighbours.sequence:
        before, after = (path and open_photo(path, job.max_pixels) for path in (neighbours.before, neighbours.after))
        return rectify_between(photo, before, after, options)
    if job.motion is None:
        raise UnshutterError(
            "{photo} could not be read when the motion of the sequence was found: start again", photo=job.source
        )
    before, after = (place and open_photo(place, job.max_pixels) for place in (job.before, job.after))
    try:
        return rectify_between(photo, before, after, options, job.motion)
    except UsageError:
        raise
    except UnshutterError:  # no optical flow: use what is known of the camera's motion, or keep the photo
        motion = job.motion.motion(request.undo.reference or "first")
        return RectifiedFrame.of(undo(photo, motion, request.undo), "camera")


def _about_edges(result: Rectified | RectifiedFrame) -> str:
    """Describes how areas that the photo did not see were handled, if the user may not have asked for it."""
    if result.whole is None:
        return ""
    share = f"{math.floor(100 * result.whole)} %"
    if result.edges == "crop":
        return f"cropped to {share}" if result.whole < 1 else ""
    return f"black corners kept: --edges crop would leave {share}"


def _may_replace(job: Job, target: Place | None, left: str | None) -> bool:
    """Whether an output may replace an existing file, because the user allows it or an earlier run wrote it.

    Raises:
        UnshutterError: a file that must not be replaced exists.
    """
    if target is None:
        return False
    replacing = job.overwrite or (left is not None and digest(target) == left)
    if replacing or not job.may_repeat:
        check_place(target, replacing, job.source)
    return replacing


@lru_cache(maxsize=1)
def _parsed(text: str) -> Motion:
    """Parses the motion shared by all photos of a batch, once per process."""
    from unshutter.motion import Motion

    return Motion.from_json(text)


def save_picture(result: Rectified | RectifiedFrame, job: Job, overwrite: bool, save: Save) -> str:
    """Writes a job's result in the format that the file extension names.

    Returns:
        A note for the user, usually empty: metadata that the file cannot hold, and whether an unchanged photo had to be
        encoded.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    target, format = job.target, of_target(Path(job.target.name))
    done_before = isinstance(target, Path) and job.may_repeat and os.path.lexists(target)
    if isinstance(target, Path) and not done_before:
        left_out = result.save(
            target,
            overwrite=overwrite,
            quality=save.quality,
            subsampling=save.subsampling,
            keep_times=save.keep_times,
        )
    else:
        file = result.encode(format.name, save.quality, save.subsampling)
        times_ns = result.photo.times_ns if save.keep_times else None
        write_place(file.data, target, overwrite, mode_of=job.source, times_ns=times_ns)
        left_out = file.left_out
    encoded = not result.changed and result.photo.file_as(format.name, save) is None
    anew = f"encoded as {format.name.upper()}" if encoded else ""
    return "; ".join(filter(None, (anew, not_written(left_out))))


def mask_file(result: Rectified | RectifiedFrame) -> bytes:
    """Returns a PNG of the size of the stored picture: 255 where the photo shows the scene, otherwise 0."""
    import numpy as np

    return Photo.from_array(result.valid.astype(np.uint8) * 255).to_bytes("png")
