"""none: leaves photos unchanged, the baseline of every table."""

from unshutter.estimators.base import Estimator, View
from unshutter.motion import Motion
from unshutter.reasons import Code, Reason


class DoNothing(Estimator):
    """Always returns zero motion."""

    def estimate(self, view: View) -> Motion:
        """Returns zero motion."""
        return view.no_motion(self.name, Reason(Code.ASKED_FOR_NOTHING))
