"""A photo's motion as everybody should ask for it: what an estimator says, unless the photo's sharpness refutes it."""

from __future__ import annotations

from unshutter.estimators.base import Estimator, View
from unshutter.motion import Motion


def find_motion(estimator: Estimator, view: View) -> Motion:
    """The motion of a photo, first row as the reference, with what was known of the photo beside its pixels.

    Where the photo would have been blurred more than it is by what an estimator finds, there is no motion, and why.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    motion = estimator.estimate(view)
    limit = None if motion.is_zero else view.speed_limit
    if limit is not None and limit.refutes(motion):
        motion = view.no_motion(estimator.name, limit.reason)
    return view.noted(motion)
