"""The small transformer (ONNX) that turns line segments into a row motion; several methods ask it.

Trained by ``unshutter.learn`` on drawn scenes; the card beside the weights says how.
"""

from __future__ import annotations

from pathlib import Path
from threading import Lock

import numpy as np

from unshutter.estimators.onnx import Network, open_network

MOST_SEGMENTS = 320  # it was trained on no more; the longest are kept


class SegmentNetwork:
    """The exported network, opened when it is first needed. Several threads may use it at once.

    Args:
        weights: the exported network.
    """

    def __init__(self, weights: Path | None):
        self._weights = weights
        self._network: Network | None = None
        self._opening = Lock()

    def open(self) -> Network:
        """The network; opens it the first time.

        Raises:
            UnshutterError: there is no file, or it is not this network.
        """
        with self._opening:
            if self._network is None:
                inputs, answer = ["tokens", "mask"], "coefficients"
                self._network = open_network("segment-transformer", self._weights, inputs, answer, opens_fast=True)
            return self._network

    def coefficients(self, segments: np.ndarray, up: tuple[int, int] = (0, -1)) -> np.ndarray:
        """Runs the network.

        Args:
            segments: [N, 4] end points in centred units of rows (lines/segments.py).
            up: unit vector (right, down) to the scene's top.

        Returns:
            [2, 3] coefficients of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].

        Raises:
            UnshutterError: the file is not this network, after all.
        """
        tokens = np.concatenate([segments, np.broadcast_to(np.asarray(up), (len(segments), 2))], axis=1)
        mask = np.ones((1, len(tokens)), dtype=bool)
        given = {"tokens": tokens[None].astype(np.float32), "mask": mask}
        return self.open().answers(given, (1, 2, 3))[0][0]
