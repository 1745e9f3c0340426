"""An estimator that answers with the same shear for every photo, as surely as it is told to."""

from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.reasons import MotionSource, Reason
from unshutter.single import register
from unshutter.single.estimator import Estimator, View


class Sure(Estimator):
    """Moves the last row by ``px`` to the right; declines where ``reason`` says why."""

    def __init__(self, confidence: float | None, px: float = 9.0, reason: str | Reason = ""):
        super().__init__(register.method("none"))
        self.confidence, self.px, self.reason = confidence, px, reason

    def estimate(self, view: View) -> Finding:
        if self.reason:
            return view.no_motion(self.name, self.reason)
        motion = RowMotion.from_polynomials(
            [0, self.px], [0], view.height, view.width, scan_direction=view.scan_direction
        )
        return Finding(motion, estimator=self.name, source=MotionSource.PIXELS, confidence=self.confidence)
