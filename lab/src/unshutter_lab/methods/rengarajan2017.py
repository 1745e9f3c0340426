"""rengarajan2017: either network of the predecessor (ONNX) on a square of 256 px -> 15 key rows -> quadratic motion.

Trained by ``unshutter_lab.training``; the model cards next to the weights describe how, and how they were compressed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.method import Method
from unshutter.estimators.onnx import open_network
from unshutter.motion import Motion
from unshutter_lab.methods.square import SIZE, motion_of_square, square_of

KEY_ROWS = np.arange(0, SIZE, 18)


class Rengarajan2017(Estimator):
    """Runs the exported network."""

    def __init__(self, method: Method, weights: Path | None = None):
        super().__init__(method, weights)
        self._network = open_network(self.name, weights, ["rs"], "key_rows")

    def estimate(self, view: View) -> Motion:
        """Returns quadratic t_x and r_z through the key rows, first row as the reference."""
        key_rows = self._network.answers({"rs": square_of(view)}, (1, 2, len(KEY_ROWS)))[0][0]
        motion = motion_of_square(view, KEY_ROWS, key_rows, self.name, degree=2)
        return motion.rereferenced("first")
