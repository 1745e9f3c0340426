"""segment-transformer: estimates row motion from the photo's line segments with a small transformer."""

from __future__ import annotations

from pathlib import Path

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.method import Method
from unshutter.estimators.segment_network import MOST_SEGMENTS, SegmentNetwork
from unshutter.estimators.segments import find_segments, in_rows, unusable
from unshutter.motion import Motion

SHORT_SIDE = 512  # of the grey copy in which segments are detected [px]


class SegmentTransformer(Estimator):
    """Runs the network on the line segments of a photo."""

    def __init__(self, method: Method, weights: Path | None = None):
        super().__init__(method, weights)
        self._network = SegmentNetwork(weights)

    def prepare(self) -> None:
        """Opens the network."""
        self._network.open()

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z; zero motion with a reason if there are too few segments."""
        grey = view.grey(SHORT_SIDE)
        segments = find_segments(grey, MOST_SEGMENTS)
        reason = unusable(segments, view.height, view.width)
        if reason:
            return view.no_motion(self.name, reason)
        coefficients = self._network.coefficients(in_rows(segments, *grey.shape), view.up)
        return view.cubic_motion(coefficients, self.name)
