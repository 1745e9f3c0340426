"""An estimator whose answer is known beforehand."""

from unshutter import Finding, Motion
from unshutter.single.estimator import Estimator, View


class Fixed:
    """Answers with one motion, resized to the photo."""

    name = "fixed"
    candidates = Estimator.candidates

    def __init__(self, motion: Motion | Finding) -> None:
        self.motion, self.seen = motion, []

    def estimate(self, view: View) -> Motion | Finding:
        self.seen.append(view)
        return self.motion.resized(view.height, view.width)
