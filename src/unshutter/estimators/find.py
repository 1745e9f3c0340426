"""A photo's motion as everybody should ask for it: by its metadata or an estimator, unless its sharpness refutes it."""

from __future__ import annotations

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.flight import flight_motion
from unshutter.estimators.methods.none import DoNothing
from unshutter.motion import Motion


def find_motion(estimator: Estimator, view: View) -> Motion:
    """The motion of a photo, first row as the reference, with what was known of the photo beside its pixels.

    What a drone's flight says goes before what the estimator would find. Where the photo would have been blurred more
    than it is by the motion, there is none, and why.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    by_flight = None if isinstance(estimator, DoNothing) else flight_motion(view)
    motion = by_flight or estimator.estimate(view)
    limit = None if motion.is_zero else view.speed_limit
    if limit is not None and limit.refutes(motion):
        motion = view.no_motion(estimator.name, limit.reason)
    return view.noted(motion)
