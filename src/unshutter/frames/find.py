"""Finds the motion of one photo: by the film inside it, otherwise by an estimator."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from unshutter.motion.finding import Candidate, Finding, list_single
from unshutter.options import DEFAULT_ESTIMATOR, Camera
from unshutter.photo import Photo
from unshutter.photo.photo import check_size
from unshutter.reasons import MOST_STATED
from unshutter.single.estimator import Estimator, View
from unshutter.single.methods import DoNothing, find_candidates
from unshutter.single.prospects import MOST_IN_FOLDER
from unshutter.single.register import load, method

if TYPE_CHECKING:
    from unshutter.frames.motion_photo import FilmEvidence


def find(photo: Photo, estimator: str | Estimator = DEFAULT_ESTIMATOR, known: Camera | None = None) -> Finding:
    """Finds the motion of a photo and the others that fit, with the first row as the reference.

    Their probabilities are as they are stated everywhere (reasons.py).

    Args:
        photo: its grey copy is decoded while an estimator that is named is loaded.
        estimator: name of a method, or an estimator.
        known: what is known about the camera.

    Raises:
        UnshutterError: the photo is damaged or too small; UsageError: unknown estimator.
    """
    check_size(photo.height, photo.width)
    if isinstance(estimator, str):
        photo.start_decoding(grey_px=method(estimator).grey_px, whole=False)
        estimator = load(estimator)
    view = View(photo, known or Camera())
    most = MOST_IN_FOLDER if view.camera.folder_log_odds else MOST_STATED
    referred = (each.rereferenced("first") for each in _list_candidates(view, estimator))
    candidates = tuple(each.as_stated(most) for each in referred)
    return Finding(candidates[0].motion, candidates)


def _list_candidates(view: View, estimator: Estimator) -> tuple[Candidate, ...]:
    evidence = _film_evidence(view, estimator)
    if evidence is not None and evidence.motion is not None:
        return list_single(view.noted(evidence.motion), view.photo.orientation)
    unused = None if evidence is None else evidence.reason
    found = find_candidates(estimator, view)
    return tuple(replace(each, motion=replace(each.motion, film=unused)) for each in found)


def _film_evidence(view: View, estimator: Estimator) -> FilmEvidence | None:
    """Returns the evidence from the film inside a photo; None if there is no film or it is not to be used."""
    if view.camera.no_film or isinstance(estimator, DoNothing) or view.photo.film() is None:
        return None
    from unshutter.frames.motion_photo import film_motion  # imported here because few photos have a film

    return film_motion(view)
