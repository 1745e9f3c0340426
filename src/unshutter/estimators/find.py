"""Determines a photo's motion from its metadata or an estimator, unless its sharpness refutes the motion."""

from __future__ import annotations

from dataclasses import replace

from unshutter.errors import UnshutterError
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.flight import flight_motion
from unshutter.estimators.methods.none import DoNothing
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate, alone


def find_motion(estimator: Estimator, view: View) -> Motion:
    """Returns the motion of a photo, first row as the reference, with what is known apart from its pixels.

    Raises:
        UnshutterError: the photo is damaged or gone, or the candidate requested does not exist.
    """
    return chosen(find_candidates(estimator, view), view.camera.candidate)


def chosen(candidates: tuple[Candidate, ...], number: int | None) -> Motion:
    """Returns the motion of a candidate; one that a person has chosen has no confidence, as no doubt remains.

    Args:
        candidates: candidates of a photo.
        number: counted from 1; None for the first, with its confidence.

    Raises:
        UnshutterError: there are fewer candidates.
    """
    if number is None:
        return candidates[0].motion
    if number > len(candidates):
        listed = ", ".join(each.description for each in candidates)
        raise UnshutterError(f"there is no candidate {number}: the photo has {len(candidates)} ({listed})")
    taken = candidates[number - 1]
    strength = 0 if taken.kind == "still" else 1  # "as it is" leaves no trace of motion, either
    return replace(taken.motion.scaled(strength), confidence=None)


def find_candidates(estimator: Estimator, view: View) -> tuple[Candidate, ...]:
    """Returns the possible motions of a photo, that of :func:`find_motion` first, including no change.

    A drone's flight data take precedence over the estimator. Motions that would have blurred the photo more than it is
    are dropped; if this removes the first one, it is replaced by zero motion with the reason.

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
