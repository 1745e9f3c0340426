"""segment-transformer: line segments of the photo -> a small transformer (ONNX) -> row motion.

Trained by ``unshutter.learn`` on drawn scenes; the card beside the weights says how.
"""

from __future__ import annotations

import os
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.lines.segments import find_segments, in_rows
from unshutter.estimators.onnx import open_network
from unshutter.motion import Motion, RowMotion

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SHORT_SIDE = 512  # of the grey copy in which segments are found [px]
MOST_SEGMENTS = 320  # the longest are kept
FEWEST_SEGMENTS = 8  # below this the photo does not say how the camera moved
WIDEST_ASPECT = 2.5  # a little beyond what the network was trained on


class SegmentTransformer:
    """Runs the exported network on the segments of a photo.

    Args:
        weights: path of an exported network; by default the one in the package.
    """

    name = "segment-transformer"

    def __init__(self, weights: str | os.PathLike[str] | None = None):
        self._weights = weights
        self._session: InferenceSession | None = None
        self._opening = Lock()

    def prepare(self) -> None:
        """Opens the network, unless it is open; the first estimate waits for it."""
        with self._opening:
            if self._session is None:
                inputs = ["tokens", "mask"]
                self._session = open_network(self.name, inputs, "coefficients", self._weights, opens_fast=True)

    def estimate(self, view: View) -> Motion:
        """Cubic t_x and r_z; no motion and a reason where there are too few segments."""
        aspect = view.width / view.height
        if max(aspect, 1 / aspect) > WIDEST_ASPECT:
            return view.no_motion(self.name, f"the photo's sides differ by more than {WIDEST_ASPECT:g} times")
        grey = view.grey(SHORT_SIDE)
        segments = find_segments(grey, MOST_SEGMENTS)
        if len(segments) < FEWEST_SEGMENTS:
            return view.no_motion(self.name, f"only {len(segments)} straight segments found")
        coefficients = self.coefficients(in_rows(segments, *grey.shape), view.up)
        return cubic_motion(coefficients, view, self.name)

    def coefficients(self, segments: np.ndarray, up: tuple[int, int] = (0, -1)) -> np.ndarray:
        """Runs the network.

        Args:
            segments: [N, 4] end points in centred units of rows (segments.py).
            up: unit vector (right, down) to the scene's top.

        Returns:
            [2, 3] coefficients of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].
        """
        tokens = np.concatenate([segments, np.broadcast_to(np.asarray(up), (len(segments), 2))], axis=1)
        mask = np.ones((1, len(tokens)), dtype=bool)
        self.prepare()
        assert self._session is not None
        (answer,) = self._session.run(None, {"tokens": tokens[None].astype(np.float32), "mask": mask})
        return np.asarray(answer, dtype=np.float64)[0]


def cubic_motion(coefficients: np.ndarray, view: View, estimator: str, confidence: float | None = None) -> Motion:
    """The motion of a photo from coefficients of u, u^2, u^3, first row as the reference.

    Args:
        coefficients: [2, 3], as :meth:`SegmentTransformer.coefficients` returns them.
        view: the photo.
        estimator: what found them.
        confidence: see :class:`Motion`.
    """
    u = (np.arange(view.height) + 0.5) / view.height
    tx, rz = (c[0] * u + c[1] * u**2 + c[2] * u**3 for c in coefficients)
    return RowMotion(
        width=view.width,
        tx_px=(tx - tx[0]) * view.height,
        rz_rad=rz - rz[0],
        readout=view.readout,
        estimator=estimator,
        confidence=confidence,
    )
