"""Processes one photo: looks ahead to the next one, does its job, in this process or another, and says how it ended."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError, WeightsError, errors_in_one_line
from unshutter.options import MAX_PIXELS, Camera, Edges, Find, Rectify, Save, Undo
from unshutter.photo import Photo
from unshutter.photo.formats import FORMATS, of_suffix, of_target
from unshutter.photo.libvips import libvips
from unshutter.photo.photo import PREVIEW
from unshutter.photo.saving import not_written
from unshutter.run.bursts import Burst
from unshutter.single.register import load, method
from unshutter.storage.locations import (
    Place,
    absolute,
    check_place,
    digest,
    fingerprint,
    read_place,
    remove,
    write_place,
)

if TYPE_CHECKING:
    import numpy as np

    from unshutter.frames.sequence import FrameMotion
    from unshutter.frames.sequence_rectification import RectifiedFrame
    from unshutter.motion import Motion
    from unshutter.motion.motion import Chance
    from unshutter.motion.rectified import Rectified, Result
    from unshutter.motion.verdict import Verdict
    from unshutter.single.estimator import Estimator


SHEET_PX = 320  # long side of each picture of a sheet


class PreviewError(UnshutterError):
    """A file is not a photo but a preview that unshutter made."""


@dataclass(frozen=True)
class Job:
    """One photo and the places for its results."""

    source: Place  # the photo
    target: Place  # its rectified picture, if it changes
    motion_target: Place | None  # its motion file; None: not written
    overwrite: bool  # whether outputs may replace existing files
    max_pixels: int  # pixel limit for photos that are read
    # whether an earlier attempt may have written outputs before its worker died or its run was killed; existing files
    # with identical bytes are then kept
    may_repeat: bool = False
    # digests of the targets that an earlier run wrote for this photo; files that still have them may be replaced
    left: tuple[str | None, ...] = (None,) * 5
    recorded: bool = False  # whether the manifest needs digests of the outputs
    # its motion, found from its neighbours in a sequence; None: estimated, or shared by all photos. before, after:
    # its neighbours in a sequence.
    motion: FrameMotion | None = None
    before: Place | None = None
    after: Place | None = None
    burst: Burst | None = None  # what the photos taken just before and after it show; None: it is judged by itself
    mask_target: Place | None = None  # the mask of its valid pixels; None: not written
    # the same two for a photo that is left unchanged: usually a copy of its file under its own name
    unchanged: Place | None = None
    unchanged_mask: Place | None = None
    folder_log_odds: float | None = None  # judged again in view of the other photos of its folder (run/folder.py)
    preview_px: int | None = None  # long side [px] of the before and after pictures, 0 for full size; None: no preview

    @property
    def targets(self) -> tuple[Place | None, ...]:
        """Picture, motion file and mask, then picture and mask if it is left unchanged; None: not written."""
        return self.target, self.motion_target, self.mask_target, self.unchanged, self.unchanged_mask

    @property
    def outputs(self) -> list[Place]:
        """The targets that may be written, each once."""
        return list(dict.fromkeys(target for target in self.targets if target is not None))


@dataclass(frozen=True)
class Outcome:
    """The outcome of a job."""

    error: str = ""  # one line; empty on success
    usage: bool = False  # whether the error concerns the request rather than the photo
    is_preview: bool = False  # whether the file is no photo but a preview from an earlier run
    unknown_ratio: bool = False  # whether the frames do not show their camera's readout ratio
    note: str = ""  # further information for the user
    model: str = ""  # motion model used for a photo with neighbours (frames/sequence_rectification.py); otherwise empty
    verdict: Verdict | None = None  # whether the photo was changed, and why not
    edges: Edges | None = None  # how areas that the photo did not see were handled; None: unchanged
    area_left: float | None = None  # share of the photo's area that a crop leaves; None if no crop was computed
    seconds: float = 0.0  # duration of the job
    source_is: str | None = None  # fingerprint of the photo that was read
    picture: Place | None = None  # the picture that was written; for an unchanged photo there may be none
    outputs_are: tuple[str | None, ...] = ()  # fingerprints of the job's outputs; None for those that were not written
    digests: tuple[str | None, ...] = ()  # digests of the outputs, if they are recorded
    group: str = ""  # folder, camera and hour of the photo
    chance: Chance | None = None  # what the photo says about whether its camera moved
    preview: tuple[np.ndarray, np.ndarray] | None = None  # the before and after pictures for a preview


# ---- photos ahead of their turn ----------------------------------------------------------------------------------


class Lookahead:
    """Photos of a batch in order, each started while the previous one is processed; two are held at a time.

    The first is opened and decoded while the estimator is loaded; an error of a photo is raised when it is taken. The
    results do not differ from those of a run without lookahead. Photos may be skipped. Without ``find``, no motion is
    needed, without ``undo`` no pixels.
    """

    def __init__(
        self, places: Sequence[Place], find: Find | None, max_pixels: int = MAX_PIXELS, undo: Undo | None = None
    ) -> None:
        self.find, self.max_pixels, self.undo = find, max_pixels, undo
        self.estimator: Estimator | None = None
        self.thread = ThreadPoolExecutor(1)
        self._waiting = deque(places)
        libvips()  # imported here: two threads importing at once mostly block each other
        self._next = PhotoAhead(self._waiting.popleft(), self) if places else None
        import numpy  # noqa: F401 (what the decoder needs next)

        if find is not None:
            self.estimator = load(find.estimator)
        if self._next is not None:
            self._next.look(whole=True)  # decode all pixels as well: there is no other work yet
        if self.estimator is not None:
            self.estimator.prepare()  # while line segments are being detected

    def take(self, place: Place) -> PhotoAhead:
        """Returns the photo of a place, and starts the next one."""
        photo = self._next
        if photo is None or photo.place != place:
            photo = PhotoAhead(place, self)
            photo.look()
            if place not in self._waiting:  # requested a second time
                return photo
            while self._waiting.popleft() != place:  # some were skipped
                pass
        self._next = PhotoAhead(self._waiting.popleft(), self) if self._waiting else None
        if self._next is not None:
            self._next.look()
        return photo


class PhotoAhead:
    """A photo that is opened, decoded and analysed ahead of its turn, in the thread of its lookahead."""

    def __init__(self, place: Place, options: Lookahead) -> None:
        self.place = place
        self._options = options
        self._opening = options.thread.submit(self._open)
        self._looking = None

    def look(self, whole: bool = False) -> None:
        """Starts estimating the motion, and with ``whole`` also decoding all pixels, whether or not they change."""
        if self._options.estimator is not None:
            self._looking = self._options.thread.submit(self._estimate, whole)

    @property
    def photo(self) -> Photo:
        """The opened photo; waits until it is open."""
        return self._opening.result()

    def motion(self) -> Motion:
        """Returns the motion, with the first row as the reference, or as :func:`judged` if it will be undone."""
        return self.judged()[0]

    def judged(self) -> tuple[Motion, Verdict | None]:
        """Returns the motion and the verdict on it; no verdict if nothing will be undone."""
        if self._looking is not None:
            try:
                return self._looking.result()
            except WeightsError:  # loading may have taken a minute: no second attempt
                raise
            except UnshutterError:  # repeat it alone for its message: libvips mixes those of two threads
                pass
        return self._estimate()

    def _open(self) -> Photo:
        options = self._options
        photo = open_photo(self.place, options.max_pixels)
        grey_px = method(options.find.estimator).grey_px if options.find else None
        photo.start_decoding(None, grey_px, whole=options.undo is not None and options.find is None)
        return photo

    def _estimate(self, whole: bool = False) -> tuple[Motion, Verdict | None]:
        from unshutter.api import estimate_photo
        from unshutter.motion.rectified import judged

        photo, options = self.photo, self._options
        if whole and options.undo is not None:
            photo.start_decoding()
        camera = options.find.camera if options.find else Camera()
        assert options.estimator is not None
        motion = estimate_photo(photo, options.estimator, camera)
        if options.undo is None:
            return motion, None
        motion, verdict = judged(motion, options.undo, photo.height, photo.width, camera.readout)
        if verdict.changes:
            photo.start_decoding()
        return motion, verdict


def open_photo(place: Place, max_pixels: int = MAX_PIXELS) -> Photo:
    """Opens the photo of a place, a file or an object behind a URL; errors are those of ``Photo.open``.

    Raises PreviewError for previews, which otherwise would be taken for photos by the next run over their folder.
    """
    if isinstance(place, Path):
        photo = Photo.open(place, max_pixels)
    else:
        photo = Photo.from_bytes(read_place(place), max_pixels)
    if photo.software == PREVIEW:
        raise PreviewError("it is a preview that unshutter made, not a photo")
    return photo


# ---- the job -----------------------------------------------------------------------------------------------------


def do_job(job: Job, request: Rectify, motion: str | None = None, lookahead: Lookahead | None = None) -> Outcome:
    """Runs the job; errors are returned in the outcome.

    The motion is the text of the motion file named in the request, which other machines may not have. Without
    lookahead, the photo is read now.
    """
    start = time.perf_counter()
    try:
        with errors_in_one_line(job.source):
            outcome = finish_job(job, request, motion, lookahead)
    except UnshutterError as error:
        usage, preview, ratio = (isinstance(error, kind) for kind in (UsageError, PreviewError, UnknownRatioError))
        return Outcome(str(error), usage, preview, ratio, seconds=time.perf_counter() - start)
    return replace(outcome, seconds=time.perf_counter() - start)


def finish_job(job: Job, request: Rectify, motion: str | None = None, lookahead: Lookahead | None = None) -> Outcome:
    """Runs the job."""
    source_is = fingerprint(job.source)  # taken before reading: a photo that is modified later counts as changed
    if lookahead is None or job.folder_log_odds is not None or job.burst is not None:
        find = None if motion is not None or job.burst is not None else request.find_alone
        if find is not None and job.folder_log_odds is not None:
            find = replace(find, camera=replace(find.camera, folder_log_odds=job.folder_log_odds))
        lookahead = Lookahead([job.source], find, job.max_pixels, request.undo)
    ahead = lookahead.take(job.source)
    result: Rectified | RectifiedFrame
    model, chance = "", None
    if request.neighbours or request.neighbours.sequence:
        result = _between(ahead.photo, job, request)
        model = result.model
    else:
        result = _alone(ahead, job, request, motion)
        chance = result.found.chance
    picture, mask_target = (job.target, job.mask_target) if result.changed else (job.unchanged, job.unchanged_mask)
    picture = picture if result.changed or not request.save.only_changed else None
    motion_target = job.motion_target if result.motion is not None else None
    left = dict(zip(job.targets, job.left, strict=True))
    written = {target for target in (picture, motion_target, mask_target) if target is not None}
    may_replace = {target: _may_replace(job, target, left[target]) for target in written}
    as_written = ""
    if picture is not None:
        as_written = _save_picture(result, job.source, picture, may_replace[picture], request.save)
    if motion_target is not None:
        assert result.motion is not None
        text = f"{result.motion.to_json()}\n".encode()
        write_place(text, motion_target, may_replace[motion_target], mode_of=job.source)
    if mask_target is not None:
        mask = Photo.from_array(result.valid.astype("uint8") * 255).to_bytes("png")  # 255: the photo shows the scene
        write_place(mask, mask_target, may_replace[mask_target], mode_of=job.source)
    for target in job.outputs:
        if target not in written and left[target] is not None and digest(target) == left[target]:
            remove(target)  # left by a run with other options
    outputs = [target if target in written else None for target in job.outputs]
    preview = None
    if job.preview_px is not None:
        before = result.original.upright(job.preview_px)
        preview = before, result.photo.upright(job.preview_px) if result.changed else before
    return Outcome(
        verdict=result.verdict,
        group=_group(job.source, result.original),
        chance=chance,
        note=as_written,
        edges=result.edges if result.changed else None,
        area_left=result.whole,
        model=model,
        source_is=source_is,
        picture=picture,
        outputs_are=tuple(fingerprint(target) if target else None for target in outputs),
        digests=tuple(digest(target) if job.recorded and target else None for target in outputs),
        preview=preview,
    )


def _group(place: Place, photo: Photo) -> str:
    """Names the photos that are judged together: one folder, one camera, one hour."""
    taken = photo.taken()
    return "|".join((str(absolute(place).parent), photo.camera(), "" if taken is None else f"{taken:%Y-%m-%d %H}"))


def _alone(ahead: PhotoAhead, job: Job, request: Rectify, motion: str | None) -> Rectified:
    """Rectifies a photo by itself, or with the motion that its burst shows, or with that shared by all photos."""
    from unshutter.motion.rectified import undo, undo_judged

    if motion is not None:
        return undo(ahead.photo, _parsed(motion), request.undo, request.find.camera.readout)
    if job.burst is not None:
        return undo(ahead.photo, job.burst.motion.motion(request.undo.reference or "first"), request.undo)
    found, verdict = ahead.judged()
    assert verdict is not None
    return undo_judged(ahead.photo, found, verdict, request.undo.edges)


def _between(photo: Photo, job: Job, request: Rectify) -> RectifiedFrame:
    """Rectifies a photo with the help of its neighbours."""
    from unshutter.frames.sequence_rectification import RectifiedFrame, SequenceOptions, rectify_between
    from unshutter.motion.rectified import undo

    neighbours, camera = request.neighbours, request.find.camera
    alone = request.find if neighbours.fallback else None
    options = SequenceOptions(
        request.readout_time, request.undo, camera.direction, neighbours.at, neighbours.model, camera.focal_px, alone
    )
    if not neighbours.sequence:
        before, after = (path and open_photo(path, job.max_pixels) for path in (neighbours.before, neighbours.after))
        return rectify_between(photo, before, after, options)
    if job.motion is None:
        raise UnshutterError(
            "{photo} could not be read when the motion of the sequence was found: run the command again",
            photo=job.source,
        )
    before, after = (place and open_photo(place, job.max_pixels) for place in (job.before, job.after))
    try:
        return rectify_between(photo, before, after, options, job.motion)
    except UsageError:
        raise
    except UnshutterError:  # no optical flow: use what is known of the camera's motion, or keep the photo
        motion = job.motion.motion(request.undo.reference or "first")
        return RectifiedFrame.of(undo(photo, motion, request.undo), "camera")


def _may_replace(job: Job, target: Place, left: str | None) -> bool:
    """Whether an output may replace an existing file, because the user allows it or an earlier run wrote it."""
    if job.overwrite or left is None:
        return job.overwrite
    if digest(target) == left:
        return True
    if not job.may_repeat:  # the check before the job left this to the digest
        check_place(target, overwrite=False)
    return False


@lru_cache(maxsize=1)
def _parsed(text: str) -> Motion:
    """Parses the motion shared by all photos of a batch, once per process."""
    from unshutter.motion import Motion

    return Motion.from_json(text)


def _save_picture(result: Result, source: Place, target: Place, overwrite: bool, save: Save) -> str:
    """Writes a job's result in the format of its name; returns what the user should know of it, usually nothing.

    A photo that is left unchanged is copied, whatever the quality, unless its name asks for another format.
    """
    from unshutter.motion.rectified import write_result

    own = FORMATS[result.original.format]
    if not result.changed and (target.suffix == source.suffix or of_suffix(target.suffix) is own):
        write_result(result, target, own, Save(keep_times=save.keep_times), overwrite)
        return ""
    format = of_target(Path(target.name))
    left_out = write_result(result, target, format, save, overwrite)
    anew = "" if result.changed else f"encoded as {format.name.upper()}"
    return "; ".join(filter(None, (anew, not_written(left_out))))
