"""Processes one photo: does its job, in this process or another, and says how it ended."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, UsageError, errors_in_one_line
from unshutter.options import Edges, Rectify, Save
from unshutter.photo import Photo
from unshutter.photo.saving import describe_left_out
from unshutter.run.ahead import Ahead, Wanted, look_ahead, open_input
from unshutter.run.bursts import Burst
from unshutter.storage.files import check_target, digest, fingerprint, remove
from unshutter.storage.locations import full_name
from unshutter.storage.targets import Target, TargetKind, Written

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from unshutter.frames.sequence import FrameMotion
    from unshutter.motion.finding import Finding
    from unshutter.motion.verdict import Verdict
    from unshutter.readout_time import ReadoutRatio
    from unshutter.rectification.rectified import Rectified, Result
    from unshutter.rectification.sequences import RectifiedFrame, SequenceOptions


SHEET_PX = 320  # long side of each picture of a sheet


@dataclass(frozen=True)
class Job:
    """One photo and the places for its results."""

    source: Path  # the photo
    targets: tuple[Target, ...]  # the files that may be written, one of each kind at most, its picture among them
    overwrite: bool  # whether outputs may replace existing files
    max_pixels: int  # pixel limit for photos that are read
    # whether an earlier attempt may have written outputs before its worker died or its run was killed; existing files
    # with identical bytes are then kept
    may_repeat: bool = False
    recorded: bool = False  # whether the manifest needs digests of the outputs
    # its motion, found from its neighbours in a sequence; None: estimated, or shared by all photos
    motion: FrameMotion | None = None
    before: Path | None = None  # its neighbour before it in a sequence
    after: Path | None = None  # its neighbour after it
    burst: Burst | None = None  # what the photos taken just before and after it show; None: it is judged by itself
    folder_log_odds: float | None = None  # judged again in view of the other photos of its folder (run/folder.py)
    preview_px: int | None = None  # long side [px] of the before and after pictures, 0 for full size; None: no preview

    def target(self, kind: TargetKind) -> Target | None:
        """Returns the file of a kind; None: not written."""
        return next((target for target in self.targets if target.kind is kind), None)

    @property
    def picture(self) -> Path:
        """The place of its picture, if it changes."""
        target = self.target(TargetKind.PICTURE)
        assert target is not None
        return target.path

    @property
    def outputs(self) -> list[Path]:
        """The places that may be written, each once."""
        return list(dict.fromkeys(target.path for target in self.targets))


@dataclass(frozen=True)
class Outcome:
    """The outcome of a job."""

    error: UnshutterError | None = None  # None: success
    note: str = ""  # further information for the user
    model: str = ""  # motion model used for a photo with neighbours (rectification/sequences.py); otherwise empty
    verdict: Verdict | None = None  # whether the photo was changed, and why not
    edges: Edges | None = None  # how areas that the photo did not see were handled; None: unchanged
    ratio: ReadoutRatio | None = None  # readout ratio that was found, or taken, from a photo's neighbours
    area_left: float | None = None  # share of the photo's area that a crop leaves; None if no crop was computed
    please_look: bool = False  # whether someone should compare the result with the photo
    seconds: float = 0.0  # duration of the job
    source_is: str | None = None  # fingerprint of the photo that was read
    written: tuple[Written, ...] = ()  # the files that were written
    group: str = ""  # folder, camera and hour of the photo
    preview: tuple[np.ndarray, np.ndarray] | None = None  # the before and after pictures for a preview

    @property
    def picture(self) -> Path | None:
        """The picture that was written; for an unchanged photo there may be none."""
        return next((file.path for file in self.written if file.kind in _PICTURES), None)


_PICTURES = (TargetKind.PICTURE, TargetKind.UNCHANGED)


# ---- the job -----------------------------------------------------------------------------------------------------


def do_job(job: Job, request: Rectify, given: Finding | None = None, ahead: Iterable[Ahead] = ()) -> Outcome:
    """Runs the job; errors are returned in the outcome.

    Args:
        given: the motion to undo in all photos; None: it is found.
        ahead: photos on which this process works ahead, in order; others are read now.
    """
    start = time.perf_counter()
    try:
        with errors_in_one_line(job.source):
            outcome = finish_job(job, request, given, ahead)
    except UnshutterError as error:
        outcome = Outcome(error)
    return replace(outcome, seconds=time.perf_counter() - start)


def finish_job(job: Job, request: Rectify, given: Finding | None = None, ahead: Iterable[Ahead] = ()) -> Outcome:
    """Runs the job as :func:`do_job` does; raises its errors."""
    source_is = fingerprint(job.source)  # taken before reading: a photo that is modified later counts as changed
    begun = _begin(job, request, given, ahead)
    model = ""
    ratio = None
    preview = None
    if request.neighbours or request.neighbours.sequence:
        result = _rectify_between(begun.photo, job, request)
        model = result.model
        ratio = result.ratio
    else:
        result = _rectify_alone(begun, job, request, given)
    written = _write_all(result, job, request.save)
    if job.preview_px is not None:
        before = result.original.upright(job.preview_px)
        preview = before, result.photo.upright(job.preview_px) if result.changed else before
    return Outcome(
        verdict=result.verdict,
        group=_name_group(job.source, result.original),
        note="; ".join(filter(None, map(_describe_picture, written))),
        edges=result.edges if result.changed else None,
        area_left=result.area_left,
        please_look=result.needs_a_look,
        model=model,
        ratio=ratio,
        source_is=source_is,
        written=written,
        preview=preview,
    )


def _begin(job: Job, request: Rectify, given: Finding | None, ahead: Iterable[Ahead]) -> Ahead:
    """Returns the photo of a job, begun ahead of its turn or now."""
    find = None if given is not None or job.burst is not None else request.find_alone
    if job.burst is None and job.folder_log_odds is None:
        for begun in ahead:
            if begun.path == job.source:
                return begun
    elif find is not None and job.folder_log_odds is not None:
        find = replace(find, decision=replace(find.decision, folder=job.folder_log_odds))
    return next(look_ahead([job.source], Wanted(find, request.undo, job.max_pixels)))


def _write_all(result: Result, job: Job, save: Save) -> tuple[Written, ...]:
    """Writes the files that come of a photo, and removes others that a run with other options left."""
    from unshutter.rectification.rectified import write

    targets = [target for kind in _kinds_of(result, save) if (target := job.target(kind)) is not None]
    may_replace = [_may_replace(job, target) for target in targets]
    written: list[Written] = []
    for target, overwrite in zip(targets, may_replace, strict=True):
        file = write(result, target, save, overwrite, job.source)
        made = digest(target.path) if job.recorded else None
        written.append(replace(file, fingerprint=fingerprint(target.path), digest=made))
    places = {file.path for file in written}
    for target in job.targets:
        if target.path not in places and target.left is not None and digest(target.path) == target.left:
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


def _name_group(place: Path, photo: Photo) -> str:
    """Names the photos that are judged together: one folder, one camera, one hour."""
    taken = photo.taken()
    return "|".join((full_name(place.parent), photo.camera(), "" if taken is None else f"{taken:%Y-%m-%d %H}"))


def _rectify_alone(begun: Ahead, job: Job, request: Rectify, given: Finding | None) -> Rectified:
    """Rectifies a photo by itself, or with the motion that its burst shows, or with that given for all photos."""
    from unshutter.motion.verdict import judge
    from unshutter.rectification.rectified import render

    photo = begun.photo
    if given is not None:
        verdict = judge(given.fit(photo.height, photo.width, request.find.camera.readout), request.undo)
    elif job.burst is not None:
        found = job.burst.motion.finding(request.undo.reference or "first")
        verdict = judge(found.fit(photo.height, photo.width), request.undo)
    else:
        verdict = begun.verdict
    return render(photo, verdict, request.undo.edges)


def _rectify_between(photo: Photo, job: Job, request: Rectify) -> RectifiedFrame:
    """Rectifies a photo with the help of its neighbours."""
    from unshutter.rectification.sequences import rectify_between, rectify_by_camera

    neighbours = request.neighbours
    options = sequence_options(request)
    if not neighbours.sequence:
        before, after = (path and open_input(path, job.max_pixels) for path in (neighbours.before, neighbours.after))
        return rectify_between(photo, before, after, options)
    if job.motion is None:
        raise UnshutterError(
            "{photo} could not be read when the motion of the sequence was found: run the command again",
            photo=job.source,
        )
    before, after = (place and open_input(place, job.max_pixels) for place in (job.before, job.after))
    try:
        return rectify_between(photo, before, after, options, job.motion)
    except UsageError:
        raise
    except UnshutterError:  # no optical flow: use what is known of the camera's motion, or keep the photo
        return rectify_by_camera(photo, job.motion, options)


def sequence_options(request: Rectify) -> SequenceOptions:
    """Returns the options for rectifying a photo with the help of its neighbours."""
    from unshutter.rectification.sequences import SequenceOptions

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


def _describe_picture(file: Written) -> str:
    """Describes what the user should know of a file that was written, usually nothing."""
    encoded = f"encoded as {file.encoded_as}" if file.encoded_as else ""
    return "; ".join(filter(None, (encoded, describe_left_out(file.left_out))))


def _may_replace(job: Job, target: Target) -> bool:
    """Whether an output may replace an existing file, because the user allows it or an earlier run wrote it."""
    if job.overwrite or target.left is None:
        return job.overwrite
    if digest(target.path) == target.left:
        return True
    if not job.may_repeat:  # the check before the job left this to the digest
        check_target(target.path, overwrite=False)
    return False
