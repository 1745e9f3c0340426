"""Finds the motion of one photo: by the video inside it, otherwise by an estimator."""

from __future__ import annotations

from dataclasses import replace

from unshutter.motion.finding import Candidate, Finding, list_single
from unshutter.options import Find
from unshutter.photo import Photo
from unshutter.photo.photo import check_size
from unshutter.reasons import MOST_STATED, Code, Reason
from unshutter.single.estimator import Estimator, View
from unshutter.single.methods import DoNothing, find_candidates
from unshutter.single.prospects import MOST_IN_FOLDER
from unshutter.single.register import load, method


def find(photo: Photo, how: Find, estimator: Estimator | None = None, pixels: bool = False) -> Finding:
    """Finds the motion of a photo and the others that fit, with the first row as the reference.

    Their probabilities are as they are stated everywhere (reasons.py).

    Args:
        photo: its grey copy is decoded while the estimator is loaded.
        how: the method, and what is known about the camera.
        estimator: an estimator that is loaded already, instead of the method's.
        pixels: whether all pixels of the photo are decoded, too, because they may be needed.

    Raises:
        UnshutterError: the photo is damaged or too small; UsageError: unknown estimator.
    """
    check_size(photo.height, photo.width)
    photo.start_decoding(grey_px=method(how.estimator).grey_px if estimator is None else None, whole=pixels)
    view = View(photo, how.camera, decision=how.decision)
    most = MOST_IN_FOLDER if how.decision.folder else MOST_STATED
    found = _list_candidates(view, estimator or load(how.estimator), how)
    candidates = tuple(each.rereferenced("first").as_stated(most) for each in found)
    return replace(candidates[0].finding, candidates=candidates)


def _list_candidates(view: View, estimator: Estimator, how: Find) -> tuple[Candidate, ...]:
    if view.photo.is_panorama():
        return list_single(view.no_motion(how.estimator, Reason(Code.PANORAMA)), view.photo.orientation)
    by_video = None
    if not how.no_film and not isinstance(estimator, DoNothing) and view.photo.embedded_video() is not None:
        from unshutter.frames.motion_photo import motion_by_embedded_video  # not at the top: few photos have a video

        by_video = motion_by_embedded_video(view)
    if isinstance(by_video, Finding):
        return list_single(view.noted(by_video), view.photo.orientation)
    found = find_candidates(estimator, view, how.insists)
    return tuple(replace(each, finding=replace(each.finding, video_unused=by_video)) for each in found)
