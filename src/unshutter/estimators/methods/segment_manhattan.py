"""segment-manhattan: combines segment-transformer's estimate with the Manhattan likelihood.

The network (segment_network.py) estimates curvature well and shear poorly; right angles, if present, determine the
shear. Its estimate therefore enters the likelihood as one more observation, with the covariance of its errors.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.method import Method
from unshutter.estimators.right_angles.answers import candidates_of
from unshutter.estimators.right_angles.beliefs import MotionKind, SecondOpinion
from unshutter.estimators.right_angles.calibration import NetworkErrors, shipped
from unshutter.estimators.right_angles.posterior import PX, Posterior, displacement
from unshutter.estimators.right_angles.search import explore
from unshutter.estimators.right_angles.smear_answer import candidates_by_smear
from unshutter.estimators.right_angles.view import STARTS, likelihood_of, segments_of
from unshutter.estimators.segment_network import SegmentNetwork
from unshutter.estimators.segments import unusable
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate, alone

_SEEN_TILTS = (-15.0, 50.0)  # degrees: range of the network's training data


class SegmentManhattan(Estimator):
    """The posterior mean, including the network's estimate as an observation.

    Args:
        method, weights: see :class:`Estimator`.
        errors: errors of the network; those of the shipped calibration by default.
        kinds: kinds of motion; those of the shipped calibration by default.
    """

    def __init__(
        self,
        method: Method,
        weights: Path | None = None,
        errors: NetworkErrors | None = None,
        kinds: tuple[MotionKind, ...] = (),
    ):
        super().__init__(method, weights)
        self._network = SegmentNetwork(weights)
        self._errors = errors or shipped().network_errors
        self.kinds = kinds or shipped().kinds

    def prepare(self) -> None:
        """Opens the network."""
        self._network.open()

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z; zero motion with a reason if there are too few segments."""
        return self.candidates(view)[0].motion

    def candidates(self, view: View) -> tuple[Candidate, ...]:
        """Returns the modes of the posterior; zero motion with a reason if there are too few segments."""
        segments, size = segments_of(view)
        reason = unusable(segments, view.height, view.width)
        if reason:
            return alone(view.no_motion(self.name, reason), view.photo.orientation)
        _, tilt = view.attitude_deg()
        if tilt is not None and not _SEEN_TILTS[0] <= tilt <= _SEEN_TILTS[1]:
            likelihood = likelihood_of(view, segments, size, kinds=self.kinds)
            return candidates_of(explore(likelihood, STARTS), view, self.name)
        posterior, answer = self.weigh(view, segments, size)
        by_smear = candidates_by_smear(posterior, view, self.name)
        return by_smear or candidates_of(posterior, view, self.name, answer)

    def weigh(self, view: View, segments: np.ndarray, size: tuple[int, int]) -> tuple[Posterior, np.ndarray]:
        """Returns the posterior including the network's estimate, and that estimate: [6] coefficients.

        Args:
            view: the photo.
            segments, size: as :func:`segments_of` returns them.
        """
        answer = self._network.coefficients(segments, view.up).ravel()
        precision = self._errors.precision(PX * displacement(answer))
        opinion = SecondOpinion(answer, precision, self._errors.freedom)
        return explore(likelihood_of(view, segments, size, opinion, self.kinds), [answer]), answer
