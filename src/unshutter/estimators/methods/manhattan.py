"""manhattan: finds the motion, camera and focal length that make line segments straight and square. No learning.

The likelihood and the search are in right_angles.
"""

from __future__ import annotations

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.right_angles.answers import candidates_of
from unshutter.estimators.right_angles.search import explore
from unshutter.estimators.right_angles.view import STARTS, likelihood_of, segments_of
from unshutter.estimators.segments import unusable
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate, alone


class Manhattan(Estimator):
    """The posterior mean under the Manhattan likelihood, over all optima found."""

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z; zero motion with a reason if there are too few segments."""
        return self.candidates(view)[0].motion

    def candidates(self, view: View) -> tuple[Candidate, ...]:
        """Returns the modes of the posterior; zero motion with a reason if there are too few segments."""
        segments, size = segments_of(view)
        reason = unusable(segments, view.height, view.width)
        if reason:
            return alone(view.no_motion(self.name, reason), view.photo.orientation)
        posterior = explore(likelihood_of(view, segments, size), STARTS)
        return candidates_of(posterior, view, self.name)
