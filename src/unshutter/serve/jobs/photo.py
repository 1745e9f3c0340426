"""Jobs on a photo: files as the command line writes them, and small upright previews with metadata."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.batch.job import Job
from unshutter.batch.work import finish_job
from unshutter.errors import UnshutterError
from unshutter.estimators.register import load
from unshutter.geometry.readout import Orientation
from unshutter.options import Rectify
from unshutter.photo import Photo
from unshutter.photo.libvips import libvips
from unshutter.serve.fields import ByHand
from unshutter.serve.jobs.by_hand import Shape, motion_to_undo, undo_by_hand, with_motion_file
from unshutter.serve.jobs.cache import (
    OpenFile,
    candidates_of,
    errors_of,
    kept_candidates,
    neighbour_names,
    opened,
)
from unshutter.serve.jobs.facts import CandidateFacts, PhotoFacts, PhotoResult, SavedPhoto
from unshutter.serve.jobs.screen import arrows, as_jpeg, corners_of, shares, small_copy

if TYPE_CHECKING:
    import numpy as np

    from unshutter.motion import Motion
    from unshutter.options import Undo
    from unshutter.warp.edges import EdgeDecision


_NOT_BY_HAND = ByHand()


def warm() -> int:
    """Preloads what the first photo would otherwise have to wait for, and returns the process id."""
    import unshutter.rectification
    import unshutter.warp.pixels  # noqa: F401

    libvips()
    load().prepare()
    return os.getpid()


def estimated(open_file: OpenFile, options: Rectify, hand: ByHand = _NOT_BY_HAND) -> str:
    """Returns the photo's motion as JSON, in the format of `unshutter estimate`.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    with errors_of(open_file):
        motion = motion_to_undo(open_file, opened(open_file), options, hand)
        return motion.rereferenced(options.undo.reference or "first").to_json() + "\n"


def estimated_candidates(open_file: OpenFile, options: Rectify) -> str:
    """Returns the motions that fit the photo as JSON, in the format of `unshutter estimate --candidates`.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    from unshutter.motion.candidate import candidates_to_json

    reference = options.undo.reference or "first"
    with errors_of(open_file):
        listed = candidates_of(open_file, opened(open_file), options.find)
        return candidates_to_json(replace(each, motion=each.motion.rereferenced(reference)) for each in listed) + "\n"


def saved(open_file: OpenFile, target: Path, options: Rectify, hand: ByHand = _NOT_BY_HAND) -> dict[str, Any]:
    """Writes the rectified photo exactly as `unshutter rectify` does, and returns :class:`SavedPhoto` as JSON.

    Raises:
        UnshutterError, UsageError: the photo or the options cannot be used.
    """
    names = {target: target.name, **neighbour_names(options.neighbours)}
    if options.motion is not None:
        names[options.motion] = "the motion"
    with errors_of(open_file, names):
        options = with_motion_file(open_file, options, hand)
        job = Job(open_file.path, target, None, overwrite=False, max_pixels=open_file.max_pixels)
        outcome = finish_job(job, options, _known_motion(open_file, options))
    return SavedPhoto(outcome.verdict, outcome.note).as_json()


def _known_motion(open_file: OpenFile, options: Rectify) -> str | None:
    """Returns the JSON of the motion sent with the request or already estimated for the screen, or None."""
    from unshutter.estimators.find import chosen

    if options.neighbours:
        return None
    if options.motion is not None:
        from unshutter.motion import Motion

        return Motion.load(options.motion).to_json()
    kept = kept_candidates(open_file, options.find)
    return chosen(kept, options.find.camera.candidate).to_json() if kept else None


def before(open_file: OpenFile, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """Returns the upright photo as a JPEG for the screen, and :class:`PhotoFacts` as JSON.

    Args:
        open_file: the photo.
        longest: longer side [px], or None for full size.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    with errors_of(open_file):
        return _before(open_file, longest)


def after(
    open_file: OpenFile, options: Rectify, longest: int | None, hand: ByHand = _NOT_BY_HAND, draft: bool = False
) -> tuple[bytes, dict[str, Any]]:
    """Returns the rectified photo as an upright, uncropped JPEG for the screen, and :class:`PhotoResult` as JSON.

    Args:
        open_file: the photo.
        options: the photo's options.
        longest: longer side [px], or None for full size.
        hand: lines drawn and numbers set by hand.
        draft: whether to save time while a slider is being dragged: decisions are based on the small copy, and the
            crop is not computed.

    Raises:
        UnshutterError, UsageError: see :func:`unshutter.result.undo`.
    """
    with errors_of(open_file, neighbour_names(options.neighbours)):
        photo = opened(open_file)
        if options.neighbours:
            pixels, result = _rectified_between(open_file, photo, options, longest)
        else:
            motion, undo = motion_to_undo(open_file, photo, options, hand), undo_by_hand(options, hand)
            rectified = _drafted if draft else _rectified_alone
            pixels, result = rectified(photo, small_copy(open_file, photo, longest), motion, undo)
        return as_jpeg(pixels, photo.orientation), result.as_json()


def candidates(open_file: OpenFile, options: Rectify) -> list[dict[str, Any]]:
    """Lists the motions that fit a photo as :class:`CandidateFacts` JSON, in the order of option ``candidate``.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    from unshutter.result import judged

    with errors_of(open_file):
        photo, camera = opened(open_file), replace(options.find.camera, candidate=None, at_any_odds=False)
        possible = candidates_of(open_file, photo, replace(options.find, camera=camera))
        motions = [judged(each.motion, options.undo, photo.height, photo.width) for each in possible]
        first = motions[0][1].changes
        taken = 0 if first else next((k for k, each in enumerate(possible) if each.kind == "still"), None)
        return [
            CandidateFacts(each, motion.largest_px, taken == k).as_json()
            for k, (each, (motion, _)) in enumerate(zip(possible, motions, strict=True))
        ]


def segments(open_file: OpenFile, options: Rectify, hand: ByHand = _NOT_BY_HAND) -> dict[str, Any]:
    """Returns the line segments that estimators use, before and after, as shares of the upright photo's size.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    with errors_of(open_file, neighbour_names(options.neighbours)):
        return _segments(open_file, options, hand)


def _before(open_file: OpenFile, longest: int | None) -> tuple[bytes, dict[str, Any]]:

    photo = opened(open_file)
    pixels = small_copy(open_file, photo, longest)
    height, width = Orientation(photo.orientation).size(photo.height, photo.width)
    focal_px = photo.focal_px() or 0.85 * (photo.height + photo.width)
    directions = arrows(photo.orientation)
    facts = PhotoFacts(photo.format, height, width, focal_px, photo.exposure_s(), directions, photo.attitude)
    return as_jpeg(pixels, photo.orientation), facts.as_json()


def _rectified_alone(photo: Photo, pixels: np.ndarray, motion: Motion, undo: Undo) -> tuple[np.ndarray, PhotoResult]:
    """Undoes a motion in a small copy; decisions are made at full size, as for saving."""
    from unshutter.result import judged
    from unshutter.warp.pixels import edge_decision, straighten

    shape = Shape.of(motion)
    motion, verdict = judged(motion, undo, photo.height, photo.width)
    result = PhotoResult(verdict, motion, shape, str(motion.readout))
    if not verdict.changes:
        return pixels, result
    decision = edge_decision(motion, undo.edges)
    small = motion.resized(*motion.readout.frame_size(*pixels.shape[:2]))
    pixels = straighten(pixels, small, "fill" if decision.edges == "fill" else "keep").pixels
    return pixels, _with_edges(result, decision, (photo.height, photo.width), photo.orientation)


def _drafted(photo: Photo, pixels: np.ndarray, motion: Motion, undo: Undo) -> tuple[np.ndarray, PhotoResult]:
    """Undoes a motion in a small copy; decisions are made at the size of the copy."""
    from unshutter.result import judged
    from unshutter.warp.pixels import straighten

    shape, (height, width) = Shape.of(motion), pixels.shape[:2]
    small, verdict = judged(motion, undo, height, width)
    verdict = replace(verdict, largest_px=verdict.largest_px * photo.height / height)
    if verdict.changes:
        pixels = straighten(pixels, small, "fill" if undo.edges == "fill" else "keep").pixels
    return pixels, PhotoResult(verdict, small, shape, str(motion.readout))


def _rectified_between(
    open_file: OpenFile, photo: Photo, options: Rectify, longest: int | None
) -> tuple[np.ndarray, PhotoResult]:
    """Rectifies a small copy of the photo, using small copies of its neighbours."""
    from unshutter.frames.frame import SequenceOptions
    from unshutter.frames.sequence_rectification import rectify_between
    from unshutter.warp.edges import EdgePolicy, valid_window

    policy, frames = EdgePolicy(options.undo.edges), options.neighbours
    undo = replace(options.undo, edges="keep") if policy.may_crop else options.undo
    scale = 1.0 if longest is None else max(max(photo.height, photo.width) / longest, 1.0)
    focal_px = options.find.camera.focal_px or photo.focal_px()
    alone = options.find if frames.fallback else None
    described = frames.at, frames.model, focal_px and focal_px / scale, alone
    sequence = SequenceOptions(options.clock, undo, options.find.camera.direction, *described)
    neighbours = [path and replace(open_file, path=path) for path in (frames.before, frames.after)]
    for each in filter(None, neighbours):
        _check_size(photo, opened(each))
    copies = [each and Photo.from_array(small_copy(each, opened(each), longest)) for each in neighbours]
    frame = rectify_between(Photo.from_array(small_copy(open_file, photo, longest)), copies[0], copies[1], sequence)
    verdict = replace(frame.verdict, largest_px=frame.verdict.largest_px * scale)
    result = PhotoResult(verdict, None, None, str(sequence.readout), neighbours=True)
    if not frame.changed:
        return frame.pixels, result
    rows, cols = frame.valid.shape
    decision = policy.decide((rows, cols), lambda: valid_window(frame.valid))
    return frame.pixels, _with_edges(result, decision, (rows, cols), photo.orientation)


def _check_size(photo: Photo, neighbour: Photo) -> None:
    """Raises UnshutterError if a neighbour differs in size from the photo."""
    sizes = [f"{each.width} × {each.height} px" for each in (neighbour, photo)]
    if sizes[0] != sizes[1]:
        raise UnshutterError(f"it has {sizes[0]} and the photo {sizes[1]}, so they are not of one burst or clip")


def _with_edges(result: PhotoResult, decision: EdgeDecision, size: tuple[int, int], orientation: int) -> PhotoResult:
    """Adds a decision about edges to a result; the decision is for stored pixels of height x width."""
    (height, width), window = size, decision.window
    shares_left = window.left / width, window.top / height, window.right / width, window.bottom / height
    crop = corners_of(shares_left, orientation) if decision.edges == "crop" else None
    return replace(result, edges=decision.edges, whole=decision.whole, crop=crop)


def _segments(open_file: OpenFile, options: Rectify, hand: ByHand) -> dict[str, Any]:
    import numpy as np

    from unshutter.estimators.right_angles.view import MOST_SEGMENTS, SHORT_SIDE
    from unshutter.estimators.segments import find_segments
    from unshutter.result import judged
    from unshutter.warp.grid import rs_to_gs_map

    photo = opened(open_file)
    grey = photo.grey(SHORT_SIDE)
    ends = find_segments(grey, MOST_SEGMENTS).reshape(-1, 2)
    scale = np.array([photo.width / grey.shape[1], photo.height / grey.shape[0]])
    col, row = ((ends + 0.5) * scale - 0.5).T
    ends_at = {"before": (col, row)}
    if not options.neighbours:  # motion from neighbours applies to places, not to lines
        estimate = motion_to_undo(open_file, photo, options, hand)
        motion, verdict = judged(estimate, undo_by_hand(options, hand), photo.height, photo.width)
        ends_at["after"] = rs_to_gs_map(motion)(col, row) if verdict.changes else (col, row)
    size = photo.width, photo.height
    return {name: shares(*at, size, photo.orientation).reshape(-1, 4).round(4).tolist() for name, at in ends_at.items()}
