"""A photo's motion as everybody should ask for it: by its metadata or an estimator, unless its sharpness refutes it."""

from __future__ import annotations

from dataclasses import replace

from unshutter.errors import UnshutterError
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.flight import flight_motion
from unshutter.estimators.methods.none import DoNothing
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate, alone


def find_motion(estimator: Estimator, view: View) -> Motion:
    """The motion of a photo, first row as the reference, with what was known of the photo besides its pixels.

    Raises:
        UnshutterError: the photo is damaged or gone, or has fewer candidates than the one that is asked for.
    """
    return chosen(find_candidates(estimator, view), view.camera.candidate)


def chosen(candidates: tuple[Candidate, ...], number: int | None) -> Motion:
    """The motion of a candidate. One that a person has chosen has no confidence: nothing is left to doubt.

    Args:
        candidates: of a photo.
        number: counted from 1; None: the first, with its confidence.

    Raises:
        UnshutterError: there are fewer.
    """
    if number is None:
        return candidates[0].motion
    if number > len(candidates):
        listed = ", ".join(each.description for each in candidates)
        raise UnshutterError(f"there is no candidate {number}: the photo has {len(candidates)} ({listed})")
    return replace(candidates[number - 1].motion, confidence=None)


def find_candidates(estimator: Estimator, view: View) -> tuple[Candidate, ...]:
    """The motions that fit a photo, first that of :func:`find_motion`; the photo as it is counts as one.

    What a drone's flight says goes before what the estimator would find. Motions that would have blurred the photo more
    than it is are left out; where that is the first, there is none, and why.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    by_flight = None if isinstance(estimator, DoNothing) else flight_motion(view)
    candidates = alone(by_flight, view.photo.orientation) if by_flight else estimator.candidates(view)
    limit = None if all(each.motion.is_zero for each in candidates) else view.speed_limit
    if limit is not None:
        possible = tuple(each for each in candidates if each.motion.is_zero or not limit.refutes(each.motion))
        if candidates[0] not in possible:
            none = Candidate("still", view.no_motion(estimator.name, limit.reason))
            possible = (none, *(each for each in possible if each.kind != "still"))
        candidates = possible
    return tuple(replace(each, motion=view.noted(each.motion)) for each in candidates)
